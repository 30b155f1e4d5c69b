//! From readings to headings, as a pure state machine: an event in, actions out.
//!
//! No clock, no file, no thread: time comes with the events, and what takes long or touches the world
//! goes out as an action. A calibration is an action whose outcome comes back as an event: live, when
//! the worker has finished; in a replay, before the next reading.

mod active;
mod collector;
mod force_unit;
mod intake;
mod judge;
mod learn;
mod publish;
mod saturation;
mod stretch;
mod survey;

use std::collections::VecDeque;

use crate::attitude;
use crate::calibration::model::Calibration;
use crate::calibration::outcome::Outcome;
use crate::calibration::policy::{CalibrationOrigin, Policy};
use crate::calibration::verdict::{self, Refusal};
use crate::calibration::{self, FieldSample, Request};
use crate::check::{Fault, settings};
use crate::condition::{Condition, Report, SourceFault};
use crate::estimate::{Estimate, Sample, UNKNOWN_SD_DEG};
use crate::frame::Mountings;
use crate::frozen::{Frozen, FrozenWatch};
use crate::heading::Heading;
use crate::reading::Reading;
use crate::true_north::EarthField;
use crate::turn::{self, Turn};
use intake::Intake;
use learn::Learning;
use saturation::RunState;

pub use crate::outliers::Dropped;
pub use survey::{EmptyAxis, Survey};

settings! {
    /// Settings of the pipeline itself; its modules have their own.
    #[derive(Copy)]
    pub struct Settings {
        /// A magnetometer sample older than this is stale, and no heading is published.
        stale_s: f64 = 0.5, 0.1..=10.0, "seconds";
        /// Samples are kept this long for a calibration, and so the first of two turns may be this old.
        buffer_s: f64 = 120.0, 10.0..=600.0, "seconds";
        /// A heading is published while its deviation is at most this.
        publish_sd_deg: f64 = 10.0, 1.0..=45.0, "degrees";
        /// The state is `good` while the deviation is at most this, else `degraded` with reason `learning`.
        good_sd_deg: f64 = 3.0, 0.5..=20.0, "degrees";
    }
    compares Settings::check_order;
}

impl Settings {
    /// Checks that `good_sd_deg` is at most `publish_sd_deg`: otherwise a state could be good without a heading.
    fn check_order(&self, faults: &mut Vec<Fault>) {
        if self.good_sd_deg > self.publish_sd_deg {
            let right = format!("at most publish_sd_deg, which is {}", self.publish_sd_deg);
            faults.push(Fault::new(
                "good_sd_deg",
                self.good_sd_deg.to_string(),
                right,
            ));
        }
    }
}

/// Everything that a pipeline is set up with.
#[derive(Clone, Debug, Default)]
pub struct Setup {
    /// Its own settings.
    pub pipeline: Settings,
    /// How the chips are mounted.
    pub mountings: Mountings,
    /// Settings of the attitude.
    pub attitude: attitude::Settings,
    /// Settings of the turn detection.
    pub turn: turn::Settings,
    /// Settings of a calibration.
    pub calibration: calibration::settings::Settings,
    /// Limits of the verdict.
    pub verdict: verdict::Limits,
}

/// What happens to a pipeline.
#[derive(Clone, Debug)]
pub enum Event {
    /// The source has read something.
    Reading(Reading),
    /// The times of the readings that follow have nothing to do with those before.
    NewStretch,
    /// Nothing was read up to this time of the source's clock, seconds.
    Silence(f64),
    /// The source is broken, and this is what is wrong; `None` when it works again.
    Fault(Option<SourceFault>),
    /// A calibration is done.
    Calibrated(Box<Outcome>),
    /// When to calibrate without being asked.
    Policy(Policy),
    /// Calibrate on each motion until one is not refused, with policy `off` too.
    Start,
    /// Give up what was started, and a calibration that is under way.
    Cancel,
    /// Another calibration is active from now on, or none.
    Activate(Option<Box<Calibration>>),
    /// The chips' mounting is another from now on: the board was mounted differently, or is described better.
    Mounted(Box<Mountings>),
    /// The earth's field where the compass is; `None` where that is not known any more.
    Place(Option<EarthField>),
    /// Nothing follows: what is worth keeping is kept now.
    End,
}

