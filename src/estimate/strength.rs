//! Strengths that no field of the earth has: the magnetometer's unit or range is wrong.

use super::Estimate;
use crate::reading::EARTH_MGAUSS;

/// A strength is certain within so many deviations of the whole field.
const CERTAIN: f64 = 3.0;
/// No compass works beside iron that makes a raw field stronger than this, milligauss: it is beyond all three axes of a chip for 8 gauss.
pub(super) const MOST_RAW_MGAUSS: f64 = 14_000.0;

impl Estimate {
    /// Strength of the field, milligauss, rounded to two digits, if the earth's is nowhere like that.
    pub fn impossible_mgauss(&self) -> Option<f64> {
        let raw = self.last.map_or(0.0, |last| last.field_mgauss.norm());
        let (strength, measured, sd) = if raw > MOST_RAW_MGAUSS {
            (raw, raw, 0.0)
        } else if self.active.begun {
            let strength = self.active.strength_mgauss();
            // The vertical field of a board that stays level is not measured.
            let measured = match self.measured_axes() == [true; 3] {
                true => strength,
                false => self.horizontal_mgauss(),
            };
            let sd = self.active.field_covariance().trace().sqrt();
            (strength, measured, sd)
        } else {
            return None;
        };
        let (least, most) = (measured - CERTAIN * sd, strength + CERTAIN * sd);
        let possible = most >= *EARTH_MGAUSS.start() && least <= *EARTH_MGAUSS.end();
        (!possible).then(|| {
            let digit = 10f64.powf(strength.log10().floor() - 1.0);
            (strength / digit).round() * digit
        })
    }
}
