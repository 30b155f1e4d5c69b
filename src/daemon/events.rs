//! The one task that hands events to the pipeline and carries out its actions.

use std::time::Instant;

use super::Daemon;
use super::batch::Events;
use super::session::SourceState;
use crate::calibration::outcome::{Outcome, Verdict};
use crate::condition::{Condition, Report, SourceFault};
use crate::date;
use crate::frame::rounded;
use crate::pipeline::{Action, Event};
use crate::publish::control::status::{OutcomeSummary, StatusCounts};
use crate::reading::Reading;
use crate::sensor::SourceEvent;
use crate::store::CalibrationRecord;
use crate::wall_clock;

impl Daemon {
    /// Takes the source's events. Returns whether they contain a reading.
    pub(super) fn take(&mut self, events: Events) -> bool {
        let mut fresh = false;
        for event in events {
            fresh |= matches!(event, SourceEvent::Reading(..));
            self.take_event(event);
        }
        // After the first events it is known that the source answers, or why it does not.
        if !self.reload.is_busy() {
            self.service.ready();
        }
        fresh
    }

    /// Tells the service manager what is due. `fresh`: there is a new reading.
    pub(super) fn tick(&mut self, fresh: bool) {
        let session = &self.session;
        // A device that is silent without saying why hangs, and a new start may help. One that is known to be
        // away is waited for, and a log may have gaps.
        let alive =
            fresh || session.state == SourceState::Faulty || !session.config.source.is_live();
        let heading_deg = session.heading_deg;
        (self.service).tick(Instant::now(), alive, self.reported.as_ref(), heading_deg);
    }

    fn take_event(&mut self, event: SourceEvent) {
        match event {
            SourceEvent::Reading(reading, taken) => self.read(reading, taken),
            SourceEvent::NewStretch => {
                if let Some(log) = &mut self.session.log_time {
                    log.begin_stretch();
                }
                self.handle(Event::NewStretch);
            }
            SourceEvent::Fault(fault) => {
                self.session.state = match &fault {
                    Some(_) => SourceState::Faulty,
                    None => SourceState::Good,
                };
                self.fault(fault);
            }
            SourceEvent::End(unusable) => self.session.state = SourceState::Over(unusable),
            SourceEvent::Broken(fault) => {
                self.session.state = SourceState::Broken;
                tracing::error!(
                    "there are no readings any more: {}; see to the source and restart the daemon",
                    fault.message
                );
                self.fault(Some(fault));
            }
        }
    }

    /// No input has arrived for a while.
    pub(super) fn take_silence(&mut self) {
        if self.session.listens() {
            let (t_s, taken) = self.session.last;
            let speed = self.session.config.source.pace();
            self.handle(Event::Silence(t_s + taken.elapsed().as_secs_f64() * speed));
        }
    }

    fn read(&mut self, reading: Reading, taken: Instant) {
        let session = &mut self.session;
        session.last = (reading.t_s, taken);
        self.counts.readings += 1;
        if let Some(recorder) = &mut session.recorder {
            recorder.take(reading);
        }
        if let Some(log) = &mut session.log_time {
            log.at(reading.t_s);
        }
        self.publisher.reading(&reading);
        self.handle(Event::Reading(reading));
    }

    fn fault(&mut self, fault: Option<SourceFault>) {
        self.counts.faults += u64::from(fault.is_some());
        self.handle(Event::Fault(fault));
    }

    /// Hands an event to the pipeline, and carries out what it wants done.
    pub(super) fn handle(&mut self, event: Event) {
        let mut actions = std::mem::take(&mut self.actions);
        self.session.pipeline.handle(event, &mut actions);
        for action in actions.drain(..) {
            self.carry_out(action);
        }
        self.actions = actions;
        if self.session.pipeline.has_given_up() {
            self.session.calibrator.cancel();
        }
        if let Some(field) = self.session.north.true_north.take_field() {
            self.handle(Event::Place(field));
        }
    }

