//! Values of the magnetometer that a source holds: it reads faster than the chip measures, and gives the last value again until
//! there is a new one.

use nalgebra::Vector3;

/// No magnetometer in use measures less often, seconds: on a board at rest the same for longer is a new measurement.
const HELD_S: f64 = 0.2;

/// The newest measurement of the magnetometer.
#[derive(Default)]
pub(super) struct Newest(Option<(f64, Vector3<f64>)>);

impl Newest {
    /// Takes a value, and whether the board is still. Returns whether it is a new measurement: noise makes each one differ, and a
    /// value that is held tells where the field was some time ago.
    pub(super) fn take(&mut self, t_s: f64, field_mgauss: Vector3<f64>, still: bool) -> bool {
        let held = |(since_s, field): (f64, Vector3<f64>)| {
            field == field_mgauss && !(still && t_s - since_s >= HELD_S)
        };
        if self.0.is_some_and(held) {
            return false;
        }
        self.0 = Some((t_s, field_mgauss));
        true
    }
}
