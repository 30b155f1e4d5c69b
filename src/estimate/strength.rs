//! How strong the field is, and strengths that no field of the earth has: the magnetometer's unit or range is wrong.

use nalgebra::{Matrix3, Vector3};

use super::Estimate;
use crate::frame::variance_along;
use crate::reading::{EARTH_MGAUSS, STRONGEST_MGAUSS};

/// The true strength certainly lies within this many deviations.
const CERTAIN: f64 = 3.0;
/// A strength is known well within this share: as well as the gain of the chips.
const KNOWN_WELL: f64 = 0.1;
/// No compass works beside iron that makes a raw field stronger than this, milligauss: it is beyond all three axes of a chip for 8 gauss.
pub(super) const MOST_RAW_MGAUSS: f64 = 14_000.0;

impl Estimate {
    /// Strength of the part of a corrected field that lies on the measured axes, milligauss. `None` if fewer than two axes are measured.
    pub fn measured_strength_mgauss(
        &self,
        corrected: &Vector3<f64>,
        measured: [bool; 3],
    ) -> Option<f64> {
        // By a kept planar calibration, which may lie askew to the body axes, the field has no other part.
        if self.kept_alone().is_some() {
            return Some(corrected.norm());
        }
        let part = Vector3::from_fn(|axis, _| if measured[axis] { corrected[axis] } else { 0.0 });
        let unknown = measured.iter().filter(|known| !**known).count();
        (unknown < 2).then(|| part.norm())
    }

    /// Expected strength of the corrected field, milligauss.
    pub fn strength_mgauss(&self) -> f64 {
        match &self.kept {
            Some(kept) if !self.active.begun => kept.strength_mgauss,
            _ => self.active.strength_mgauss(),
        }
    }

    /// The horizontal part of the field, milligauss.
    pub fn horizontal_mgauss(&self) -> f64 {
        self.active.field().xy().norm()
    }

    /// Strength of the field, milligauss, rounded to two digits, if it is certainly not one of `EARTH_MGAUSS`.
    pub fn impossible_strength_mgauss(&self) -> Option<f64> {
        self.strength_beyond(CERTAIN)
    }

    /// The same if it is probably not one of `EARTH_MGAUSS`: no calibration is kept with such a field.
    pub fn improbable_strength_mgauss(&self) -> Option<f64> {
        self.strength_beyond(0.0)
    }

    /// The same if it is outside `EARTH_MGAUSS` by more than this many deviations.
    fn strength_beyond(&self, deviations: f64) -> Option<f64> {
        let raw = self.last.map_or(0.0, |last| last.field_mgauss.norm());
        let (strength, least, most) = if raw > MOST_RAW_MGAUSS {
            (raw, raw, raw)
        } else if self.active.begun {
            let field = self.active.field();
            // The vertical field of a board that stays level is not measured.
            let measured = match self.measured_axes() == [true; 3] {
                true => field,
                false => horizontal(&field),
            };
            let strength = self.active.strength_mgauss();
            let covariance = self.active.field_covariance();
            (
                strength,
                measured.norm() - deviations * sd_along(&covariance, &measured),
                strength + deviations * sd_along(&covariance, &field),
            )
        } else {
            return None;
        };
        let possible = most >= *EARTH_MGAUSS.start() && least <= *EARTH_MGAUSS.end();
        (!possible).then(|| {
            let digit = 10f64.powf(strength.log10().floor() - 1.0);
            (strength / digit).round() * digit
        })
    }

    /// Whether the earth may have such a horizontal field. One that is not known well must be as weak as the earth's is without iron: a
    /// board that turns about one horizontal axis cannot tell field from iron along that axis, and with small errors of chips both grow
    /// without limit.
    pub(super) fn is_credible(&self) -> bool {
        let strength = self.horizontal_mgauss();
        let known_well = || {
            let along = horizontal(&self.active.field());
            sd_along(&self.active.field_covariance(), &along) < KNOWN_WELL * strength
        };
        strength <= STRONGEST_MGAUSS || known_well() && self.improbable_strength_mgauss().is_none()
    }
}

/// The horizontal part of a field in the frame.
pub(super) fn horizontal(field: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(field.x, field.y, 0.0)
}

/// Deviation of a field with this covariance along a vector; of a vector without length, that in all directions together.
pub(super) fn sd_along(covariance: &Matrix3<f64>, vector: &Vector3<f64>) -> f64 {
    let variance = match vector.try_normalize(f64::MIN_POSITIVE) {
        Some(along) => variance_along(covariance, &along),
        None => covariance.trace(),
    };
    variance.sqrt()
}
