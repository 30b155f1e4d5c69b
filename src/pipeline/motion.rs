//! What motion alone has taught by the end of a log.

use super::Pipeline;
use crate::calibration::outcome::Outcome;
use crate::calibration::verdict::{Bound, Limit, Refusal};
use crate::condition::wrong_strength;

impl Pipeline {
    /// What the estimate has learnt so far, and the limits that this is held to: accepted as certain as a live one is kept, and else
    /// refused. `None` before the board has turned far enough for an estimate to begin.
    pub fn learnt_by_motion(&self) -> Option<(Outcome, [Limit; 3])> {
        let limit = |name, unit, measured, bound| Limit {
            name,
            unit,
            measured,
            bound,
        };
        let [right, predicted] =
            [self.gyro_is_right(), !self.estimate.disturbed()].map(|yes| f64::from(u8::from(yes)));
        let sd_deg = self.estimate.north_sd_deg();
        let most = Bound::AtMost(self.setup.pipeline.good_sd_deg);
        let limits = [
            limit("gyro turns as the field does", "", right, Bound::True),
            limit(
                "field at the end as the motion predicts",
                "",
                predicted,
                Bound::True,
            ),
            limit("predicted heading uncertainty", "degrees", sd_deg, most),
        ];
        let outcome =
            Outcome::of_motion(self.learnt_calibration()?, self.estimate.measured_axes())?;
        let outcome = match self.objection_to_motion(&limits) {
            Some(refusal) => outcome.refused(refusal),
            None => outcome,
        };
        Some((outcome, limits))
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

    fn objection_to_motion(&self, [_, predicted, certain]: &[Limit; 3]) -> Option<Refusal> {
        if let Some(refusal) = self.objection_to_gyro() {
            return Some(refusal);
        }
        if let Some(strength) = self.estimate.impossible_mgauss() {
            return Some(Refusal::new("field_unit", wrong_strength(strength)));
        }
        if !predicted.is_kept() {
            return Some(Refusal::new(
                "outliers",
                "at the end of the log the field is not what the motion predicts: something magnetic came or went",
            ));
        }
        (!certain.is_kept()).then(|| {
            let (sd_deg, most_deg) = (certain.measured, self.setup.pipeline.good_sd_deg);
            Refusal::new(
                "heading_uncertainty",
                format!(
                    "no level full turn was recognised, and by motion headings are uncertain by {sd_deg:.1} degrees (at most {most_deg:.1}): move the board about, and {}",
                    self.estimate.motion_wanted()
                ),
            )
        })
    }
}
