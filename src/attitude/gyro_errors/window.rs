//! Ticks taken together: to run the filter of the gyro's errors at every tick would cost too much.

use nalgebra::{Matrix3, Vector3};

use crate::attitude::clock::TICK_S;

/// Length of a window, seconds.
const WINDOW_S: f64 = 0.1;

/// Integrals over the ticks of a window.
pub(super) struct Window {
    pub(super) s: f64,
    /// Of the specific force in the frame, m/s; `None` if it is not known throughout.
    pub(super) force: Option<Vector3<f64>>,
    /// Of the rotation into the frame, seconds, and of that times each body axis's rate, radians.
    pub(super) turn: Matrix3<f64>,
    pub(super) turn_by: [Matrix3<f64>; 3],
    /// Of the rate, radians, of its length, and of its square, rad²/s.
    pub(super) rate: Vector3<f64>,
    pub(super) turned: f64,
    pub(super) rate2: f64,
    pub(super) at_rest: bool,
}

impl Default for Window {
    fn default() -> Self {
        Self {
            s: 0.0,
            force: Some(Vector3::zeros()),
            turn: Matrix3::zeros(),
            turn_by: [Matrix3::zeros(); 3],
            rate: Vector3::zeros(),
            turned: 0.0,
            rate2: 0.0,
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
        self.s += TICK_S;
        self.at_rest &= at_rest;
        self.force = (self.force.zip(force)).map(|(sum, force)| sum + to_frame * force * TICK_S);
        self.turn += to_frame * TICK_S;
        for axis in 0..3 {
            self.turn_by[axis] += to_frame * (rate[axis] * TICK_S);
        }
        self.rate += rate * TICK_S;
        self.turned += rate.norm() * TICK_S;
        self.rate2 += rate.norm_squared() * TICK_S;
        // Half a tick, for sums of floats.
        (self.s > WINDOW_S - 0.5 * TICK_S).then(|| std::mem::take(self))
    }

    /// Where this vector of the frame is on average, body axes.
    pub(super) fn mean_in_body(&self, vector: &Vector3<f64>) -> Vector3<f64> {
        self.turn.transpose() * vector / self.s
    }
}
