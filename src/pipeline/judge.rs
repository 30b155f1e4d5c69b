//! Judges the condition from all that the pipeline knows, and tells which report is news.

use std::borrow::Cow;

use super::{Action, Pipeline};
use crate::calibration::policy::Policy;
use crate::calibration::verdict::Refusal;
use crate::condition::{Condition, Report};
use crate::estimate::GyroFault;
use crate::outliers::LARGEST_FIELD_MGAUSS;
use crate::reading::{STRONGEST_MGAUSS, WEAKEST_MGAUSS};

/// A field that was disturbed is called so until it has been calm for this long, seconds.
const CALM_S: f64 = 3.0;
/// A rotation this far along is called a turn.
const TURNING_FROM: f64 = 0.1;
/// Progress is news when it has changed by this share.
const PROGRESS_STEP: f64 = 0.05;
/// Least time between two reports of progress, seconds.
const PROGRESS_EVERY_S: f64 = 0.25;
/// Largest share by which the strength may differ from the expected one. Beyond it the reason is `field_strength`, else
/// `field_changed`.
const STRENGTH_TOLERANCE: f64 = 0.15;

impl Pipeline {
    /// Judges the condition anew, and reports it if that is news.
    pub(super) fn update_condition(&mut self, actions: &mut Vec<Action>) -> Condition {
        // A magnetometer that has had no time to give a reading is not silent.
        let first_s = self
            .readings_s
            .map_or(self.awaited_s, |(first_s, _)| first_s);
        let beginning = self.times.whole_field_s.max(self.times.overflow_s) < first_s
            && self.times.now_s - first_s <= self.setup.pipeline.stale_s;
        if beginning && self.fault.is_none() && self.frozen.is_none() {
            return Condition::Stale;
        }
        let report = self.judge();
        let condition = report.condition;
        let news = self.report.as_ref().is_none_or(|last| {
            let step = last.progress.zip(report.progress);
            let progressed = step.is_some_and(|(old, new)| (new - old).abs() >= PROGRESS_STEP)
                && report.t_s - last.t_s >= PROGRESS_EVERY_S;
            (last.condition, last.reason) != (condition, report.reason) || progressed
        });
        if news {
            self.report = Some(report.clone());
            actions.push(Action::Report(report));
        }
        condition
    }

    /// The first condition that applies, worst first.
    pub(super) fn judge(&self) -> Report {
        if let Some(fault) = &self.fault {
            return self.report_as(Condition::Fault, fault.code, fault.message.clone());
        }
        if let Some((reason, message)) = self.frozen {
            return self.report_as(Condition::Fault, reason, message);
        }
        if let Some(message) = self.wrong_unit() {
            return self.report_as(Condition::Fault, "field_unit", message);
        }
        if self.times.now_s - self.times.whole_field_s > self.setup.pipeline.stale_s {
            let (reason, message) = if self.times.overflow_s > self.times.whole_field_s {
                (
                    "overflow",
                    "the field is beyond the magnetometer's range, or an axis is stuck: choose a larger range, or move away from the magnet",
                )
            } else {
                (
                    "no_samples",
                    "no magnetometer sample is recent enough to publish a heading from",
                )
            };
            return self.report_as(Condition::Stale, reason, message);
        }
        if !self.learning.calibrated {
            return self.judge_uncalibrated();
        }
        if let Some((reason, message)) = self.chip_fault() {
            return self.report_as(Condition::Degraded, reason, message);
        }
        if self.estimate.reversed() {
            let message = "the field points up where the earth's points down at this position, or the other way round: headings may be off by up to 180 degrees";
            return self.report_as(Condition::Degraded, "reversed_field", message);
        }
        if self.field_is_disturbed() {
            if self.strength_deviation.abs() > STRENGTH_TOLERANCE {
                let percent = 100.0 * (1.0 + self.strength_deviation);
                let message =
                    format!("the field has {percent:.0} % of the strength it should have");
                return self.report_as(Condition::Disturbed, "field_strength", message);
            }
            let message = "the field is not what the motion predicts: something magnetic is near";
            return self.report_as(Condition::Disturbed, "field_changed", message);
        }
        if let Some(message) = self.dead_accelerometer() {
            return self.report_as(Condition::Degraded, "accel_dead", message);
        }
        if self.tilt_is_missing() {
            let message = if self.sd_deg <= self.setup.pipeline.publish_sd_deg {
                "no accelerometer data: headings hold for a board that is level"
            } else {
                "no accelerometer data, and so no heading is certain enough yet: keep the board level, and turn it for some minutes"
            };
            return self.report_as(Condition::Degraded, "no_accelerometer", message);
        }
        if self.gyro_is_missing() {
            let message = "no gyro data: headings are those of single samples";
            return self.report_as(Condition::Degraded, "no_gyro", message);
        }
        if self.nose_vertical {
            let message = "the board's X axis is nearly vertical, where it has no heading: hold it more level";
            return self.report_as(Condition::Degraded, "nose_vertical", message);
        }
        // NaN is not certain.
        let certain = self.sd_deg <= self.setup.pipeline.good_sd_deg;
        if !certain {
            let mut message = format!(
                "the heading is still uncertain: move the board about, and {}",
                self.estimate.motion_wanted()
            );
            if self.wanted().is_none() {
                message += if self.policy == Policy::Locked {
                    "; if that does not help, run headingd calibration unlock: a locked calibration learns nothing"
                } else {
                    "; if that does not help, run headingd calibration mode on: in mode off nothing is learnt"
                };
            }
            let share = self.setup.pipeline.good_sd_deg / self.sd_deg;
            return Report {
                progress: Some(share.clamp(0.0, 1.0)),
                ..self.report_as(Condition::Degraded, "learning", message)
            };
        }
        let message = "the field is as the estimate expects it";
        self.report_as(Condition::Good, "good", message)
    }

