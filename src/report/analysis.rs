//! A log taken through the pipeline, and what a report needs of it.

use std::convert::Infallible;
use std::path::Path;
use std::time::Duration;

use super::thin::Thin;
use crate::calibration::model::Calibration;
use crate::calibration::outcome::{Outcome, Verdict};
use crate::calibration::policy::Policy;
use crate::calibration::verdict::Limit;
use crate::calibration::{Request, calibrate};
use crate::condition::Report;
use crate::pipeline::{Action, Event, Pipeline, Setup};
use crate::reading::Reading;
use crate::recording::Header;
use crate::true_north::{Position, TrueNorth};

/// How many headings are kept for the figures.
const MOST_HEADINGS: usize = 4000;

/// How many verdicts, warnings and changes of condition are kept.
const MOST_EVENTS: usize = 1000;

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Point {
    pub(super) t_s: f64,
    /// The heading that would have been published, degrees.
    pub(super) heading_deg: Option<f64>,
    /// The same from true north, [0, 360).
    pub(super) true_deg: Option<f64>,
    pub(super) sd_deg: Option<f64>,
    pub(super) raw_deg: Option<f64>,
}

#[derive(Debug)]
pub(super) struct Judged {
    pub(super) request: Request,
    pub(super) outcome: Outcome,
}

impl Judged {
    pub(super) fn is_rejected(&self) -> bool {
        self.outcome.verdict == Verdict::Rejected
    }
}

/// A log's way through the pipeline.
pub struct Analysis {
    /// The log, or the socket.
    pub(super) source: String,
    pub(super) header: Header,
    pipeline: Pipeline,
    pub(super) found: Findings,
}

#[derive(Default)]
pub(super) struct Findings {
    north: TrueNorth,
    since_1970: Option<Duration>,
    /// How far magnetic north is east of true north at the end, if that is known.
    pub(super) declination_deg: Option<f64>,
    /// What a user should know, as the daemon's journal would have it.
    pub(super) warnings: Vec<String>,
    /// The newest heading that was published.
    pub(super) newest: Option<Point>,
    pub(super) points: Thin<Point>,
    /// The first report of each run with one condition and reason.
    pub(super) changes: Vec<Report>,
    /// Verdicts with their times, of turns and of motion; without the swarm, whose fit values are many.
    pub(super) verdicts: Vec<(f64, Box<Outcome>)>,
    /// The turn that the figures show: the last that was not refused, or else the last.
    pub(super) turn: Option<Judged>,
    /// The calibration under way.
    under_way: Option<Request>,
    pub(super) first_s: Option<f64>,
    pub(super) now_s: f64,
    pub(super) readings: u64,
    pub(super) headings: u64,
    pub(super) turns: u64,
    pub(super) last: Option<Report>,
}

impl Analysis {
    /// Begins as a daemon with this setup would, with a calibration or without.
    pub fn new(
        source: &Path,
        header: Header,
        setup: Setup,
        north: TrueNorth,
        calibration: Option<Calibration>,
    ) -> Self {
        Self {
            source: source.display().to_string(),
            header,
            pipeline: Pipeline::new(setup, calibration),
            found: Findings {
                north,
                points: Thin::to(MOST_HEADINGS),
                ..Findings::default()
            },
        }
    }

    /// Calibrates as a daemon with this policy would.
    pub fn put_policy(&mut self, policy: Policy) {
        self.handle(Event::Policy(policy));
    }

    /// The board is there from now on.
    pub fn put_position(&mut self, position: Position) {
        self.found.north.put_position(position);
    }

    /// Takes the next reading, and how long after the beginning of 1970 it was taken, if that is known.
    pub fn take(&mut self, reading: Reading, since_1970: Option<Duration>) {
        let found = &mut self.found;
        found.since_1970 = since_1970;
        found.readings += 1;
        found.first_s.get_or_insert(reading.t_s);
        found.now_s = reading.t_s;
        self.handle(Event::Reading(reading));
    }