/// What a pipeline wants done.
#[derive(Clone, Debug)]
#[must_use]
// Nearly every action is the largest.
#[expect(clippy::large_enum_variant)]
pub enum Action {
    /// Publish a heading.
    Publish(Heading),
    /// Publish a new condition.
    Report(Report),
    /// Tell the user this.
    Warn(String),
    /// A full turn was found: worth a line in the log.
    Turned(Turn),
    /// Calibrate, and bring the outcome back as an event.
    Calibrate(Box<Request>),
    /// Publish this outcome of a calibration of this origin; if it was accepted, keep its calibration.
    Conclude(Box<Outcome>, CalibrationOrigin),
}

/// A calibration under way.
#[derive(Clone, Copy, Debug)]
struct CalibrationJob {
    /// What asked for it.
    origin: CalibrationOrigin,
    /// Discard its outcome.
    unwanted: bool,
    /// Calibrate again when it ends: a turn was completed meanwhile.
    again: bool,
    /// The end of its last turn, seconds.
    end_s: f64,
}

/// Turns readings into headings, conditions and calibrations.
pub struct Pipeline {
    setup: Setup,
    intake: Intake,
    frozen_watch: FrozenWatch,
    /// A sensor that repeats its value while the board moves.
    frozen: Option<Frozen>,
    estimate: Estimate,
    learning: Learning,
    /// The newest sample that the estimate has taken.
    sample: Option<Sample>,
    buffer: VecDeque<FieldSample>,
    completed: VecDeque<Turn>,
    job: Option<CalibrationJob>,
    policy: Policy,
    /// [`Event::Start`] was asked for, and no motion has been taken since.
    armed: bool,
    refused: Option<Refusal>,
    fault: Option<SourceFault>,
    report: Option<Report>,
    times: StreamTimes,
    /// Time of the first reading and of the last.
    readings_s: Option<(f64, f64)>,
    /// Since when the first reading has been awaited, seconds: 0 at the start, infinite until a new stretch has a time.
    awaited_s: f64,
    /// Strength of the corrected field over the expected one, less 1, low-passed.
    strength_deviation: f64,
    /// Deviation of the heading of the newest sample, degrees; `UNKNOWN_SD_DEG` without a heading.
    sd_deg: f64,
    /// Whether body X was within 10° of the vertical at the newest sample: it has no heading.
    nose_vertical: bool,
    /// Whether a turn that was asked for is the estimate's rival, or has won and is not kept yet: it is tried in mode `off`, too.
    asked_for: bool,
    seq: u64,
}

/// When each of these last happened, seconds; −∞ if it has not since the stretch of readings began.
struct StreamTimes {
    now_s: f64,
    whole_field_s: f64,
    overflow_s: f64,
    /// The magnetometer read more than any chip measures.
    implausible_s: f64,
    rate_s: f64,
    /// The end of the last turn that was refused for its samples.
    bad_turn_s: f64,
    disturbed_s: f64,
    /// The newest sample in `strength_deviation`.
    strength_s: f64,
}

impl Default for StreamTimes {
    fn default() -> Self {
        Self {
            now_s: f64::NEG_INFINITY,
            whole_field_s: f64::NEG_INFINITY,
            overflow_s: f64::NEG_INFINITY,
            implausible_s: f64::NEG_INFINITY,
            rate_s: f64::NEG_INFINITY,
            bad_turn_s: f64::NEG_INFINITY,
            disturbed_s: f64::NEG_INFINITY,
            strength_s: f64::NEG_INFINITY,
        }
    }
}

impl Pipeline {
    /// A pipeline that starts with this calibration, or with none.
    pub fn new(setup: Setup, calibration: Option<Calibration>) -> Self {
        Self {
            intake: Intake::new(&setup, calibration.as_ref()),
            frozen_watch: FrozenWatch::default(),
            frozen: None,
            estimate: Estimate::new(setup.mountings.mag, calibration.as_ref()),
            learning: Learning::new(calibration),
            sample: None,
            setup,
            buffer: VecDeque::new(),
            completed: VecDeque::new(),
            job: None,
            policy: Policy::On,
            armed: false,
            refused: None,
            fault: None,
            report: None,
            times: StreamTimes::default(),
            readings_s: None,
            awaited_s: 0.0,
            strength_deviation: 0.0,
            sd_deg: UNKNOWN_SD_DEG,
            nose_vertical: false,
            asked_for: false,
            seq: 0,
        }
    }

