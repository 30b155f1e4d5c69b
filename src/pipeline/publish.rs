//! The heading of each reading of the magnetometer.

use nalgebra::Vector3;

use super::{Action, Pipeline};
use crate::attitude::Pose;
use crate::calibration::model::Calibration;
use crate::condition::Condition;
use crate::estimate::{EstimatedHeading, Sample, UNKNOWN_SD_DEG};
use crate::frame::{dip_deg, heading_deg, pitch_and_roll_deg};
use crate::heading::{Heading, MagStatus};
use crate::reading::HELD_S;

/// The strength of the field is smoothed over this time, seconds.
const STRENGTH_S: f64 = 0.5;
/// A sample is not used if the held rate may have missed more rotation than this, radians: with a hand's changes, that is 70 ms after the
/// gyro's last reading.
const MOST_HELD_RAD: f64 = 0.02;

/// If there is no heading, a pitch beyond this sine (70°) is the reason. Headings end at 80°, of a tilt that the estimate corrects by some
/// degrees.
const STEEP: f64 = 0.94;

/// What a whole field tells.
struct FoundHeading {
    down: Option<Vector3<f64>>,
    corrected: Option<Vector3<f64>>,
    fused: Option<EstimatedHeading>,
    instantaneous: Option<EstimatedHeading>,
    /// The better of both, if it is certain enough to be published.
    published: Option<EstimatedHeading>,
}

impl Pipeline {
    /// Publishes what a whole field tells.
    pub(super) fn publish(
        &mut self,
        t_s: f64,
        raw: &Vector3<f64>,
        measured_s: Option<f64>,
        actions: &mut Vec<Action>,
    ) {
        let pose = self.feed_estimate(t_s, raw, measured_s);
        actions.extend(self.estimate.take_warning().map(Action::Warn));
        let right = self.gyro_is_right();
        let found = self.weigh_sample(t_s, raw, pose.filter(|_| right));
        if found.published.is_some() && self.wanted().is_some() {
            self.learning.calibrated = true;
        }
        if !right {
            self.intake.saturation.forget();
        }
        if self.estimate.disturbed() || !right {
            self.times.disturbed_s = t_s;
        }
        let due = self.learning.is_due(t_s);
        self.conclude_motion(due, actions);
        let condition = self.update_condition(actions);
        let heading = self.whole_heading(t_s, raw, &found, condition);
        actions.push(Action::Publish(heading));
    }

    /// Finds the heading by a pose that is to be trusted, if there is one, and by the sample alone. Takes note of the field's strength and of
    /// the heading's deviation.
    fn weigh_sample(&mut self, t_s: f64, raw: &Vector3<f64>, pose: Option<Pose>) -> FoundHeading {
        let level = self.intake.attitude.down_and_sd(t_s, pose.is_some());
        let calibrated = self.learning.calibrated;
        let corrected = self.estimate.corrected(raw).filter(|_| calibrated);
        if let Some(corrected) = &corrected {
            self.follow_strength(t_s, corrected.norm());
        }
        let missed_rad = self.intake.attitude.missed_turn_rad(t_s);
        let fused = pose.and_then(|pose| self.estimate.heading(&pose, missed_rad));
        let rate_rad_s = self.rate_rad_s(t_s).map_or(0.0, |rate| rate.norm());
        let instantaneous = self.estimate.heading_of_sample(raw, level, rate_rad_s);
        let best = if pose.is_some() { fused } else { instantaneous };
        self.sd_deg = best.map_or(UNKNOWN_SD_DEG, |best| best.sd_deg);
        let steep = level.is_some_and(|(down, _)| down.x.abs() > STEEP);
        self.nose_vertical = best.is_none() && steep;
        let possible =
            self.estimate.impossible_strength_mgauss().is_none() && self.axes_are_right();
        let most_sd_deg = self.setup.pipeline.publish_sd_deg;
        FoundHeading {
            down: level.map(|(down, _)| down),
            corrected,
            fused,
            instantaneous,
            published: best.filter(|heading| possible && heading.sd_deg <= most_sd_deg),
        }
    }

    /// The heading to publish, with all that was found.
    fn whole_heading(
        &mut self,
        t_s: f64,
        raw: &Vector3<f64>,
        found: &FoundHeading,
        condition: Condition,
    ) -> Heading {
        let raw_body = self.setup.mountings.mag.to_body(*raw);
        let mut heading = self.heading(t_s, found.down.as_ref(), condition);
        heading.raw_deg = heading_deg(&raw_body, &found.down.unwrap_or_else(Vector3::z));
        let Some(corrected) = found.corrected else {
            return heading;
        };
        if let Some(published) = found.published {
            heading.fused_deg = found.fused.map(|found| found.heading_deg);
            heading.instantaneous_deg = found.instantaneous.map(|found| found.heading_deg);
            heading.sd_deg = Some(published.sd_deg);
        }
        let measured = self.estimate.measured_axes();
        heading.field_mgauss = Some(std::array::from_fn(|axis| {
            measured[axis].then_some(corrected[axis])
        }));
        heading.strength_mgauss = self.estimate.measured_strength_mgauss(&corrected, measured);
        if measured == [true; 3] {
            heading.dip_deg = found.down.map(|down| dip_deg(&corrected, &down));
        }
        heading.mag_status = match condition {
            Condition::Disturbed if self.strength_deviation > 0.0 => MagStatus::HighField,
            Condition::Disturbed => MagStatus::LowField,
            Condition::Fault => MagStatus::Calibration,
            _ => MagStatus::Normal,
        };
        heading
    }

