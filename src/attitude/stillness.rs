//! Whether the board moves, by gyro and accelerometer alone: a magnet that passes a board at rest must not look
//! like motion.

use nalgebra::Vector3;

use super::clock::TICK_S;

/// Gyro and accelerometer are compared with their means over this time, seconds.
const MEAN_S: f64 = 0.5;
/// A rate further from the bias learnt so far, or from its own mean, is motion, rad/s (2°/s, as VQF has it).
pub(super) const MOVING_RAD_S: f64 = 2.0 * std::f64::consts::PI / 180.0;
/// A specific force further from its mean is motion, m/s² (as VQF has it).
const FORCE_M_S2: f64 = 0.5;
/// Both must be quiet for this long, seconds.
const QUIET_S: f64 = 0.5;

/// Watches gyro and accelerometer.
#[derive(Default)]
pub(super) struct Stillness {
    mean_rate: Vector3<f64>,
    mean_force: Option<Vector3<f64>>,
    quiet_s: f64,
}

impl Stillness {
    /// Takes one tick: the rate freed of its bias and the specific force, if there is one.
    pub(super) fn take(&mut self, rate: Vector3<f64>, force: Option<Vector3<f64>>) {
        let gain = TICK_S / (TICK_S + MEAN_S);
        self.mean_rate += (rate - self.mean_rate) * gain;
        let mut quiet =
            self.mean_rate.norm() < MOVING_RAD_S && (rate - self.mean_rate).norm() < MOVING_RAD_S;
        if let Some(force) = force {
            let mean = self.mean_force.get_or_insert(force);
            *mean += (force - *mean) * gain;
            quiet &= (force - *mean).norm() < FORCE_M_S2;
        }
        self.quiet_s = if quiet { self.quiet_s + TICK_S } else { 0.0 };
    }

    /// Whether the board has stood still lately.
    pub(super) fn still(&self) -> bool {
        self.quiet_s >= QUIET_S
    }
}