    /// Takes an event, and appends what is to be done.
    pub fn handle(&mut self, event: Event, actions: &mut Vec<Action>) {
        match event {
            Event::Reading(reading) => self.read(&reading, actions),
            Event::NewStretch => self.begin_stretch(),
            Event::Silence(t_s) => {
                if t_s > self.times.now_s {
                    self.times.now_s = t_s;
                    self.awaited_s = self.awaited_s.min(t_s);
                    self.update_condition(actions);
                }
            }
            Event::Fault(fault) => {
                self.fault = fault;
                self.update_condition(actions);
            }
            Event::Calibrated(outcome) => self.conclude(outcome, actions),
            Event::Policy(policy) => self.set_policy(policy, actions),
            Event::Start => self.start(actions),
            Event::Cancel => self.cancel(actions),
            Event::Activate(calibration) => self.activate(calibration.map(|one| *one), actions),
            Event::Mounted(mountings) => self.mount(*mountings),
            Event::Place(field) => self.estimate.put_place(field.as_ref()),
            Event::End => self.conclude_motion(true, actions),
        }
    }

    /// Takes an event. `carry_out` carries an action out; what comes of it, such as the outcome of a calibration, is the next event. The
    /// end of a calibration may ask for the next one, so this repeats until no action is left.
    ///
    /// # Errors
    ///
    /// Those of `carry_out`, which end it.
    pub fn play<E>(
        &mut self,
        event: Event,
        mut carry_out: impl FnMut(Action) -> Result<Option<Event>, E>,
    ) -> Result<(), E> {
        let mut actions = Vec::new();
        self.handle(event, &mut actions);
        while !actions.is_empty() {
            let mut events = Vec::new();
            for action in actions.drain(..) {
                events.extend(carry_out(action)?);
            }
            for event in events {
                self.handle(event, &mut actions);
            }
        }
        Ok(())
    }

    /// The calibration that is active: what the estimate knows, once that is worth a heading.
    pub fn calibration(&self) -> Option<Calibration> {
        if !self.learning.calibrated {
            return None;
        }
        self.learnt_calibration().or(self.learning.initial)
    }

    /// Whether a calibration is under way.
    pub fn is_calibrating(&self) -> bool {
        self.job.is_some()
    }

    /// Whether a calibration is under way whose outcome will be discarded.
    pub fn has_given_up(&self) -> bool {
        self.job.is_some_and(|job| job.unwanted)
    }

    /// How much of a full turn is completed, 0 to 1; not known while the source or the magnetometer is silent.
    pub fn progress(&self) -> Option<f64> {
        let condition = self.report.as_ref()?.condition;
        let silent = matches!(condition, Condition::Stale | Condition::Fault);
        (!silent).then(|| self.intake.turns.progress())
    }

    /// How many values were dropped since no sensor can have taken them.
    pub fn dropped(&self) -> Dropped {
        self.intake.outliers.dropped()
    }

    fn read(&mut self, reading: &Reading, actions: &mut Vec<Action>) {
        // Within a stretch, sources give rising times. A reading that goes back is dropped; one that is merely older than a
        // reported silence is not.
        let (first_s, last_s) = self.readings_s.unwrap_or((reading.t_s, reading.t_s));
        if reading.t_s < last_s || !reading.t_s.is_finite() {
            return;
        }
        let mut turn = None;
        let newest_turn = |_: &_, ended: Option<Turn>| turn = ended.or(turn.take());
        let read_field = reading.field_mgauss.is_some();
        let (reading, runs) = &self.intake.take(reading, newest_turn);
        if read_field && reading.field_mgauss.is_none() {
            self.times.implausible_s = reading.t_s;
        }
        for (axis, run) in runs.iter().enumerate() {
            match run {
                RunState::NoRun => self.estimate.drop_checkpoint(axis),
                RunState::Begun => self.estimate.set_checkpoint(axis),
                RunState::Running => {}
                RunState::Saturated => self.estimate.go_back(axis),
            }
        }
        self.frozen = self.frozen_watch.take(reading, &self.setup.mountings);
        if self.frozen_watch.take_accelerometer_resumed() {
            self.renew_attitude();
        }
        self.readings_s = Some((first_s, reading.t_s));
        self.times.now_s = reading.t_s;
        if reading.rate_rad_s.is_some() {
            self.times.rate_s = reading.t_s;
        }
        let field = reading.whole_field_mgauss();
        let measured_s = field.and_then(|field| self.intake.measured_s(reading.t_s, field));
        if let (Some(field), Some(measured_s)) = (field, measured_s) {
            self.buffer_sample(measured_s, field);
        }
        if let Some(turn) = turn {
            self.turned(turn, actions);
        }
        if let Some(field) = field {
            self.times.whole_field_s = reading.t_s;
            self.publish(reading.t_s, &field, measured_s, actions);
        } else if reading.field_mgauss.is_some() {
            self.times.overflow_s = reading.t_s;
            self.publish_without_field(reading.t_s, actions);
        } else {
            self.update_condition(actions);
        }
    }
}
