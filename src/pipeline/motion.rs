//! What motion alone has taught by the end of a log.

use super::Pipeline;
use crate::calibration::outcome::Outcome;
use crate::calibration::verdict::Refusal;
use crate::condition::wrong_strength;

/// What a calibration by motion is judged by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionMeasures {
    /// Whether nothing is known to be wrong with the gyro.
    pub gyro_is_right: bool,
    /// Whether the field at the end is what the motion predicts.
    pub field_is_predicted: bool,
    /// Noise of the samples, milligauss.
    pub residual_mgauss: f64,
    /// Deviation of every heading of a level board, degrees.
    pub heading_sd_deg: f64,
    /// The most that it may be.
    pub most_heading_sd_deg: f64,
}

impl Pipeline {
    /// What the estimate has learnt so far, and what that is judged by: accepted as certain as a live one is kept, and else
    /// refused. `None` before the board has turned far enough for an estimate to begin.
    pub fn learnt_by_motion(&self) -> Option<(Outcome, MotionMeasures)> {
        let calibration = self.learnt_calibration()?;
        let measures = MotionMeasures {
            gyro_is_right: self.gyro_is_right(),
            field_is_predicted: !self.estimate.disturbed(),
            residual_mgauss: calibration.residual_mgauss,
            heading_sd_deg: self.estimate.north_sd_deg(),
            most_heading_sd_deg: self.setup.pipeline.good_sd_deg,
        };
        let outcome = Outcome::of_motion(calibration, self.estimate.measured_axes())?;
        let outcome = match self.objection_to_motion(&measures) {
            Some(refusal) => outcome.refused(refusal),
            None => outcome,
        };
        Some((outcome, measures))
    }

    /// What a calibration is refused for if the gyro is wrong.
    pub(super) fn objection_to_gyro(&self) -> Option<Refusal> {
        (!self.gyro_is_right()).then(|| {
            Refusal::new(
                "gyro_angle",
                "field and gyro do not turn together: check the gyro's wiring, mounting, sign and range",
            )
        })
    }

    fn objection_to_motion(&self, measures: &MotionMeasures) -> Option<Refusal> {
        if let Some(refusal) = self.objection_to_gyro() {
            return Some(refusal);
        }
        if let Some(strength) = self.estimate.impossible_mgauss() {
            return Some(Refusal::new("field_unit", wrong_strength(strength)));
        }
        if !measures.field_is_predicted {
            return Some(Refusal::new(
                "outliers",
                "at the end of the log the field is not what the motion predicts: something magnetic came or went",
            ));
        }
        let (sd_deg, limit_deg) = (measures.heading_sd_deg, measures.most_heading_sd_deg);
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
