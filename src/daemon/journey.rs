//! The one task that hands events to the pipeline and carries out its actions.

use std::time::{Duration, Instant};

use tokio::sync::mpsc;
use tokio::time::sleep_until;

use super::calibrator::Calibrator;
use super::keeper::Keeper;
use super::recorder::Recorder;
use super::source::Message;
use super::time_of_day;
use crate::calibration::outcome::{Outcome, Verdict};
use crate::condition::{Condition, Report, Trouble};
use crate::pipeline::{Action, Event, Pipeline};
use crate::publish::server::Publisher;
use crate::reading::Reading;

/// The pipeline is told when nothing was read for this long.
const SILENCE: Duration = Duration::from_millis(100);

/// The pipeline and everything that it acts on.
pub(super) struct Journey {
    pipeline: Pipeline,
    publisher: Publisher,
    calibrator: Calibrator,
    keeper: Keeper,
    recorder: Option<Recorder>,
    speed: f64,
    /// Whether readings are taken now: then their time of day is known.
    live: bool,
    actions: Vec<Action>,
    /// The last reading's time on the source's clock, and when it was handed out.
    last: (f64, Instant),
    logged: Option<(Condition, &'static str)>,
}

impl Journey {
    pub(super) fn new(
        pipeline: Pipeline,
        publisher: Publisher,
        keeper: Keeper,
        recorder: Option<Recorder>,
        speed: f64,
        live: bool,
    ) -> Self {
        Self {
            pipeline,
            publisher,
            calibrator: Calibrator::default(),
            keeper,
            recorder,
            speed,
            live,
            actions: Vec::new(),
            last: (0.0, Instant::now()),
            logged: None,
        }
    }

    /// Waits until everything that was to be kept is on disk.
    pub(super) fn close(self) {
        if let Some(recorder) = self.recorder {
            recorder.close();
        }
        self.keeper.close();
    }

    /// Goes on until the source is at its end and the last calibration on it has come back. A source that
    /// breaks is no end: clients shall see what is wrong.
    pub(super) async fn make(&mut self, messages: &mut mpsc::Receiver<Message>) {
        let mut open = true;
        let mut over = false;
        let mut heard = Instant::now();
        while !over || self.calibrator.is_busy() {
            // In accelerated time the fraction of a second that a calibration takes would be half a minute
            // of headings: there the readings wait for it.
            let listening = open && !(self.speed > 1.0 && self.calibrator.is_busy());
            tokio::select! {
                biased;
                outcome = self.calibrator.outcome() => {
                    self.handle(Event::Calibrated(Box::new(outcome)));
                    heard = Instant::now();
                }
                message = messages.recv(), if listening => {
                    heard = Instant::now();
                    match message {
                        Some(Message::Reading(reading, taken)) => self.read(reading, taken),
                        Some(Message::Readings(readings)) => {
                            for (reading, taken) in readings {
                                self.read(reading, taken);
                            }
                        }
                        Some(Message::End) => (open, over) = (false, true),
                        Some(Message::Trouble(trouble)) => self.handle(Event::Fault(trouble)),
                        Some(Message::Broken(trouble)) => {
                            open = false;
                            self.broken(trouble);
                        }
                        None => {
                            open = false;
                            self.broken(Trouble {
                                code: "internal",
                                message: "the thread of the source panicked".to_owned(),
                            });
                        }
                    }
                }
                () = sleep_until((heard + SILENCE).into()), if listening => {
                    heard = Instant::now();
                    let (t_s, taken) = self.last;
                    self.handle(Event::Silence(t_s + taken.elapsed().as_secs_f64() * self.speed));
                }
            }
        }
        if over {
            tracing::info!("the source is at its end");
        }
    }

    fn read(&mut self, reading: Reading, taken: Instant) {
        self.last = (reading.t_s, taken);
        if let Some(recorder) = &mut self.recorder {
            recorder.take(reading);
        }
        self.publisher.reading(&reading);
        self.handle(Event::Reading(reading));
    }

    fn broken(&mut self, trouble: Trouble) {
        tracing::error!(
            "there are no readings any more: {}; see to the source and start again",
            trouble.message
        );
        self.handle(Event::Fault(Some(trouble)));
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
        match action {
            Action::Publish(heading) => {
                let taken = self.last.1;
                let time = self.live.then(|| time_of_day::rfc3339(taken)).flatten();
                self.publisher.heading(heading, taken, time);
            }
            Action::Report(report) => {
                self.log_report(&report);
                self.publisher.state(&report);
            }
            Action::Turned(turn) => tracing::info!(
                from_s = turn.start_s,
                to_s = turn.end_s,
                from_vertical_deg = turn.from_vertical_deg,
                "the board has made a full turn"
            ),
            Action::Calibrate(request) => self.calibrator.start(*request),
            Action::Conclude(outcome) => {
                log_outcome(&outcome);
                self.publisher.calibration(&outcome);
                if let (Verdict::Accepted, Some(calibration)) =
                    (outcome.verdict, outcome.calibration)
                {
                    self.keeper.save(calibration);
                }
            }
        }
    }

    /// One line a change; the progress of a turn is none.
    fn log_report(&mut self, report: &Report) {
        let state = (report.condition, report.reason);
        if self.logged == Some(state) {
            return;
        }
        self.logged = Some(state);
        let (word, reason) = (report.condition.word(), report.reason);
        match report.condition {
            Condition::Stale | Condition::Fault | Condition::Disturbed => {
                tracing::warn!(reason, t_s = report.t_s, "{word}: {}", report.message);
            }
            _ => tracing::info!(reason, t_s = report.t_s, "{word}: {}", report.message),
        }
    }
}

fn log_outcome(outcome: &Outcome) {
    let (reason, message) = (outcome.reason, &outcome.message);
    match outcome.verdict {
        Verdict::Accepted => tracing::info!(
            reason,
            heading_sd_deg = outcome.heading_sd_deg,
            gyro_rms_deg = outcome.gyro_rms_deg,
            residual_mgauss = outcome.residual_mgauss,
            "calibration accepted: {message}"
        ),
        Verdict::Kept => tracing::info!(reason, "calibration in force kept: {message}"),
        Verdict::Rejected => tracing::warn!(reason, "calibration rejected: {message}"),
    }
}
