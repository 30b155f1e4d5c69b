//! What a model says of the earth's field at this place, as evidence of which way north is.
//!
//! The model gives the horizontal and the vertical part of the field. The estimate knows both up to a common scale, since the trace
//! of D is held: both share the chips' gain error, so their ratio, the dip, is the better evidence. The evidence has no azimuth; it
//! corrects north through the covariance of north with the two parts.
//!
//! It is applied to headings only, never to the filter: a wrong place bends no calibration, and nothing needs to be undone.

use nalgebra::{Matrix2, Matrix2x3, Vector2, Vector3};

use super::filter::Filter;
use super::filter::known::FieldInFrame;
use super::prior::SCALE;
use crate::frame::{hypot, variance_along};
use crate::true_north::EarthField;

/// Deviation of the mean gain of three axes, as a share: as large as that of one axis.
const GAIN: f64 = SCALE;
/// Deviation of a place's field by a building or a vehicle, on each axis, as a share: as much as it differs from metre to metre on the
/// simulated floors.
const LOCAL: f64 = 0.05;
/// Gate on the normalised square: chance exceeds it in 0.03 % of cases (2 degrees of freedom).
const CONTRADICTED: f64 = 16.0;
/// A warning needs a normalised square above this, and so does a field that is called reversed: a vehicle that stays level learns the dip
/// badly and understates its error.
const WARNED: f64 = 36.0;
/// Contradiction in motion before a warning, seconds; agreement counts it down again, so that passing iron raises none.
const SURE_S: f64 = 30.0;
/// A place is the same where the field differs by less than this share: from day to day, and over some ten kilometres.
const SAME: f64 = 0.01;
/// The evidence is used once the direction of the horizontal field is known within this, radians: only then is its length nearly
/// linear in its components.
const DIRECTION_RAD: f64 = 0.2;

/// The model's field at a place, and how it agrees with the samples.
#[derive(Clone, Debug)]
pub(super) struct PlaceEvidence {
    /// The horizontal part of the field and the upward one by the model, milligauss, and the model's own variances.
    expected: Vector2<f64>,
    model_variance: Vector2<f64>,
    /// For how long samples have contradicted it, less the time that they have not, seconds.
    against_s: f64,
    warned: bool,
    /// Whether the field points up where the model's points down, or down where that points up.
    pub(super) reversed: bool,
}

/// How the evidence differs from what was learnt.
struct Innovation {
    parts: Matrix2x3<f64>,
    value: Vector2<f64>,
    inverse: Matrix2<f64>,
}

impl Innovation {
    fn squared(&self) -> f64 {
        self.value.dot(&(self.inverse * self.value))
    }
}

impl PlaceEvidence {
    pub(super) fn new(field: &EarthField) -> Self {
        let (strength, dip) = (field.strength_mgauss, field.dip_deg);
        let (sin, cos) = dip.value.to_radians().sin_cos();
        let up_sd = hypot(
            sin * strength.sd,
            cos * strength.value * dip.sd.to_radians(),
        );
        Self {
            expected: Vector2::new(field.horizontal_mgauss.value, -sin * strength.value),
            model_variance: Vector2::new(field.horizontal_mgauss.sd, up_sd).map(|sd| sd * sd),
            against_s: 0.0,
            warned: false,
            reversed: false,
        }
    }

    /// Replaces `before`. If the field is nearly the same, its record of contradiction and warning is kept.
    pub(super) fn after(self, before: Option<Self>) -> Self {
        let near = SAME * self.expected.norm();
        match before {
            Some(before) if (before.expected - self.expected).norm() < near => Self {
                expected: self.expected,
                model_variance: self.model_variance,
                ..before
            },
            _ => self,
        }
    }

    /// The same place, before any sample has been compared with it.
    pub(super) fn unweighed(self) -> Self {
        Self {
            against_s: 0.0,
            reversed: false,
            ..self
        }
    }

