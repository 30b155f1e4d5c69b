//! The one task that hands events to the pipeline and carries out its actions.

mod mounting;
mod orders;

use std::io;
use std::time::Instant;

use tokio::sync::mpsc;

use super::calibrator::Calibrator;
use super::keeper::Keeper;
use super::recorder::Recorder;
use super::silence::Silence;
use super::source::Message;
use super::tally::Tally;
use super::{DISK_PATIENCE, join_for, spawn, time_of_day};
use crate::calibration::outcome::{Outcome, Verdict};
use crate::calibration::verdict::Limits;
use crate::condition::{Condition, Report, Trouble};
use crate::config::Config;
use crate::config::source::Kind;
use crate::date;
use crate::frame::{Mounting, Mountings};
use crate::pipeline::{Action, Event, Pipeline};
use crate::publish::control::Order;
use crate::publish::server::Publisher;
use crate::reading::Reading;
use crate::recording::{Header, TimeOfDay};
use crate::service::Service;
use crate::store::{History, Made};
use crate::true_north::TrueNorth;

/// The pipeline and everything that it acts on.
pub(super) struct Journey {
    /// What goes on after a reload.
    pub(super) lasting: Lasting,
    pipeline: Pipeline,
    calibrator: Calibrator,
    keeper: Keeper,
    recorder: Option<Recorder>,
    speed: f64,
    /// Whether readings are taken now: then silence means that something hangs.
    live: bool,
    /// Of a log: else readings are of the time of day at which they are handed out.
    log_time: Option<TimeOfDay>,
    true_north: TrueNorth,
    actions: Vec<Action>,
    /// The last reading's time on the source's clock, and when it was handed out.
    last: (f64, Instant),
    /// Whether the source may still say something, and whether it is at its end.
    open: bool,
    over: bool,
    /// Why most of the source could not be used, if so.
    unusable: Option<String>,
    /// Whether the source is known to be in trouble, and is waited for.
    troubled: bool,
    /// As clients see it.
    source: String,
    /// Where headings are served.
    heading_socket: String,
    limits: Limits,
    /// The chips on the board, and the board as the configuration has it.
    chips: Mountings,
    configured: Mounting,
    /// The magnetic heading published last with the board mounted as it is now, degrees.
    heading_deg: Option<f64>,
}

/// What the daemon says about itself, from its start to its end.
pub(super) struct Lasting {
    pub(super) service: Service,
    pub(super) publisher: Publisher,
    tally: Tally,
    reported: Option<Report>,
    /// Of everybody that the journey listens to.
    silence: Silence,
}

impl Lasting {
    /// Needs a runtime.
    pub(super) fn new(publisher: Publisher, service: Service) -> io::Result<Self> {
        Ok(Self {
            service,
            publisher,
            tally: Tally::new(),
            reported: None,
            silence: Silence::new()?,
        })
    }
}

impl Journey {
    /// `source` is its name, as clients see it, and `header` what it says of itself.
    pub(super) fn new(
        pipeline: Pipeline,
        keeper: Keeper,
        recorder: Option<Recorder>,
        config: &Config,
        source: String,
        header: &Header,
        lasting: Lasting,
    ) -> Self {
        let mut journey = Self {
            lasting,
            pipeline,
            calibrator: Calibrator::default(),
            keeper,
            recorder,
            speed: config.source.pace(),
            live: config.source.is_live(),
            log_time: (config.source.kind == Some(Kind::Replay)).then(|| TimeOfDay::new(header)),
            true_north: TrueNorth::new(config.true_north),
            actions: Vec::new(),
            last: (0.0, Instant::now()),
            open: true,
            over: false,
            unusable: None,
            troubled: false,
            source,
            heading_socket: config.socket.socket.display().to_string(),
            limits: config.verdict.clone(),
            chips: header.mountings,
            configured: config.mounting.board(),
            heading_deg: None,
        };
        journey.handle(Event::Policy(journey.keeper.history().mode));
        journey
    }

    /// Why most of the source could not be used, if that is known by now.
    pub(super) fn take_unusable(&mut self) -> Option<String> {
        self.unusable.take()
    }

    /// Waits until everything that was to be kept is on disk, if that goes on for no longer than a stop may take.
    /// Gives back what goes on, and what was kept.
    pub(super) fn close(self) -> (Lasting, History) {
        let (recorder, keeper) = (self.recorder, self.keeper);
        let history = keeper.history().clone();
        let closing = spawn("closing", "end", move || {
            keeper.close();
            if let Some(recorder) = recorder {
                recorder.close();
            }
        });
        match closing {
            Ok(thread) => {
                if !join_for("store", thread, DISK_PATIENCE) {
                    tracing::error!("the disk hangs: what was saved last may not be kept");
                }
            }
            Err(error) => tracing::error!("{error}"),
        }
        (self.lasting, history)
    }

