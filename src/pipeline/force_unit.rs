//! Whether the accelerometer's unit is wrong: over a time, the specific force of a board on earth is as large as gravity.

use std::ops::RangeInclusive;

/// The force is averaged over this time, seconds: a hand or a car accelerates by less than gravity for as long.
const MEAN_S: f64 = 10.0;
/// Share of `MEAN_S` that `seen_s` reaches in that time, 1 − 1/e.
const SEEN: f64 = 0.63;
/// A step after a pause counts for this time, seconds.
const LONGEST_S: f64 = 0.1;
/// What the mean may be, m/s²: a third of gravity to three times. Between the units m/s² and g there is a factor of ten.
const POSSIBLE_M_S2: RangeInclusive<f64> = 3.3..=29.4;

/// Averages the length of the specific force.
#[derive(Default)]
pub(super) struct ForceUnit {
    last_s: f64,
    /// Integrals of 1 and of the force, forgotten in `MEAN_S`.
    seen_s: f64,
    sum_m_s: f64,
}

impl ForceUnit {
    /// Takes a force, m/s².
    pub(super) fn take(&mut self, t_s: f64, force_m_s2: f64) {
        let period_s = (t_s - self.last_s).clamp(0.0, LONGEST_S);
        self.last_s = t_s;
        let keep = (-period_s / MEAN_S).exp();
        self.seen_s = self.seen_s * keep + period_s;
        self.sum_m_s = self.sum_m_s * keep + period_s * force_m_s2;
    }

    /// Whether the mean is far from gravity. Nothing is said in the first `MEAN_S`.
    pub(super) fn is_wrong(&self) -> bool {
        let mean_m_s2 = self.sum_m_s / self.seen_s;
        self.seen_s > SEEN * MEAN_S && !POSSIBLE_M_S2.contains(&mean_m_s2)
    }
}
