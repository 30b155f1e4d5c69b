//! The whole journey of a reading, as a pure state machine: an event in, actions out.
//!
//! No clock, no file, no thread: time comes with the events, and what takes long or touches the world
//! goes out as an action. A calibration is an action whose outcome comes back as an event: live, when
//! the worker has finished; in a replay, before the next reading.

mod fitness;
mod force;
mod occasion;
mod settings;
mod stretch;

use std::collections::VecDeque;

use nalgebra::Vector3;

use crate::attitude::{self, Attitude, Tilt};
use crate::calibration::model::Calibration;
use crate::calibration::outcome::Outcome;
use crate::calibration::policy::{Policy, Reason};
use crate::calibration::{self, Request, Sample, verdict};
use crate::condition::{self, Condition, Evidence, Report, Trouble};
use crate::frame::{Mountings, wrap_360};
use crate::frozen::{Frozen, FrozenWatch};
use crate::heading::{Compass, Heading, MagStatus, heading_deg};
use crate::outliers::Outliers;
use crate::reading::Reading;
use crate::turn::{self, Turn, TurnDetector};
use fitness::Fitness;

pub use settings::Settings;

/// Time over which the field's strength is smoothed before it is called disturbed, seconds.
const STRENGTH_TAU_S: f64 = 0.5;

/// A field that a tilt out of a planar calibration's plane makes less certain than this is not fused, radians;
/// the gyro carries on.
const FUSED_TILT_SD_RAD: f64 = 0.1;

/// One that is less certain than this gives no heading at all, radians.
const HEADING_TILT_SD_RAD: f64 = 0.35;

/// How fast a heading that the gyro carries alone becomes uncertain, degrees a second: a bias not quite learnt.
const GYRO_DRIFT_DEG_S: f64 = 0.2;

/// The gyro alone carries a fused heading this long, seconds.
const GYRO_ALONE_S: f64 = 30.0;

/// How often free motion is looked for, seconds, and how long not after it led to nothing.
const FREE_CHECK_S: f64 = 5.0;
const FREE_PAUSE_S: f64 = 20.0;

/// Progress is news when it has changed by this share of a turn …
const PROGRESS_STEP: f64 = 0.05;

/// … and this much later than the last news of it, seconds.
const PROGRESS_EVERY_S: f64 = 0.25;

/// A new calibration that turns the heading by more starts its fusion anew, degrees.
const RESTART_DEG: f64 = 3.0;

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
    /// It is this late on the source's clock, seconds, and nothing was read.
    Silence(f64),
    /// The source is broken, and this is what is wrong; `None` when it works again.
    Fault(Option<Trouble>),
    /// A calibration is done.
    Calibrated(Box<Outcome>),
    /// Calibrate by itself, or not, or never again.
    Policy(Policy),
    /// Calibrate on the next motion, whatever the policy, until that gives an answer.
    Start,
    /// Give up what was started, and a calibration that is under way.
    Cancel,
    /// Another calibration is in force from now on, or none.
    InForce(Option<Calibration>),
}

/// What a pipeline wants done.
#[derive(Clone, Debug)]
#[must_use]
pub enum Action {
    /// Publish a heading.
    Publish(Heading),
    /// Publish a new condition.
    Report(Report),
    /// A full turn was found: worth a line in the log.
    Turned(Turn),
    /// Calibrate, and bring the outcome back as an event.
    Calibrate(Box<Request>),
    /// Publish this outcome; if it was accepted, keep its calibration.
    Conclude(Box<Outcome>),
}