    /// The first condition that applies while there is no calibration.
    fn judge_uncalibrated(&self) -> Report {
        if self.job.is_some_and(|job| !job.unwanted) {
            let message = "calibrating on the motion just made";
            return self.report_as(Condition::Calibrating, "calibrating", message);
        }
        if let Some((reason, message)) = self.chip_fault() {
            return self.report_as(Condition::Uncalibrated, reason, message);
        }
        if self.wanted().is_none() {
            let message =
                "automatic calibration is off: run headingd calibration start, then turn the board";
            return self.report_as(Condition::Uncalibrated, "mode_off", message);
        }
        if self.intake.turns.progress() >= TURNING_FROM {
            let limit_s = self.setup.turn.time_limit_s;
            let message = format!(
                "keep turning the board the same way round: a full turn may take at most {limit_s:.0} s"
            );
            return Report {
                progress: Some(self.intake.turns.progress()),
                ..self.report_as(Condition::Turning, "turning", message)
            };
        }
        if let Some(Refusal { reason, message }) = &self.refused {
            let message = format!("the last attempt gave no calibration: {message}");
            return self.report_as(Condition::Uncalibrated, reason, message);
        }
        if self.gyro_is_missing() {
            let message = "no gyro data, so turns cannot be detected: connect the gyro or import a calibration";
            return self.report_as(Condition::Uncalibrated, "no_gyro", message);
        }
        if let Some(message) = self.dead_accelerometer() {
            return self.report_as(Condition::Uncalibrated, "accel_dead", message);
        }
        if self.tilt_is_missing() {
            let message = "no accelerometer data, so headings hold for a board that stays level: keep it level, and turn it once all the way round";
            return self.report_as(Condition::Uncalibrated, "no_accelerometer", message);
        }
        let message = "turn the board once all the way round, or move it about, away from iron";
        self.report_as(Condition::Uncalibrated, "no_calibration", message)
    }

    fn report_as(
        &self,
        condition: Condition,
        reason: &'static str,
        message: impl Into<Cow<'static, str>>,
    ) -> Report {
        Report {
            condition,
            reason,
            message: message.into(),
            progress: (condition == Condition::Uncalibrated).then(|| self.learnt()),
            t_s: self.times.now_s,
        }
    }

    /// Whether something magnetic is near. Without a gyro the estimate takes no samples, and only the field's strength shows it.
    fn field_is_disturbed(&self) -> bool {
        if self.gyro_is_live() {
            self.times.now_s - self.times.disturbed_s < CALM_S
        } else {
            self.strength_deviation.abs() > STRENGTH_TOLERANCE
        }
    }

    /// Whether the readings began so recently that a missing sensor may still come.
    fn has_just_begun(&self) -> bool {
        self.readings_s
            .is_some_and(|(first_s, _)| self.times.now_s - first_s <= self.setup.attitude.gap_s)
    }

    fn tilt_is_missing(&self) -> bool {
        !self.accelerometer_is_live() && !self.has_just_begun()
    }