    /// The times of the readings that follow have nothing to do with those before.
    pub fn begin_stretch(&mut self) {
        self.handle(Event::NewStretch);
    }

    /// Whether there was anything to analyse.
    pub fn has_readings(&self) -> bool {
        self.found.readings > 0
    }

    pub(super) fn calibration(&self) -> Option<Calibration> {
        self.pipeline.calibration()
    }

    /// What motion has taught, and the limits that this is held to; `None` where a full turn has calibrated.
    pub(super) fn motion(&self) -> Option<(Outcome, [Limit; 3])> {
        let turn = self.found.turn.as_ref();
        if turn.is_none_or(Judged::is_rejected) {
            self.pipeline.learnt_by_motion()
        } else {
            None
        }
    }

    /// Values that no sensor can have taken.
    pub(super) fn dropped(&self) -> u64 {
        self.pipeline.dropped().total()
    }

    fn handle(&mut self, event: Event) {
        let Self {
            pipeline, found, ..
        } = self;
        let Ok(()) = pipeline.play(event, |action| Ok::<_, Infallible>(found.note(action)));
    }
}

impl Findings {
    /// Keeps the newest turn that was not refused, or else the newest, with its verdict.
    fn judged(&mut self, request: Request, outcome: &Outcome) {
        let judged = Judged {
            request,
            outcome: outcome.clone(),
        };
        if !judged.is_rejected() || self.turn.as_ref().is_none_or(Judged::is_rejected) {
            self.turn = Some(judged);
        }
    }

    fn warn(&mut self, news: String) {
        if self.warnings.len() < MOST_EVENTS {
            self.warnings.push(news);
        }
    }

    /// Carries out the action. Returns the event that the pipeline is to be given next, if one follows.
    fn note(&mut self, action: Action) -> Option<Event> {
        match action {
            Action::Publish(mut heading) => {
                self.declination_deg = self.north.declination_deg(self.since_1970);
                if let Some(news) = self.north.news()
                    && self.north.is_warning()
                {
                    self.warn(news);
                }
                heading.declination_deg = self.declination_deg;
                let heading_deg = heading.magnetic_deg();
                let point = Point {
                    t_s: heading.t_s,
                    heading_deg,
                    true_deg: heading.true_deg().map(|degrees| degrees.rem_euclid(360.0)),
                    sd_deg: heading_deg.and(heading.sd_deg),
                    raw_deg: heading.raw_deg,
                };
                self.points.push(point);
                if heading_deg.is_some() {
                    self.headings += 1;
                    self.newest = Some(point);
                }
                return self.north.take_field().map(Event::Place);
            }
            Action::Report(report) => {
                let same = |last: &Report| {
                    (last.condition, last.reason) == (report.condition, report.reason)
                };
                if !self.changes.last().is_some_and(same) {
                    // More cannot be told apart in a chart: the oldest is left out.
                    if self.changes.len() == MOST_EVENTS {
                        self.changes.remove(0);
                    }
                    self.changes.push(report.clone());
                }
                self.last = Some(report);
            }
            Action::Turned(_) => self.turns += 1,
            Action::Calibrate(request) => {
                let outcome = calibrate(&request);
                self.under_way = Some(*request);
                return Some(Event::Calibrated(Box::new(outcome)));
            }
            Action::Conclude(mut outcome, _) => {
                // The pipeline decides: it may be more certain already, or find the gyro wrong.
                if outcome.method == "turn"
                    && let Some(request) = self.under_way.take()
                {
                    self.judged(request, &outcome);
                }
                if self.verdicts.len() == MOST_EVENTS {
                    self.verdicts.remove(0);
                }
                outcome.swarm = None;
                self.verdicts.push((self.now_s, outcome));
            }
            Action::Warn(news) => self.warn(news),
        }
        None
    }
}
