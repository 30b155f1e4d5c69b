//! The whole journey of a reading, as a pure state machine: an event in, actions out.
//!
//! No clock, no file, no thread: time comes with the events, and what takes long or touches the world
//! goes out as an action. A calibration is an action whose outcome comes back as an event: live, when
//! the worker has finished; in a replay, before the next reading.

use std::collections::VecDeque;

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use crate::attitude::{self, Attitude};
use crate::calibration::coverage::sphere_share;
use crate::calibration::model::{Calibration, Mode};
use crate::calibration::outcome::{Outcome, Verdict};
use crate::calibration::settings::ModeChoice;
use crate::calibration::{self, Request, Sample, TurnMade, verdict};
use crate::check::{Check, Fault, within};
use crate::condition::{self, Condition, Evidence, Report};
use crate::frame::{Mountings, wrap_360};
use crate::heading::{Compass, Heading, MagStatus, heading_deg};
use crate::reading::Reading;
use crate::turn::{self, Turn, TurnDetector};

/// No magnetometer on a board this size is faster; more samples than this a second of buffer are dropped.
const FASTEST_MAG_HZ: f64 = 200.0;

/// Time over which the field's strength is smoothed before it is called disturbed, seconds.
const STRENGTH_TAU_S: f64 = 0.5;

/// Turns that follow each other within this time and about the same axis calibrate together, seconds.
const TURNS_FOLLOW_S: f64 = 3.0;

/// A field that a tilt out of a planar calibration's plane makes less certain than this is not fused, radians;
/// the gyro carries on.
const FUSED_TILT_SD_RAD: f64 = 0.1;

/// One that is less certain than this gives no heading at all, radians.
const HEADING_TILT_SD_RAD: f64 = 0.35;

/// The gyro alone carries a fused heading this long, seconds.
const GYRO_ALONE_S: f64 = 30.0;

/// How often free motion is looked for, seconds, and how long not after it led to nothing.
const FREE_CHECK_S: f64 = 5.0;
const FREE_PAUSE_S: f64 = 20.0;

/// Free motion swings every axis by this much either way, milligauss: nowhere on earth is the field below 220.
const FREE_RANGE_MGAUSS: f64 = 100.0;

/// Progress is news when it has changed by this share of a turn …
const PROGRESS_STEP: f64 = 0.05;

/// … and this much later than the last news of it, seconds.
const PROGRESS_EVERY_S: f64 = 0.25;

/// The most turns that calibrate together: as in the paper's tests. More would make every further turn of
/// a board that keeps turning dearer than the one before.
const TURNS_TOGETHER: usize = 2;

/// A planar calibration is of use for headings only if its turn was about the vertical, within this angle.
const LEVEL_TURN_DEG: f64 = 30.0;

/// A new calibration that turns the heading by more starts its fusion anew, degrees.
const RESTART_DEG: f64 = 3.0;

/// Settings of the pipeline itself; those of its rooms stand with them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// A magnetometer sample older than this is stale, and no heading is published: 0.1 to 10 seconds.
    pub stale_s: f64,
    /// Samples are kept this long for a calibration, and so the first of two turns may be this old:
    /// 10 to 600 seconds.
    pub buffer_s: f64,
    /// A field whose strength is off by more than this share of what the calibration expects is
    /// called disturbed: 0.02 to 1.
    pub strength_tolerance: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            stale_s: 0.5,
            buffer_s: 120.0,
            strength_tolerance: 0.15,
        }
    }
}