    fn accelerometer_is_live(&self) -> bool {
        self.intake.attitude.accelerometer_live(self.times.now_s)
    }

    fn gyro_is_missing(&self) -> bool {
        !self.gyro_is_live() && !self.has_just_begun()
    }

    fn gyro_is_live(&self) -> bool {
        self.times.now_s - self.times.rate_s <= self.setup.attitude.gap_s
    }

    /// What is wrong with the magnetometer's unit, if it certainly is.
    pub(super) fn wrong_unit(&self) -> Option<String> {
        let fresh = |read_s: f64| self.times.now_s - read_s <= self.setup.pipeline.stale_s;
        if fresh(self.times.whole_field_s) {
            let strength = self.estimate.impossible_strength_mgauss();
            return strength.map(wrong_strength);
        }
        fresh(self.times.implausible_s).then(|| {
            format!(
                "the magnetometer reads more than {LARGEST_FIELD_MGAUSS} mG, and no chip measures that: check its unit"
            )
        })
    }

    /// What is wrong with gyro or accelerometer, or with how they are mounted, as a code and as a sentence.
    pub(super) fn chip_fault(&self) -> Option<(&'static str, Cow<'static, str>)> {
        if self.intake.attitude.clipping() && self.gyro_is_live() {
            let message = "the board turns faster than the gyro can measure: turn it more slowly";
            return Some(("gyro_clipped", message.into()));
        }
        if self.intake.force_unit.is_wrong() && self.accelerometer_is_live() {
            let message =
                "what the accelerometer reads is far from gravity: check its unit and its range";
            return Some(("accel_unit", message.into()));
        }
        if let Some(axis) = self.dead_gyro_axis() {
            return Some(("gyro_dead", dead_axis("gyro", axis).into()));
        }
        let (reason, message) = match self.estimate.gyro_fault()? {
            GyroFault::Dead => (
                "gyro_dead",
                "the field turns and the gyro does not: check its wiring and its unit",
            ),
            GyroFault::Sign => (
                "gyro_sign",
                "the gyro turns another way than field or gravity: check the axes and signs of all chips (in [mounting] or the header), \
                 and the gyro's unit",
            ),
            GyroFault::MagAxes => (
                "mag_axes",
                "the field turns another way than gyro and gravity: check the magnetometer's axes and signs (in [mounting] or the header)",
            ),
            GyroFault::AccelAxes => (
                "accel_axes",
                "gravity turns another way than gyro and field: check the accelerometer's axes and signs (in [mounting] or the header)",
            ),
            GyroFault::Scale => (
                "gyro_scale",
                "gyro and field differ by more than 5 % in how far the board turns: check the gyro's range and unit",
            ),
        };
        Some((reason, message.into()))
    }

    fn dead_gyro_axis(&self) -> Option<&'static str> {
        let since_s = self.times.now_s - self.setup.attitude.gap_s;
        self.intake.gyro_axes.dead_since(since_s)
    }

    /// What is wrong with the accelerometer if the tilt is missing though it is read.
    fn dead_accelerometer(&self) -> Option<String> {
        let since_s = self.times.now_s - self.setup.attitude.gap_s;
        let axis = self.intake.accel_axes.dead_since(since_s)?;
        let message = dead_axis("accelerometer", axis);
        Some(format!("{message}; until then keep the board level"))
    }

    /// Whether nothing is known to be wrong with the axes of magnetometer and accelerometer: a single sample has no heading without both.
    pub(super) fn axes_are_right(&self) -> bool {
        let fault = self.estimate.gyro_fault();
        !matches!(fault, Some(GyroFault::MagAxes | GyroFault::AccelAxes))
    }

    /// Whether nothing is known to be wrong with the gyro.
    pub(super) fn gyro_is_right(&self) -> bool {
        self.estimate.gyro_fault().is_none() && self.dead_gyro_axis().is_none()
    }
}

fn dead_axis(chip: &str, axis: &str) -> String {
    format!(
        "axis {axis} of the {chip} repeats its value while the others change: check its wiring, and what reads it"
    )
}

/// The message for a field strength found nowhere on earth, milligauss.
pub(super) fn wrong_strength(strength_mgauss: f64) -> String {
    format!(
        "the field is {strength_mgauss:.0} mG strong, and the earth's is {WEAKEST_MGAUSS} to {STRONGEST_MGAUSS}: check the \
         magnetometer's unit and range"
    )
}
