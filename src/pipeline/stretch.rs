//! A new stretch of readings, whose times have nothing to do with those before.

use super::Pipeline;
use crate::calibration::model::Calibration;

impl Pipeline {
    /// Forgets all motion, and whatever is remembered by its time. Calibration, policy and the verdict on the last turn
    /// stay, and so do a calibration that is under way and the gyro's bias, which goes with the active calibration.
    pub(super) fn begin_stretch(&mut self, calibration: Option<&Calibration>) {
        self.intake.begin_stretch(&self.setup, calibration);
        self.buffer.clear();
        self.completed.clear();
        self.forget_waiting_turns();
        if let Some(job) = &mut self.job {
            job.end_s = f64::NEG_INFINITY;
        }
        self.sample = None;
        self.estimate.lose_frame();
        self.report = None;
        self.readings_s = None;
        for time_s in [
            &mut self.now_s,
            &mut self.whole_field_s,
            &mut self.overflow_s,
            &mut self.rate_s,
            &mut self.bad_turn_s,
            &mut self.disturbed_s,
            &mut self.strength_s,
            &mut self.learning.last_s,
        ] {
            *time_s = f64::NEG_INFINITY;
        }
        self.strength_deviation = 0.0;
    }
}