impl Check for Settings {
    fn check(&self) -> Vec<Fault> {
        let mut faults = Vec::new();
        within(&mut faults, "stale_s", self.stale_s, 0.1..=10.0, "seconds");
        within(
            &mut faults,
            "buffer_s",
            self.buffer_s,
            10.0..=600.0,
            "seconds",
        );
        within(
            &mut faults,
            "strength_tolerance",
            self.strength_tolerance,
            0.02..=1.0,
            "of the field",
        );
        faults
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
    /// It is this late on the source's clock, seconds, and nothing was read.
    Silence(f64),
    /// The source is broken, and this is what is wrong; `None` when it works again.
    Fault(Option<String>),
    /// A calibration is done.
    Calibrated(Box<Outcome>),
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
    attitude: Attitude,
    turns: TurnDetector,
    compass: Option<Compass>,
    buffer: VecDeque<Sample>,
    made: VecDeque<Turn>,
    /// Turns found while a calibration was under way wait for its end.
    waiting: bool,
    calibrating: bool,
    refused: Option<(&'static str, String)>,
    fault: Option<String>,
    report: Option<Report>,
    now_s: f64,
    /// Time of the first reading and of the last.
    readings_s: Option<(f64, f64)>,
    whole_field_s: f64,
    overflow_s: f64,
    rate_s: f64,
    fused_s: f64,
    free_check_s: f64,
    strength_deviation: f64,
    tilt_sd_rad: f64,
    seq: u64,
}

impl Pipeline {
    /// A pipeline that starts with this calibration, or with none.
    pub fn new(setup: Setup, calibration: Option<Calibration>) -> Self {
        Self {
            attitude: Attitude::new(&setup.attitude, &setup.mountings),
            turns: TurnDetector::new(&setup.turn),
            compass: calibration.map(|calibration| Compass::new(calibration, setup.mountings.mag)),
            setup,
            buffer: VecDeque::new(),
            made: VecDeque::new(),
            waiting: false,
            calibrating: false,
            refused: None,
            fault: None,
            report: None,
            now_s: f64::NEG_INFINITY,
            readings_s: None,
            whole_field_s: f64::NEG_INFINITY,
            overflow_s: f64::NEG_INFINITY,
            rate_s: f64::NEG_INFINITY,
            fused_s: f64::NEG_INFINITY,
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
        }
    }

    /// The calibration in force.
    pub fn calibration(&self) -> Option<&Calibration> {
        self.compass.as_ref().map(Compass::calibration)
    }

    fn read(&mut self, reading: &Reading, actions: &mut Vec<Action>) {
        // Sources see to it that time does not go back; a reading that does so has no place in the buffer.
        // One that was only late, so that silence was told before it came, has.
        let (first_s, last_s) = self.readings_s.unwrap_or((reading.t_s, reading.t_s));
        if reading.t_s < last_s || !reading.t_s.is_finite() {
            return;
        }
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

    fn buffer_sample(&mut self, t_s: f64, field_mgauss: Vector3<f64>) {
        let pose = self.attitude.pose_at(t_s);
        self.buffer.push_back(Sample {
            t_s,
            field_mgauss,
            pose,
        });
        let oldest_s = t_s - self.setup.pipeline.buffer_s;
        let most = (self.setup.pipeline.buffer_s * FASTEST_MAG_HZ) as usize;
        while self
            .buffer
            .front()
            .is_some_and(|sample| sample.t_s < oldest_s)
            || self.buffer.len() > most
        {
            self.buffer.pop_front();
        }
        while self
            .made
            .front()
            .is_some_and(|turn| turn.start_s < oldest_s)
        {
            self.made.pop_front();
        }
    }

    fn turned(&mut self, turn: Turn, actions: &mut Vec<Action>) {
        self.made.push_back(turn);
        actions.push(Action::Turned(turn));
        if self.calibrating {
            self.waiting = true;
        } else {
            self.ask_for_calibration(actions);
        }
    }

    /// Asks for a calibration on the turns just made, if they allow one.
    fn ask_for_calibration(&mut self, actions: &mut Vec<Action>) {
        let Some(request) = self.request() else {
            return;
        };
        self.calibrating = true;
        actions.push(Action::Calibrate(Box::new(request)));
    }

    fn request(&self) -> Option<Request> {
        let last = self.made.back()?;
        let all: Vec<TurnMade> = self.made.iter().map(|turn| self.samples_of(turn)).collect();
        let settings = &self.setup.calibration;
        let spatial = settings.mode != ModeChoice::Planar
            && calibration::plane::axes_apart_deg(&all) >= settings.axes_apart_deg;
        let first = if spatial {
            0
        } else {
            let tolerance = self.setup.turn.axis_tolerance_deg.to_radians().cos();
            let follows = |pair: (&Turn, &Turn)| {
                pair.1.start_s - pair.0.end_s < TURNS_FOLLOW_S
                    && pair.0.axis_body.dot(&pair.1.axis_body).abs() > tolerance
            };
            let turns: Vec<&Turn> = self.made.iter().collect();
            let count = turns
                .windows(2)
                .rev()
                .take(TURNS_TOGETHER - 1)
                .take_while(|w| follows((w[0], w[1])))
                .count();
            let level = last
                .from_vertical_deg
                .is_none_or(|angle| angle < LEVEL_TURN_DEG);
            if settings.mode == ModeChoice::Spatial || !level {
                return None;
            }
            turns.len() - 1 - count
        };
        let turns = &all[first..];
        let (start, end) = (turns.first()?.samples.start, turns.last()?.samples.end);
        Some(Request {
            moving: 0..end - start,
            samples: self.buffer.range(start..end).copied().collect(),
            turns: turns
                .iter()
                .map(|turn| TurnMade {
                    samples: turn.samples.start - start..turn.samples.end - start,
                    axis_body: turn.axis_body,
                })
                .collect(),
            plane: None,
            mounting: self.setup.mountings.mag,
            in_force: self.calibration().copied(),
            settings: settings.clone(),
            limits: self.setup.verdict.clone(),
        })
    }

    /// Free motion that has shown the field from all sides does as well as turns about two axes.
    fn look_for_free_motion(&mut self, actions: &mut Vec<Action>) {
        let spatial = self
            .calibration()
            .is_some_and(|c| c.parameters.mode() == Mode::Spatial);
        let allowed = self.setup.calibration.mode != ModeChoice::Planar;
        if self.calibrating || spatial || !allowed || self.buffer.is_empty() {
            return;
        }
        let fields = self.buffer.iter().map(|sample| sample.field_mgauss);
        let low = fields.clone().reduce(|a, b| a.inf(&b)).unwrap_or_default();
        let high = fields.clone().reduce(|a, b| a.sup(&b)).unwrap_or_default();
        let middle = 0.5 * (low + high);
        let half = 0.5 * (high - low);
        if half.min() < FREE_RANGE_MGAUSS || half.min() < 0.4 * half.max() {
            return;
        }
        if sphere_share(fields.map(|field| field - middle)) < self.setup.verdict.sphere_share {
            return;
        }
        let settings = calibration::settings::Settings {
            mode: ModeChoice::Spatial,
            ..self.setup.calibration.clone()
        };
        self.calibrating = true;
        actions.push(Action::Calibrate(Box::new(Request {
            samples: self.buffer.iter().copied().collect(),
            moving: 0..self.buffer.len(),
            turns: Vec::new(),
            plane: None,
            mounting: self.setup.mountings.mag,
            in_force: self.calibration().copied(),
            settings,
            limits: self.setup.verdict.clone(),
        })));
    }

    fn samples_of(&self, turn: &Turn) -> TurnMade {
        let start = self
            .buffer
            .partition_point(|sample| sample.t_s < turn.start_s);
        let end = self
            .buffer
            .partition_point(|sample| sample.t_s <= turn.end_s);
        TurnMade {
            samples: start..end,
            axis_body: turn.axis_body,
        }
    }

    fn conclude(&mut self, outcome: Box<Outcome>, actions: &mut Vec<Action>) {
        self.calibrating = false;
        match (outcome.verdict, outcome.calibration) {
            (Verdict::Accepted, Some(calibration)) => {
                let new = Compass::new(calibration, self.setup.mountings.mag);
                // A fusion that begins anew follows the field closely at first, tilts and all.
                if self
                    .turned_by_deg(&new)
                    .is_none_or(|turned| turned > RESTART_DEG)
                {
                    self.attitude.restart_fusion();
                }
                self.compass = Some(new);
                self.strength_deviation = 0.0;
                self.refused = None;
            }
            (Verdict::Kept, _) => self.refused = None,
            _ => {
                self.refused = Some((outcome.reason, outcome.message.clone()));
                self.free_check_s = self.now_s + FREE_PAUSE_S;
            }
        }
        actions.push(Action::Conclude(outcome));
        if std::mem::take(&mut self.waiting) {
            self.ask_for_calibration(actions);
        }
        self.update_condition(actions);
    }

    /// How far this calibration turns the heading of the newest sample, degrees, if there is one in force.
    fn turned_by_deg(&self, new: &Compass) -> Option<f64> {
        let sample = self.buffer.back()?;
        let down = self.down(sample.t_s);
        let heading = |compass: &Compass| {
            let corrected = compass.correct(&sample.field_mgauss, down.as_ref());
            compass.heading_deg(&corrected, down.as_ref())
        };
        let turned = wrap_360(heading(new)? - heading(self.compass.as_ref()?)?);
        Some(turned.min(360.0 - turned))
    }

    /// The direction of down in body axes, if the tilt is known.
    fn down(&self, t_s: f64) -> Option<Vector3<f64>> {
        let tilt = self.attitude.tilt(t_s)?;
        let (sin_pitch, cos_pitch) = tilt.pitch_rad.sin_cos();
        let (sin_roll, cos_roll) = tilt.roll_rad.sin_cos();
        Some(Vector3::new(
            -sin_pitch,
            cos_pitch * sin_roll,
            cos_pitch * cos_roll,
        ))
    }

    fn publish(&mut self, t_s: f64, raw: &Vector3<f64>, actions: &mut Vec<Action>) {
        let down = self.down(t_s);
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
        let condition = self.update_condition(actions);
        let raw_body = self.setup.mountings.mag.to_body(*raw);
        let mut heading = self.heading(t_s, condition);
        heading.raw_deg = heading_deg(&raw_body, &down.unwrap_or_else(Vector3::z));
        if let Some((compass, corrected)) = &corrected {
            if corrected.tilt_sd_rad < HEADING_TILT_SD_RAD {
                heading.instantaneous_deg = compass.heading_deg(corrected, down.as_ref());
            }
            if t_s - self.fused_s < GYRO_ALONE_S {
                let fused = self.attitude.fused_heading_rad(t_s);
                heading.fused_deg = fused.map(|heading| wrap_360(heading.to_degrees()));
            }
            heading.sd_deg = Some(compass.sd_deg(corrected, down.as_ref()));
            heading.field_mgauss = Some(compass.published_field(corrected));
            heading.strength_mgauss = Some(corrected.strength_mgauss);
            heading.mag_status = match condition {
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
        let mut heading = self.heading(t_s, condition);
        heading.mag_status = MagStatus::HighField;
        actions.push(Action::Publish(heading));
    }

    fn heading(&mut self, t_s: f64, condition: Condition) -> Heading {
        self.seq += 1;
        let tilt = self.attitude.tilt(t_s);
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
        // A magnetometer that has not had the time to speak is not silent.
        let beginning = self.readings_s.is_some_and(|(first_s, _)| {
            self.whole_field_s.max(self.overflow_s) < first_s
                && self.now_s - first_s <= self.setup.pipeline.stale_s
        });
        if beginning && self.fault.is_none() {
            return Condition::Stale;
        }
        let report = condition::judge(&Evidence {
            t_s: self.now_s,
            fault: self.fault.as_deref(),
            silent_s: self.now_s - self.whole_field_s,
            overflowing: self.overflow_s > self.whole_field_s,
            stale_s: self.setup.pipeline.stale_s,
            calibrated: self.compass.is_some(),
            calibrating: self.calibrating,
            progress: self.turns.progress(),
            refused: self
                .refused
                .as_ref()
                .map(|(reason, message)| (*reason, message.as_str())),
            strength_deviation: self.strength_deviation,
            strength_tolerance: self.setup.pipeline.strength_tolerance,
            field_disturbed: self.attitude.disturbed(),
            tilt_sd_rad: self.tilt_sd_rad,
            tilt_known: self.attitude.tilt(self.now_s).is_some(),
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
