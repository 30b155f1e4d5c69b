//! Samples of the magnetometer, as the estimate takes them.

use nalgebra::Vector3;

use super::Pipeline;
use crate::attitude::Pose;
use crate::estimate::Sample;

impl Pipeline {
    /// Gives the estimate a sample that was measured at `measured_s`, if it is new and the gyro knows the pose then. Returns the pose at
    /// `t_s`.
    pub(super) fn estimate_from(
        &mut self,
        t_s: f64,
        raw: &Vector3<f64>,
        measured_s: Option<f64>,
    ) -> Option<Pose> {
        let pose = self.intake.attitude.pose_at(t_s)?;
        // An accelerometer that has just come has not levelled the frame yet.
        let levelled =
            |pose: &Pose| pose.vertical_known || !self.intake.attitude.accelerometer_live(t_s);
        if !levelled(&pose) || self.intake.attitude.clipping() || self.frozen.is_some() {
            return None;
        }
        let Some(measured_s) = measured_s else {
            return Some(pose);
        };
        let lag_s = self.estimate.lag_s();
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
        self.estimate
            .freeze(self.wanted().is_none() && self.learning.calibrated);
        self.estimate.take(&sample);
        if self.estimate.take_gyro_recovered() {
            // The attitude has followed the dead gyro, and learnt a wrong bias of it.
            let calibration = self.calibration();
            self.intake
                .renew_attitude(&self.setup, calibration.as_ref());
            self.completed.clear();
            self.forget_waiting_turns();
            return None;
        }
        if self.learning.calibrated && !self.estimate.knows() {
            // All of it was learnt by a gyro that is wrong.
            self.forget_learning(None);
        }
        self.sample = Some(sample);
        Some(pose)
    }
}