    /// Goes on until the source is at its end and the last calibration on it has come back. A source that
    /// breaks is no end: clients shall see what is wrong.
    pub(super) async fn make(
        &mut self,
        messages: &mut mpsc::Receiver<Message>,
        orders: &mut mpsc::Receiver<Order>,
    ) {
        while !self.over || self.calibrator.is_busy() {
            // In accelerated time the fraction of a second that a calibration takes would be half a minute
            // of headings: there the readings wait for it.
            let listening = self.open && !(self.speed > 1.0 && self.calibrator.is_busy());
            let mut alive = false;
            tokio::select! {
                biased;
                outcome = self.calibrator.outcome() => {
                    self.handle(Event::Calibrated(Box::new(outcome)));
                    self.lasting.silence.hear();
                }
                Some(order) = orders.recv() => self.order(order),
                message = messages.recv(), if listening => {
                    self.lasting.silence.hear();
                    alive = self.take(message);
                }
                () = self.lasting.silence.falls() => {
                    self.lasting.silence.hear();
                    if listening {
                        let (t_s, taken) = self.last;
                        self.handle(Event::Silence(t_s + taken.elapsed().as_secs_f64() * self.speed));
                    }
                }
            }
            // A device that is silent without saying why hangs, and a new start may help. One that is known to be
            // away is waited for, and a log may have holes.
            let alive = alive || self.troubled || !self.live;
            let Lasting {
                service, silence, ..
            } = &mut self.lasting;
            service.tick(silence.heard(), alive);
        }
        if self.over {
            tracing::info!("the source is at its end");
        }
    }

    /// Whether there was a reading in it. The first message says that the source answers or is waited for.
    fn take(&mut self, message: Option<Message>) -> bool {
        let fresh = match message {
            Some(Message::Reading(reading, taken)) => {
                self.read(reading, taken);
                true
            }
            Some(Message::Readings(readings)) => {
                for (reading, taken) in &readings {
                    self.read(*reading, *taken);
                }
                !readings.is_empty()
            }
            Some(Message::NewStretch) => {
                if let Some(log) = &mut self.log_time {
                    log.begin_stretch();
                }
                self.handle(Event::NewStretch);
                false
            }
            Some(Message::Trouble(trouble)) => {
                self.troubled = trouble.is_some();
                self.fault(trouble);
                false
            }
            Some(Message::End(unusable)) => {
                (self.open, self.over) = (false, true);
                self.unusable = unusable;
                false
            }
            Some(Message::Broken(trouble)) => {
                self.broken(trouble);
                false
            }
            None => {
                self.broken(Trouble {
                    code: "internal",
                    message: "the thread of the source panicked".to_owned(),
                });
                false
            }
        };
        self.lasting.service.ready();
        fresh
    }

    fn read(&mut self, reading: Reading, taken: Instant) {
        self.last = (reading.t_s, taken);
        self.lasting.tally.readings += 1;
        if let Some(recorder) = &mut self.recorder {
            recorder.take(reading);
        }
        if let Some(log) = &mut self.log_time {
            log.at(reading.t_s);
        }
        self.lasting.publisher.reading(&reading);
        self.handle(Event::Reading(reading));
    }

    /// Puts a calibration first in the history; its number.
    fn keep(&mut self, made: Made) -> u64 {
        let most = self.keeper.most();
        let history = self.keeper.history_mut();
        history.keep(made, most);
        history.last_number
    }

    fn fault(&mut self, trouble: Option<Trouble>) {
        self.lasting.tally.faults += u64::from(trouble.is_some());
        self.handle(Event::Fault(trouble));
    }

    fn broken(&mut self, trouble: Trouble) {
        self.open = false;
        tracing::error!(
            "there are no readings any more: {}; see to the source and start again",
            trouble.message
        );
        self.fault(Some(trouble));
    }

    fn handle(&mut self, event: Event) {
        let mut actions = std::mem::take(&mut self.actions);
        self.pipeline.handle(event, &mut actions);
        for action in actions.drain(..) {
            self.carry_out(action);
        }
        self.actions = actions;
    }

