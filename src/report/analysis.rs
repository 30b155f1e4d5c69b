//! A log taken through the pipeline, and what a report needs of it.

use super::thin::Thin;
use crate::calibration::model::Calibration;
use crate::calibration::outcome::{Outcome, Verdict};
use crate::calibration::{Request, calibrate};
use crate::condition::Report;
use crate::pipeline::{Action, Event, MotionMeasures, Pipeline, Setup};
use crate::reading::Reading;

/// How many headings are kept for the figures.
const MOST_HEADINGS: usize = 4000;

/// How many verdicts are listed, and changes of condition drawn.
const MOST_EVENTS: usize = 1000;

/// One heading of the log.
#[derive(Clone, Copy, Debug)]
pub(super) struct Point {
    pub(super) t_s: f64,
    /// The heading that would have been published, degrees.
    pub(super) heading_deg: Option<f64>,
    pub(super) sd_deg: Option<f64>,
    pub(super) raw_deg: Option<f64>,
}

/// A condition, from when on.
#[derive(Clone, Copy, Debug)]
pub(super) struct Span {
    pub(super) from_s: f64,
    pub(super) word: &'static str,
    pub(super) reason: &'static str,
}

/// A turn that was calibrated on.
#[derive(Debug)]
pub(super) struct Judged {
    pub(super) request: Request,
    pub(super) outcome: Outcome,
}

/// What is found in a log.
pub struct Analysis {
    pipeline: Pipeline,
    pub(super) points: Thin<Point>,
    pub(super) spans: Vec<Span>,
    /// Verdicts with their times, of turns and of motion.
    pub(super) verdicts: Vec<(f64, &'static str, &'static str, String, &'static str)>,
    /// The turn that the figures show: the last that was accepted, or else the last.
    pub(super) turn: Option<Judged>,
    pub(super) first_s: Option<f64>,
    pub(super) now_s: f64,
    pub(super) readings: u64,
    pub(super) headings: u64,
    /// How many turns the board made.
    pub(super) turns: u64,
    /// The condition that came last.
    pub(super) last: Option<Report>,
    actions: Vec<Action>,
}

impl Analysis {
    /// Begins as a daemon with this setup would, with a calibration or without.
    pub fn new(setup: Setup, calibration: Option<Calibration>) -> Self {
        Self {
            pipeline: Pipeline::new(setup, calibration),
            points: Thin::to(MOST_HEADINGS),
            spans: Vec::new(),
            verdicts: Vec::new(),
            turn: None,
            first_s: None,
            now_s: 0.0,
            readings: 0,
            headings: 0,
            turns: 0,
            last: None,
            actions: Vec::new(),
        }
    }

    /// Takes the next reading.
    pub fn take(&mut self, reading: Reading) {
        self.readings += 1;
        self.first_s.get_or_insert(reading.t_s);
        self.now_s = reading.t_s;
        self.handle(Event::Reading(reading));
    }

    /// The times of the readings that follow have nothing to do with those before.
    pub fn begin_stretch(&mut self) {
        self.handle(Event::NewStretch);
    }

    /// Whether there was anything to analyse.
    pub fn has_readings(&self) -> bool {
        self.readings > 0
    }

    /// What is known at the end.
    pub(super) fn calibration(&self) -> Option<Calibration> {
        self.pipeline.calibration()
    }

    /// What motion has taught, and what that was judged by, as `calibrate` does for a log without a full turn.
    pub(super) fn motion(&self) -> Option<(Outcome, MotionMeasures)> {
        let outcome = self.pipeline.learnt_by_motion()?;
        let measures = self.pipeline.motion_measures()?;
        (self.turns == 0).then_some((outcome, measures))
    }

    /// Values that no sensor can have taken.
    pub(super) fn dropped(&self) -> u64 {
        self.pipeline.dropped()
    }

    fn handle(&mut self, event: Event) {
        let mut actions = std::mem::take(&mut self.actions);
        self.pipeline.handle(event, &mut actions);
        // A calibration that ends asks for the next one now and then.
        while !actions.is_empty() {
            let mut asked = Vec::new();
            for action in actions.drain(..) {
                match action {
                    Action::Calibrate(request) => asked.push(request),
                    other => self.note(other),
                }
            }
            for request in asked {
                let outcome = calibrate(&request, &|| None);
                self.judged(*request, &outcome);
                self.pipeline
                    .handle(Event::Calibrated(Box::new(outcome)), &mut actions);
            }
        }
        self.actions = actions;
    }

    fn judged(&mut self, request: Request, outcome: &Outcome) {
        let accepted = |outcome: &Outcome| outcome.verdict == Verdict::Accepted;
        let before = self
            .turn
            .as_ref()
            .is_some_and(|turn| accepted(&turn.outcome));
        if accepted(outcome) || !before {
            self.turn = Some(Judged {
                request,
                outcome: outcome.clone(),
            });
        }
    }

    fn note(&mut self, action: Action) {
        match action {
            Action::Publish(heading) => {
                let heading_deg = heading.magnetic_deg();
                self.headings += u64::from(heading_deg.is_some());
                self.points.push(Point {
                    t_s: heading.t_s,
                    heading_deg,
                    sd_deg: heading_deg.and(heading.sd_deg),
                    raw_deg: heading.raw_deg,
                });
            }
            Action::Report(report) => {
                let same = |span: &Span| {
                    (span.word, span.reason) == (report.condition.word(), report.reason)
                };
                if !self.spans.last().is_some_and(same) && self.spans.len() < MOST_EVENTS {
                    self.spans.push(Span {
                        from_s: report.t_s,
                        word: report.condition.word(),
                        reason: report.reason,
                    });
                }
                self.last = Some(report);
            }
            Action::Turned(_) => self.turns += 1,
            Action::Conclude(outcome) if self.verdicts.len() < MOST_EVENTS => {
                self.verdicts.push((
                    self.now_s,
                    outcome.verdict.word(),
                    outcome.reason,
                    outcome.message.clone(),
                    outcome.method,
                ));
            }
            Action::Conclude(_) | Action::Calibrate(_) | Action::Warn(_) => {}
        }
    }
}
