//! Whether the accelerometer's unit is wrong: over a time, the specific force of a board on earth is as large as gravity.

use std::ops::RangeInclusive;

/// The force is averaged over this time, seconds: a hand or a car accelerates by less than gravity for as long.
const MEAN_S: f64 = 10.0;
/// A step after a pause counts for this time, seconds.
const LONGEST_S: f64 = 0.1;
/// What the mean may be, m/s²: a third of gravity to three times. Between the units m/s² and g there is a factor of ten.
const POSSIBLE_M_S2: RangeInclusive<f64> = 3.3..=29.4;

/// Averages the length of the specific force.
#[derive(Default)]
pub(super) struct ForceUnit {
    last_s: f64,
    seen_s: f64,
    /// Integral of the force over what is remembered of `seen_s`, m/s.
    sum: f64,
}

impl ForceUnit {
    /// Takes a force, m/s².
    pub(super) fn take(&mut self, t_s: f64, force_m_s2: f64) {
        let period_s = (t_s - self.last_s).clamp(0.0, LONGEST_S);
        self.last_s = t_s;
        let keep = (-period_s / MEAN_S).exp();
        self.seen_s = self.seen_s * keep + period_s;
        self.sum = self.sum * keep + period_s * force_m_s2;
    }

    /// Whether the mean is far from gravity. Nothing is said before two thirds of the time have been seen.
    pub(super) fn is_wrong(&self) -> bool {
        self.seen_s > 0.63 * MEAN_S && !POSSIBLE_M_S2.contains(&(self.sum / self.seen_s))
    }
}
