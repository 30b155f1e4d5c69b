//! Ticks taken together: to run the filter of the gyro's errors at every tick would cost too much.

use nalgebra::{Matrix3, Vector3};

use crate::attitude::clock::TICK_S;

/// Length of a window, seconds.
const WINDOW_S: f64 = 0.1;

/// Integrals over the ticks of a window.
pub(super) struct Window {
    pub(super) length_s: f64,
    /// Of the specific force in the frame; `None` if it is not known throughout.
    pub(super) impulse_m_s: Option<Vector3<f64>>,
    /// Of the rotation into the frame, and of that times each body axis's rate.
    pub(super) rotation_s: Matrix3<f64>,
    pub(super) rotation_by_rate_rad: [Matrix3<f64>; 3],
    /// Of the rate, of its length, and of its square, rad²/s.
    pub(super) angle_rad: Vector3<f64>,
    pub(super) path_rad: f64,
    pub(super) rate2_s: f64,
    pub(super) at_rest: bool,
}

impl Default for Window {
    fn default() -> Self {
        Self {
            length_s: 0.0,
            impulse_m_s: Some(Vector3::zeros()),
            rotation_s: Matrix3::zeros(),
            rotation_by_rate_rad: [Matrix3::zeros(); 3],
            angle_rad: Vector3::zeros(),
            path_rad: 0.0,
            rate2_s: 0.0,
            at_rest: true,
        }
    }
}

impl Window {
    /// Takes a tick: the rotation into the gyro's frame in its middle, the corrected rate, the specific force if it is known,
    /// and whether the board is at rest. Returns the window if it is complete, and begins the next.
    pub(super) fn take(
        &mut self,
        to_frame: &Matrix3<f64>,
        rate: &Vector3<f64>,
        force: Option<&Vector3<f64>>,
        at_rest: bool,
    ) -> Option<Self> {
        self.length_s += TICK_S;
        self.at_rest &= at_rest;
        self.impulse_m_s =
            (self.impulse_m_s.zip(force)).map(|(sum, force)| sum + to_frame * force * TICK_S);
        self.rotation_s += to_frame * TICK_S;
        for axis in 0..3 {
            self.rotation_by_rate_rad[axis] += to_frame * (rate[axis] * TICK_S);
        }
        self.angle_rad += rate * TICK_S;
        self.path_rad += rate.norm() * TICK_S;
        self.rate2_s += rate.norm_squared() * TICK_S;
        // Half a tick, for sums of floats.
        (self.length_s > WINDOW_S - 0.5 * TICK_S).then(|| std::mem::take(self))
    }

    /// Where this vector of the frame is on average, body axes.
    pub(super) fn mean_in_body(&self, vector: &Vector3<f64>) -> Vector3<f64> {
        self.rotation_s.transpose() * vector / self.length_s
    }
}
