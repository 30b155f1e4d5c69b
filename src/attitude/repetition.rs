//! How long the gyro reads the same to the last bit, beyond the usual repetition of its readings.

use nalgebra::Vector3;

use super::follow;
use crate::reading::HELD_S;

/// The usual repetition grows with one reading and shrinks over ten: one reading of ten may be the same by chance.
const HOLD_READINGS: (f64, f64) = (1.0, 10.0);

/// Follows the gyro's readings.
#[derive(Default)]
pub(super) struct Repetition {
    /// The newest reading, and since when it has been repeated.
    newest: Option<(Vector3<f64>, f64)>,
    newest_s: f64,
    /// How long the source usually repeats a reading before the next one, seconds.
    usual_s: f64,
}

impl Repetition {
    /// Takes a reading, chip axes. If it differs from the one before, returns when that one was first read, and its value.
    pub(super) fn take(&mut self, t_s: f64, chip: Vector3<f64>) -> Option<(f64, Vector3<f64>)> {
        let before = self.newest.filter(|(same, _)| *same != chip);
        if let Some((_, since_s)) = before
            && self.newest_s - since_s <= HELD_S
        {
            follow(
                &mut self.usual_s,
                self.newest_s - since_s,
                1.0,
                HOLD_READINGS,
            );
        }
        if before.is_some() || self.newest.is_none() {
            self.newest = Some((chip, t_s));
        }
        self.newest_s = t_s;
        before.map(|(last, since_s)| (since_s, last))
    }

    /// How long the newest reading has been repeated, beyond what is usual, seconds.
    pub(super) fn unusual_s(&self) -> f64 {
        let repeated_s = |(_, since_s)| self.newest_s - since_s - self.usual_s;
        self.newest.map_or(0.0, repeated_s).max(0.0)
    }
}