    /// Gives the estimate a sample that was measured at `measured_s`, if it is new and the pose at that time is known. Returns the pose at
    /// `t_s`.
    fn feed_estimate(
        &mut self,
        t_s: f64,
        raw: &Vector3<f64>,
        measured_s: Option<f64>,
    ) -> Option<Pose> {
        let now_s = t_s + self.intake.attitude.unobservable_delay_s();
        let pose = self.intake.attitude.pose_at(now_s)?;
        // An accelerometer that has just come has not levelled the frame yet.
        let levelled =
            |pose: &Pose| pose.vertical_known || !self.intake.attitude.accelerometer_live(t_s);
        let attitude = &self.intake.attitude;
        let unknown = attitude.clipping() || attitude.may_have_jumped();
        if !levelled(&pose) || unknown || self.frozen.is_some() {
            return None;
        }
        let Some(measured_s) = measured_s else {
            return Some(pose);
        };
        let lag_s = self.estimate.lag_s();
        if self.intake.attitude.held_turn_rad(measured_s - lag_s) > MOST_HELD_RAD {
            return Some(pose);
        }
        let motion = self
            .intake
            .attitude
            .motion_at(measured_s - lag_s)
            .filter(|motion| levelled(&motion.pose))?;
        let sample = Sample {
            t_s: measured_s,
            field_mgauss: *raw,
            lag_s,
            motion,
            board: self.intake.attitude.state(t_s),
        };
        let on_trial = self.asked_for && self.estimate.has_rival();
        let fixed = self.wanted().is_none() && self.learning.calibrated && !on_trial;
        if self.estimate.take(&sample, fixed) {
            self.renew_attitude();
            return None;
        }
        if self.learning.calibrated && !self.estimate.knows() {
            // All of it was learnt by a gyro that is wrong.
            self.forget_learning(None);
        }
        self.sample = Some(sample);
        Some(pose)
    }

    /// Begins attitude and turns anew, after a gyro or an accelerometer that did not measure has misled them.
    pub(super) fn renew_attitude(&mut self) {
        // What was taken for a bias of the specific force is wrong.
        let calibration = self.calibration().map(|calibration| Calibration {
            accel_bias_m_s2: None,
            ..calibration
        });
        self.intake
            .renew_attitude(&self.setup, calibration.as_ref());
        self.completed.clear();
        self.forget_waiting_turns();
    }

    /// Smooths the strength of the corrected field. Rows that repeat a sample count, so that the mean settles on a field that does not
    /// change. After a pause the first row counts for `HELD_S` at most.
    fn follow_strength(&mut self, t_s: f64, strength_mgauss: f64) {
        let expected = self.estimate.strength_mgauss();
        let period_s = t_s - std::mem::replace(&mut self.times.strength_s, t_s);
        if expected > 0.0 {
            let deviation = strength_mgauss / expected - 1.0;
            let gain = 1.0 - (-period_s.min(HELD_S) / STRENGTH_S).exp();
            self.strength_deviation += gain * (deviation - self.strength_deviation);
        }
    }

    /// Publishes a reading that overflowed with its tilt, but without field and heading.
    pub(super) fn publish_without_field(&mut self, t_s: f64, actions: &mut Vec<Action>) {
        let condition = self.update_condition(actions);
        let down = self.intake.attitude.down(t_s);
        let mut heading = self.heading(t_s, down.as_ref(), condition);
        heading.mag_status = MagStatus::HighField;
        actions.push(Action::Publish(heading));
    }

    /// Where down is now, a unit vector of body axes, and how fast the board turns, rad/s; `None` while nothing feels it.
    pub fn down(&self) -> Option<(Vector3<f64>, f64)> {
        let down = self.intake.attitude.down(self.times.now_s)?;
        let rate_rad_s = self.rate_rad_s(self.times.now_s);
        Some((down, rate_rad_s.map_or(0.0, |rate| rate.norm())))
    }

    /// Rate of the board, body axes, rad/s, without the bias that attitude and estimate have found; `None` while the gyro is silent.
    fn rate_rad_s(&self, t_s: f64) -> Option<Vector3<f64>> {
        let attitude = &self.intake.attitude;
        attitude.pose_at(t_s)?;
        let removed = attitude.gyro_bias_rad_s();
        let bias = self.estimate.gyro_bias().map_or(removed, |(bias, _)| bias);
        Some(attitude.rate_rad_s() + (removed - bias))
    }

    /// A heading with only time, tilt, condition, rate and specific force.
    fn heading(&mut self, t_s: f64, down: Option<&Vector3<f64>>, condition: Condition) -> Heading {
        self.seq += 1;
        let tilt = down.map(pitch_and_roll_deg);
        let rate_rad_s = self.rate_rad_s(t_s);
        let force = self.intake.attitude.specific_force_m_s2(t_s);
        // Without an accelerometer the board is taken to be level, as for its heading.
        let down = down.copied().unwrap_or_else(Vector3::z);
        Heading {
            seq: self.seq,
            t_s,
            condition,
            pitch_deg: tilt.map(|(pitch_deg, _)| pitch_deg),
            roll_deg: tilt.map(|(_, roll_deg)| roll_deg),
            turn_deg_min: rate_rad_s.map(|rate| 60.0 * rate.dot(&down).to_degrees()),
            rate_deg_s: rate_rad_s.map(|rate| rate.map(f64::to_degrees).into()),
            specific_force_m_s2: force.map(Into::into),
            mag_status: MagStatus::Calibration,
            ..Heading::default()
        }
    }
}