/// The state of the journey.
pub struct Pipeline {
    setup: Setup,
    outliers: Outliers,
    frozen_watch: FrozenWatch,
    /// A sensor that says the same again and again while the board moves.
    frozen: Option<Trouble>,
    attitude: Attitude,
    turns: TurnDetector,
    compass: Option<Compass>,
    buffer: VecDeque<Sample>,
    made: VecDeque<Turn>,
    /// Turns found while a calibration was under way wait for its end.
    waiting: bool,
    calibrating: bool,
    /// Why the calibration under way, or the last one, was asked for.
    asked: Reason,
    /// Its outcome, when it comes, is not wanted any more.
    unwanted: bool,
    policy: Policy,
    /// The next motion is to be calibrated on.
    armed: bool,
    fitness: Fitness,
    refused: Option<(&'static str, String)>,
    fault: Option<Trouble>,
    report: Option<Report>,
    now_s: f64,
    /// Time of the first reading and of the last.
    readings_s: Option<(f64, f64)>,
    whole_field_s: f64,
    overflow_s: f64,
    rate_s: f64,
    fused_s: f64,
    fused_sd_deg: f64,
    free_check_s: f64,
    strength_deviation: f64,
    tilt_sd_rad: f64,
    seq: u64,
}

impl Pipeline {
    /// A pipeline that starts with this calibration, or with none.
    pub fn new(setup: Setup, calibration: Option<Calibration>) -> Self {
        Self {
            outliers: Outliers::new(setup.attitude.gyro_range_deg_s),
            frozen_watch: FrozenWatch::default(),
            frozen: None,
            attitude: Attitude::new(&setup.attitude, &setup.mountings),
            turns: TurnDetector::new(&setup.turn),
            compass: calibration.map(|calibration| Compass::new(calibration, setup.mountings.mag)),
            setup,
            buffer: VecDeque::new(),
            made: VecDeque::new(),
            waiting: false,
            calibrating: false,
            asked: Reason::Turn,
            unwanted: false,
            policy: Policy::On,
            armed: false,
            fitness: Fitness::default(),
            refused: None,
            fault: None,
            report: None,
            now_s: f64::NEG_INFINITY,
            readings_s: None,
            whole_field_s: f64::NEG_INFINITY,
            overflow_s: f64::NEG_INFINITY,
            rate_s: f64::NEG_INFINITY,
            fused_s: f64::NEG_INFINITY,
            fused_sd_deg: 0.0,
            free_check_s: f64::NEG_INFINITY,
            strength_deviation: 0.0,
            tilt_sd_rad: 0.0,
            seq: 0,
        }
    }

