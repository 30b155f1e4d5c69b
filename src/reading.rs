//! One timed reading of a board: what the sensors measured at one instant, in their own chip axes.
//!
//! Real parts tick apart, so a [`Reading`] carries a time and the sensors that were read. Nothing below
//! assumes that they come together or evenly.

use std::ops::RangeInclusive;

use nalgebra::Vector3;

/// The strongest field of the earth, milligauss.
pub const STRONGEST_MGAUSS: f64 = 670.0;

/// The weakest field of the earth, milligauss.
pub const WEAKEST_MGAUSS: f64 = 220.0;

/// Strengths that a compass may find, milligauss: half to twice the earth's. Outside, its magnetometer's unit or range is
/// wrong.
pub const EARTH_MGAUSS: RangeInclusive<f64> = 0.5 * WEAKEST_MGAUSS..=2.0 * STRONGEST_MGAUSS;

/// Weakest horizontal field that a compass may find, milligauss: half of the 60 below which, near the magnetic poles, the World Magnetic Model
/// warns of using one.
pub const LEAST_HORIZONTAL_MGAUSS: f64 = 30.0;

/// Standard gravity, m/s².
pub const STANDARD_GRAVITY_M_S2: f64 = 9.80665;

/// The longest period of a sensor in use, seconds. A source that reads faster gives the last value again until there is a new one; if
/// the board is at rest, an equal value after this time is a new one.
pub const HELD_S: f64 = 0.2;

/// With noise of one step, a working axis of a magnetometer repeats a number this often in a row in fewer than 1 of 5000 cases.
pub(crate) const SAME_SAMPLES: usize = 10;

/// An axis that repeats a number where it should have changed by more than this many of its steps is stuck, or at the end of its range.
pub(crate) const LEAST_STEPS: f64 = 2.0;

/// A magnetometer's three axes in milligauss, chip axes. `None` is an axis that overflowed: the chip
/// answered, but this number is not a measurement.
pub type Field = [Option<f64>; 3];

/// What a board's sensors measured at one instant.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Reading {
    /// Seconds from the source's own monotonic origin.
    pub t_s: f64,
    /// Raw magnetic field in milligauss, magnetometer chip axes; never corrected, since fitting is done
    /// on raw samples only.
    pub field_mgauss: Option<Field>,
    /// Angular rate in rad/s, gyro chip axes, bias included.
    pub rate_rad_s: Option<Vector3<f64>>,
    /// Specific force in m/s², accelerometer chip axes (at rest it points up, 9.8 long).
    pub specific_force_m_s2: Option<Vector3<f64>>,
}

impl Reading {
    /// The field, if there is one and no axis overflowed.
    pub fn whole_field_mgauss(&self) -> Option<Vector3<f64>> {
        match self.field_mgauss? {
            [Some(x), Some(y), Some(z)] => Some(Vector3::new(x, y, z)),
            _ => None,
        }
    }

    /// Field, rate and force as a log has them. A number that is not finite is no measurement: its axis of the magnetometer
    /// is left empty, of the gyro and the accelerometer all three.
    pub fn cells(&self) -> [[Option<f64>; 3]; 3] {
        let whole = |vector: Option<Vector3<f64>>| match vector {
            Some(v) if v.iter().all(|n| n.is_finite()) => [Some(v.x), Some(v.y), Some(v.z)],
            _ => [None; 3],
        };
        let field = self.field_mgauss.unwrap_or_default();
        [
            field.map(|axis| axis.filter(|n| n.is_finite())),
            whole(self.rate_rad_s),
            whole(self.specific_force_m_s2),
        ]
    }

    /// There is a field, but at least one axis overflowed.
    pub fn field_overflowed(&self) -> bool {
        self.field_mgauss.is_some() && self.whole_field_mgauss().is_none()
    }
}
