//! What motion alone has taught by the end of a log.

use super::Pipeline;
use crate::calibration::outcome::Outcome;
use crate::calibration::verdict::Refusal;

impl Pipeline {
    /// What the estimate has learnt so far: accepted as certain as a live one is kept, and else refused. `None` before the
    /// board has turned far enough for an estimate to begin.
    pub fn learnt_by_motion(&self) -> Option<Outcome> {
        let calibration = self.estimate.calibration()?;
        let outcome = Outcome::of_motion(calibration, self.estimate.measured_axes());
        Some(match self.objection_to_motion() {
            Some(refusal) => outcome.refused(refusal),
            None => outcome,
        })
    }

    fn objection_to_motion(&self) -> Option<Refusal> {
        if !self.gyro_is_right() {
            return Some(Refusal::new(
                "gyro_angle",
                "field and gyro do not turn together: check the gyro's wiring, mounting and sign",
            ));
        }
        if self.estimate.disturbed() {
            return Some(Refusal::new(
                "outliers",
                "at the end of the log the field is not what the motion predicts: something magnetic came or went",
            ));
        }
        let sd_deg = self.estimate.north_sd_deg();
        let limit_deg = self.setup.pipeline.good_sd_deg;
        (sd_deg > limit_deg).then(|| {
            Refusal::new(
                "heading_uncertainty",
                format!(
                    "no full turn was made, and by motion headings are certain to {sd_deg:.1} degrees only (at most {limit_deg:.1}): move the board about, and {}",
                    self.estimate.motion_wanted()
                ),
            )
        })
    }
}