    /// Compares it with what was learnt, `period_s` after the last time. A warning, once the contradiction lasts.
    pub(super) fn weigh(&mut self, filter: &Filter, period_s: f64) -> Option<String> {
        if !filter.vertical_known || filter.disturbed() {
            return None;
        }
        let known = filter.field_in_frame();
        let squared = self.innovation(&known).map_or(0.0, |one| one.squared());
        let more_s = if squared > CONTRADICTED {
            period_s
        } else {
            -period_s
        };
        self.against_s = (self.against_s + more_s).clamp(0.0, SURE_S);
        let field = known.field();
        let found = parts(&field) * field;
        let certain = if self.reversed { CONTRADICTED } else { WARNED };
        self.reversed = squared > certain && self.is_mirrored_by(&found);
        // No iron that is passed reverses the field and nothing else.
        let sure = squared > WARNED && (self.reversed || self.against_s == SURE_S);
        if !sure || std::mem::replace(&mut self.warned, true) {
            return None;
        }
        let remedy = if self.reversed {
            "Up and down are exchanged, and headings may be off by up to 180 degrees. Check the mounting with headingd align, \
             whether the accelerometer reads gravity, and the sign of true_north.latitude_deg"
        } else {
            "Check [true_north], also the signs of its latitude and longitude, or look for iron nearby"
        };
        Some(format!(
            "the field does not match the position: {:.0} mG horizontal and {:.0} mG down, but the World Magnetic Model has {:.0} \
             and {:.0}; headings do not use the model. {remedy}",
            found.x, -found.y, self.expected.x, -self.expected.y
        ))
    }

    /// Whether these parts are the model's with up and down exchanged, as if the accelerometer read gravity, not specific force, or a chip
    /// is upside down.
    fn is_mirrored_by(&self, found: &Vector2<f64>) -> bool {
        let near = 3.0 * hypot(LOCAL, GAIN) * self.expected.norm();
        (Vector2::new(found.x, -found.y) - self.expected).norm() < near
    }

    /// The known field with this evidence; as it is while anything contradicts the evidence.
    pub(super) fn on(&self, known: FieldInFrame) -> FieldInFrame {
        let innovation = match self.innovation(&known) {
            Some(innovation) if self.against_s == 0.0 && innovation.squared() <= CONTRADICTED => {
                innovation
            }
            _ => return known,
        };
        let cross = known.covariance.fixed_columns::<3>(0) * innovation.parts.transpose();
        let gain = cross * innovation.inverse;
        FieldInFrame {
            state: known.state + gain * innovation.value,
            covariance: known.covariance - gain * cross.transpose(),
        }
    }

    /// `None` while the direction of north is hardly known.
    fn innovation(&self, known: &FieldInFrame) -> Option<Innovation> {
        let (field, covariance) = (known.field(), known.field_covariance());
        let horizontal = field.xy();
        let length = horizontal.norm();
        if length < 1.0 {
            return None;
        }
        let along = horizontal / length;
        let across = Vector2::new(-along.y, along.x);
        let own = covariance.fixed_view::<2, 2>(0, 0).into_owned();
        let variance = variance_along(&own, &across);
        if variance > (DIRECTION_RAD * length).powi(2) {
            return None;
        }
        let parts = parts(&field);
        let covariance = parts * covariance * parts.transpose() + self.covariance();
        Some(Innovation {
            parts,
            value: self.expected - parts * field,
            inverse: covariance.try_inverse()?,
        })
    }

    fn covariance(&self) -> Matrix2<f64> {
        let local = LOCAL * self.expected.norm();
        let apart = self.model_variance.map(|variance| variance + local * local);
        self.expected * self.expected.transpose() * GAIN.powi(2) + Matrix2::from_diagonal(&apart)
    }
}

/// What takes the horizontal part and the upward one out of a field.
fn parts(field: &Vector3<f64>) -> Matrix2x3<f64> {
    let along = field.xy() / field.xy().norm().max(1.0);
    Matrix2x3::new(along.x, along.y, 0.0, 0.0, 0.0, 1.0)
}