    pub(super) fn carry_out(&mut self, action: Action) {
        let session = &mut self.session;
        match action {
            Action::Publish(mut heading) => {
                let taken = session.last.1;
                let time = match &mut session.log_time {
                    Some(log) => log.at(heading.t_s),
                    None => wall_clock::at(taken),
                };
                heading.declination_deg = session.north.declination_deg(time);
                let time = time.map(date::rfc3339);
                session.heading_deg = heading.magnetic_deg();
                self.counts.headings += u64::from(session.heading_deg.is_some());
                self.publisher.heading(heading, taken, time);
            }
            Action::Report(report) => {
                self.publisher.state(&report);
                // The progress of a turn is no change.
                let state = |report: &Report| (report.condition, report.reason);
                if self.reported.as_ref().map(state) != Some(state(&report)) {
                    log_report(&report);
                }
                self.reported = Some(report);
            }
            Action::Warn(news) => tracing::warn!("{news}"),
            Action::Turned(turn) => {
                self.counts.turns += 1;
                tracing::info!(
                    from_s = to_thousandths(turn.start_s),
                    to_s = to_thousandths(turn.end_s),
                    from_vertical_deg = turn.from_vertical_deg.map(to_thousandths),
                    "the board has made a full turn"
                );
            }
            Action::Calibrate(request) => session.calibrator.start(*request),
            Action::Conclude(outcome, origin) => {
                log_outcome(&outcome);
                self.publisher.calibration(&outcome);
                self.concluded = Some(OutcomeSummary {
                    verdict: outcome.verdict.word().to_owned(),
                    reason: outcome.reason.to_owned(),
                    message: outcome.message.clone(),
                });
                match outcome.verdict {
                    Verdict::Accepted => self.counts.calibrations_accepted += 1,
                    Verdict::Rejected => self.counts.calibrations_refused += 1,
                    Verdict::Kept => {}
                }
                if let Some(calibration) = outcome.calibration {
                    let now = wall_clock::unix_now_s();
                    let record = CalibrationRecord::of(&outcome, calibration, origin, now);
                    self.session.store.keep(record);
                    self.session.store.save(Box::new(|_| ()));
                }
            }
        }
    }

    pub(super) fn counts(&self) -> StatusCounts {
        StatusCounts {
            values_dropped: self.counts.values_dropped + self.session.pipeline.dropped().total(),
            ..self.counts.clone()
        }
    }

    pub(super) fn log_summary(&self) {
        let (counts, reported) = (self.counts(), &self.reported);
        let calibration = self.session.pipeline.calibration();
        let mode = calibration.map(|calibration| calibration.parameters.mode().word());
        let (word, reason) = reported
            .as_ref()
            .map_or(("starting", "starting"), |report| {
                (report.condition.word(), report.reason)
            });
        tracing::info!(
            reason,
            calibration = mode.unwrap_or("none"),
            readings = counts.readings,
            headings = counts.headings,
            turns = counts.turns,
            calibrations_accepted = counts.calibrations_accepted,
            calibrations_refused = counts.calibrations_refused,
            values_dropped = counts.values_dropped,
            faults = counts.faults,
            clients = self.publisher.clients(),
            uptime_s = self.begun.elapsed().as_secs(),
            "summary: {word}"
        );
    }
}

/// To three decimal places: no line in the log needs more.
fn to_thousandths(value: f64) -> f64 {
    rounded(value, 3)
}

/// Reasons, beside those of the gyro, that say what is wrong with the chips or how they are mounted.
const CHIPS_AT_FAULT: [&str; 5] = [
    "accel_unit",
    "accel_axes",
    "accel_dead",
    "mag_axes",
    "reversed_field",
];

fn log_report(report: &Report) {
    let (word, reason) = (report.condition.word(), report.reason);
    // Before the first reading the source has no time.
    let t_s = Some(to_thousandths(report.t_s)).filter(|t_s| t_s.is_finite());
    let worth_a_look = matches!(
        report.condition,
        Condition::Stale | Condition::Fault | Condition::Disturbed
    ) || reason.starts_with("gyro_")
        || CHIPS_AT_FAULT.contains(&reason);
    if worth_a_look {
        tracing::warn!(reason, t_s, "{word}: {}", report.message);
    } else {
        tracing::info!(reason, t_s, "{word}: {}", report.message);
    }
}

fn log_outcome(outcome: &Outcome) {
    let (reason, message) = (outcome.reason, &outcome.message);
    match outcome.verdict {
        Verdict::Accepted => tracing::info!(
            reason,
            heading_sd_deg = outcome.heading_sd_deg.map(to_thousandths),
            gyro_rms_deg = outcome.gyro_rms_deg.map(to_thousandths),
            residual_mgauss = outcome.residual_mgauss.map(to_thousandths),
            "calibration accepted: {message}"
        ),
        Verdict::Kept => tracing::info!(reason, "active calibration kept: {message}"),
        Verdict::Rejected => tracing::warn!(reason, "calibration rejected: {message}"),
    }
}
