//! The newest measurement of the magnetometer, and when it was made.
//!
//! A source that reads faster than the chip measures gives the last value again until there is a new one, and a host that pauses
//! gives values late.

use nalgebra::Vector3;

use crate::attitude::Lateness;
use crate::reading::HELD_S;

/// The newest measurement of the magnetometer.
#[derive(Default)]
pub(super) struct Newest {
    /// When it came, and the field.
    value: Option<(f64, Vector3<f64>)>,
    late: Lateness,
}

impl Newest {
    /// Takes a value; `still` says whether the board is still. Returns when the chip measured it, not corrected for its lag, or `None`
    /// if the source repeats the last value. Noise makes every measurement differ.
    pub(super) fn take(&mut self, t_s: f64, field: Vector3<f64>, still: bool) -> Option<f64> {
        let held = |(since_s, last): (f64, Vector3<f64>)| {
            field == last && !(still && t_s - since_s >= HELD_S)
        };
        if self.value.is_some_and(held) {
            return None;
        }
        self.value = Some((t_s, field));
        Some(t_s - self.late.take(t_s))
    }
}