    fn carry_out(&mut self, action: Action) {
        let Lasting {
            service,
            publisher,
            tally,
            ..
        } = &mut self.lasting;
        match action {
            Action::Publish(mut heading) => {
                let taken = self.last.1;
                let time = match &mut self.log_time {
                    Some(log) => log.at(heading.t_s),
                    None => time_of_day::at(taken),
                };
                heading.declination_deg = self.true_north.declination_deg(time);
                if let Some(news) = self.true_north.news() {
                    tracing::warn!("{news}");
                }
                let time = time.map(date::rfc3339);
                self.heading_deg = heading.magnetic_deg();
                tally.headings += u64::from(heading.fused_deg.is_some());
                service.heading(heading.fused_deg);
                publisher.heading(heading, taken, time);
            }
            Action::Report(report) => {
                service.state(&report);
                publisher.state(&report);
                self.log_report(report);
            }
            Action::Turned(turn) => {
                tally.turns += 1;
                tracing::info!(
                    from_s = rounded(turn.start_s),
                    to_s = rounded(turn.end_s),
                    from_vertical_deg = turn.from_vertical_deg.map(rounded),
                    "the board has made a full turn"
                );
            }
            Action::Calibrate(request) => self.calibrator.start(*request),
            Action::Conclude(outcome) => {
                log_outcome(&outcome);
                publisher.calibration(&outcome);
                match outcome.verdict {
                    Verdict::Accepted => tally.accepted += 1,
                    Verdict::Rejected => tally.refused += 1,
                    Verdict::Kept => {}
                }
                if let (Verdict::Accepted, Some(calibration)) =
                    (outcome.verdict, outcome.calibration)
                {
                    let reason = self.pipeline.reason();
                    let now = time_of_day::unix_now_s();
                    let made = Made::of(&outcome, calibration, reason, now);
                    self.keep(made);
                    self.keeper.save(Box::new(|_| ()));
                }
            }
        }
    }

    /// One line a change; the progress of a turn is none.
    fn log_report(&mut self, report: Report) {
        let last = self.lasting.reported.replace(report);
        let Some(report) = &self.lasting.reported else {
            return;
        };
        if last
            .is_some_and(|last| (last.condition, last.reason) == (report.condition, report.reason))
        {
            return;
        }
        let (word, reason) = (report.condition.word(), report.reason);
        // Before the first reading the source has no time.
        let t_s = Some(rounded(report.t_s)).filter(|t_s| t_s.is_finite());
        let worth_a_look = matches!(
            report.condition,
            Condition::Stale | Condition::Fault | Condition::Disturbed
        ) || reason.starts_with("gyro_");
        if worth_a_look {
            tracing::warn!(reason, t_s, "{word}: {}", report.message);
        } else {
            tracing::info!(reason, t_s, "{word}: {}", report.message);
        }
    }

    /// One line with all that is worth knowing.
    pub(super) fn log_summary(&self) {
        let Lasting {
            publisher,
            tally,
            reported,
            ..
        } = &self.lasting;
        let calibration = self.pipeline.calibration();
        let mode = calibration.map(|calibration| calibration.parameters.mode().word());
        let (word, reason) = reported
            .as_ref()
            .map_or(("starting", "starting"), |report| {
                (report.condition.word(), report.reason)
            });
        tracing::info!(
            reason,
            calibration = mode.unwrap_or("none"),
            readings = tally.readings,
            headings = tally.headings,
            turns = tally.turns,
            calibrations_accepted = tally.accepted,
            calibrations_refused = tally.refused,
            values_dropped = self.pipeline.dropped(),
            faults = tally.faults,
            clients = publisher.clients(),
            uptime_s = tally.begun.elapsed().as_secs(),
            "summary: {word}"
        );
    }
}

/// To three decimal places: no line in the log needs more.
fn rounded(value: f64) -> f64 {
    (1e3 * value).round() / 1e3
}

fn log_outcome(outcome: &Outcome) {
    let (reason, message) = (outcome.reason, &outcome.message);
    match outcome.verdict {
        Verdict::Accepted => tracing::info!(
            reason,
            heading_sd_deg = outcome.heading_sd_deg.map(rounded),
            gyro_rms_deg = outcome.gyro_rms_deg.map(rounded),
            residual_mgauss = outcome.residual_mgauss.map(rounded),
            "calibration accepted: {message}"
        ),
        Verdict::Kept => tracing::info!(reason, "calibration in force kept: {message}"),
        Verdict::Rejected => tracing::warn!(reason, "calibration rejected: {message}"),
    }
}

#[cfg(test)]
mod tests;