    /// Takes an event, and appends what is to be done.
    pub fn handle(&mut self, event: Event, actions: &mut Vec<Action>) {
        match event {
            Event::Reading(reading) => self.read(&reading, actions),
            Event::NewStretch => self.begin_stretch(),
            Event::Silence(t_s) => {
                if t_s > self.now_s {
                    self.now_s = t_s;
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
            Event::InForce(calibration) => self.put_in_force(calibration, actions),
        }
    }

    /// The calibration in force.
    pub fn calibration(&self) -> Option<&Calibration> {
        self.compass.as_ref().map(Compass::calibration)
    }

    /// Why the last calibration was asked for.
    pub fn reason(&self) -> Reason {
        self.asked
    }

    /// How many values were dropped since no sensor can have taken them.
    pub fn dropped(&self) -> u64 {
        self.outliers.dropped()
    }

    /// Whether a calibration is under way.
    pub fn is_calibrating(&self) -> bool {
        self.calibrating
    }

    /// How much of a full turn has been made, 0 to 1; not known while the source or the magnetometer is silent.
    pub fn progress(&self) -> Option<f64> {
        let condition = self.report.as_ref()?.condition;
        let silent = matches!(condition, Condition::Stale | Condition::Fault);
        (!silent).then(|| self.turns.progress())
    }

    /// What was reported last.
    pub fn report(&self) -> Option<&Report> {
        self.report.as_ref()
    }

    fn read(&mut self, reading: &Reading, actions: &mut Vec<Action>) {
        // Sources see to it that time does not go back, or begin a new stretch; a reading that does so has no place in the buffer.
        // One that was only late, so that silence was told before it came, has.
        let (first_s, last_s) = self.readings_s.unwrap_or((reading.t_s, reading.t_s));
        if reading.t_s < last_s || !reading.t_s.is_finite() {
            return;
        }
        let reading = &self.outliers.filter(reading);
        self.watch(reading);
        self.readings_s = Some((first_s, reading.t_s));
        self.now_s = reading.t_s;
        if reading.rate_rad_s.is_some() {
            self.rate_s = reading.t_s;
        }
        let mut made = None;
        let turns = &mut self.turns;
        self.attitude
            .take(reading, |tick| made = turns.tick(tick).or(made.take()));
        if let Some(field) = reading.whole_field_mgauss() {
            self.buffer_sample(reading.t_s, field);
        }
        if let Some(turn) = made {
            self.turned(turn, actions);
        } else if reading.t_s - self.free_check_s >= FREE_CHECK_S {
            self.free_check_s = reading.t_s;
            self.look_for_free_motion(actions);
        }
        if reading.field_mgauss.is_none() {
            self.update_condition(actions);
            return;
        }
        match reading.whole_field_mgauss() {
            Some(field) => {
                self.whole_field_s = reading.t_s;
                self.publish(reading.t_s, &field, actions);
            }
            None => {
                self.overflow_s = reading.t_s;
                self.update_condition(actions);
                self.publish_without_field(reading.t_s, actions);
            }
        }
    }

    /// Looks whether a sensor says the same again and again.
    fn watch(&mut self, reading: &Reading) {
        let found = self.frozen_watch.take(reading);
        if found.map(Frozen::code) != self.frozen.as_ref().map(|frozen| frozen.code) {
            self.frozen = found.map(|frozen| Trouble {
                code: frozen.code(),
                message: frozen.message().to_owned(),
            });
        }
    }

    fn publish(&mut self, t_s: f64, raw: &Vector3<f64>, actions: &mut Vec<Action>) {
        let down = self.attitude.down(t_s);
        let samples = self.buffer.iter().rev().take(2).map(|sample| sample.t_s);
        let period_s = samples.reduce(|newer, older| newer - older).unwrap_or(0.0);
        if let Some(compass) = &mut self.compass {
            compass.learn(raw, down.as_ref(), period_s);
        }
        let corrected = self
            .compass
            .map(|compass| (compass, compass.correct(raw, down.as_ref())));
        if let Some((compass, corrected)) = &corrected {
            let gain = period_s / (period_s + STRENGTH_TAU_S);
            let deviation = compass.strength_deviation(corrected);
            self.strength_deviation += gain * (deviation - self.strength_deviation);
            self.tilt_sd_rad = corrected.tilt_sd_rad;
            if corrected.tilt_sd_rad < FUSED_TILT_SD_RAD {
                self.attitude.fuse(t_s, corrected.field_body);
                self.fused_s = t_s;
            }
        }
        if let Some((compass, corrected)) = &corrected {
            self.hold_against(t_s, compass, corrected, down.as_ref());
        }
        let condition = self.update_condition(actions);
        let raw_body = self.setup.mountings.mag.to_body(*raw);
        let mut heading = self.heading(t_s, down.as_ref(), condition);
        heading.raw_deg = heading_deg(&raw_body, &down.unwrap_or_else(Vector3::z));
        if let Some((compass, corrected)) = &corrected {
            let sd_deg = compass.sd_deg(corrected, down.as_ref());
            if corrected.tilt_sd_rad < HEADING_TILT_SD_RAD {
                heading.instantaneous_deg = compass.heading_deg(corrected, down.as_ref());
                heading.sd_deg = Some(sd_deg);
            }
            let alone_s = t_s - self.fused_s;
            if alone_s < GYRO_ALONE_S {
                let fused = self.attitude.fused_heading_rad(t_s);
                heading.fused_deg = fused.map(|heading| wrap_360(heading.to_degrees()));
            }
            if alone_s == 0.0 {
                self.fused_sd_deg = sd_deg;
            } else if heading.fused_deg.is_some() {
                heading.sd_deg = Some(self.fused_sd_deg.hypot(GYRO_DRIFT_DEG_S * alone_s));
            }
            heading.field_mgauss = Some(compass.published_field(corrected));
            heading.strength_mgauss = Some(corrected.strength_mgauss);
            heading.mag_status = match condition {
                Condition::Degraded if self.fitness.is_misfit() => MagStatus::Calibration,
                Condition::Disturbed if self.strength_deviation > 0.0 => MagStatus::HighField,
                Condition::Disturbed => MagStatus::LowField,
                _ => MagStatus::Normal,
            };
        }
        actions.push(Action::Publish(heading));
    }

    /// A reading that overflowed still counts and still tells the tilt, but no field and no heading.
    fn publish_without_field(&mut self, t_s: f64, actions: &mut Vec<Action>) {
        let condition = self
            .report
            .as_ref()
            .map_or(Condition::Stale, |report| report.condition);
        let down = self.attitude.down(t_s);
        let mut heading = self.heading(t_s, down.as_ref(), condition);
        heading.mag_status = MagStatus::HighField;
        actions.push(Action::Publish(heading));
    }

    fn heading(&mut self, t_s: f64, down: Option<&Vector3<f64>>, condition: Condition) -> Heading {
        self.seq += 1;
        let tilt = down.map(Tilt::of_down);
        Heading {
            seq: self.seq,
            t_s,
            condition,
            fused_deg: None,
            instantaneous_deg: None,
            raw_deg: None,
            sd_deg: None,
            pitch_deg: tilt.map(|tilt| tilt.pitch_rad.to_degrees()),
            roll_deg: tilt.map(|tilt| tilt.roll_rad.to_degrees()),
            field_mgauss: None,
            strength_mgauss: None,
            mag_status: MagStatus::Calibration,
        }
    }

    fn update_condition(&mut self, actions: &mut Vec<Action>) -> Condition {
        // A magnetometer that has not had the time to speak is not silent. Before the first reading time counts from 0.
        let first_s = self.readings_s.map_or(0.0, |(first_s, _)| first_s);
        let beginning = self.whole_field_s.max(self.overflow_s) < first_s
            && self.now_s - first_s <= self.setup.pipeline.stale_s;
        let fault = self.fault.as_ref().or(self.frozen.as_ref());
        if beginning && fault.is_none() {
            return Condition::Stale;
        }
        let report = condition::judge(&Evidence {
            t_s: self.now_s,
            fault,
            silent_s: self.now_s - self.whole_field_s,
            overflowing: self.overflow_s > self.whole_field_s,
            stale_s: self.setup.pipeline.stale_s,
            calibrated: self.compass.is_some(),
            calibrating: self.calibrating && !self.unwanted,
            wanted: self.wanted().is_some(),
            misfit: self.fitness.is_misfit(),
            locked: self.policy == Policy::Locked,
            progress: self.turns.progress(),
            refused: self
                .refused
                .as_ref()
                .map(|(reason, message)| (*reason, message.as_str())),
            strength_deviation: self.strength_deviation,
            strength_tolerance: self.setup.pipeline.strength_tolerance,
            field_disturbed: self.attitude.disturbed(),
            tilt_sd_rad: self.tilt_sd_rad,
            tilt_known: self.attitude.down_known(self.now_s),
            gyro_speaks: self.now_s - self.rate_s <= self.setup.attitude.gap_s,
        });
        let condition = report.condition;
        let news = self.report.as_ref().is_none_or(|last| {
            let progressed = match (last.progress, report.progress) {
                (Some(old), Some(new)) => {
                    (new - old).abs() >= PROGRESS_STEP && report.t_s - last.t_s >= PROGRESS_EVERY_S
                }
                _ => false,
            };
            (last.condition, last.reason) != (condition, report.reason) || progressed
        });
        if news {
            self.report = Some(report.clone());
            actions.push(Action::Report(report));
        }
        condition
    }
}
