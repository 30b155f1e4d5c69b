//! Carries the state of the filter on over a window.

use nalgebra::{SMatrix, Vector3};

use super::window::Window;
use super::{A, ARM, ARM_M, B, GyroErrors, M, N, U, V};
use crate::attitude::force_readings::GRAVITY_M_S2;
use crate::frame::{add_variance, put};

/// The integral forgets over this time, seconds: a steady velocity is no acceleration.
const LEAK_S: f64 = 30.0;
/// Walk of the gyro's frame, rad/√s (0.03 °/√s): the noise density in an ITG-3200's data sheet. The estimate (`estimate/filter/predict.rs`)
/// takes a value between that and an MPU-6050's.
const ANGLE_WALK_RAD: f64 = 0.000_5;
/// The same for each radian turned: readings come up to 2 ms early or late.
const TURN_WALK_RAD: f64 = 0.003;
/// Walk of the velocity by an accelerometer's noise, m/s per √s.
const VELOCITY_WALK_M_S: f64 = 0.03;
/// A hand turns a board about the same point for this long, seconds.
const ARM_LASTS_S: f64 = 3.0;
/// Which body axis is vertical is the mean over this time, seconds.
const UPRIGHT_S: f64 = 20.0;
/// A board that has been tilted may be tilted again within this time, seconds.
const TILTS_S: f64 = 60.0;

impl GyroErrors {
    /// Carries the state over a window. Returns the integral of the specific force less u, m/s.
    pub(super) fn predict(
        &mut self,
        force: &Vector3<f64>,
        up: &Vector3<f64>,
        window: &Window,
    ) -> Vector3<f64> {
        let dt = window.length_s;
        let keep = (-dt / LEAK_S).exp();
        let left = force - up * dt;
        self.velocity = self.velocity * keep + left;
        self.watch_tilt(&window.mean_in_body(&up.normalize()), dt);

        // An error e of the rate, body axes, turns u by R e.
        let by_turn = -up.cross_matrix();
        let seen = self.across();
        // Of the transition only the rows of u and v differ from the identity's.
        let mut step = SMatrix::<f64, 6, N>::identity();
        put(&mut step, (U, B), &(by_turn * window.rotation_s * seen));
        for column in 0..3 {
            let by = by_turn * window.rotation_by_rate_rad[column] * seen;
            for row in 0..3 {
                let at = (U, M + 3 * row + column);
                put(&mut step, at, &by.column(row).into_owned());
            }
        }
        for axis in 0..3 {
            step[(V + axis, V + axis)] = keep;
            step[(V + axis, U + axis)] = -dt;
        }
        put(&mut step, (V, A), &(-self.felt_share() * window.rotation_s));
        let rows = step * self.p;
        put(&mut self.p, (U, 0), &rows);
        let columns = self.p * step.transpose();
        put(&mut self.p, (0, U), &columns);
        self.let_arm_change(dt);
        self.p = (self.p + self.p.transpose()) * 0.5;
        let walk = ANGLE_WALK_RAD.powi(2) * dt
            + TURN_WALK_RAD.powi(2) * window.path_rad
            + self.timing_walk_s2 * window.rate2_s;
        add_variance(&mut self.p, U..U + 3, walk * GRAVITY_M_S2.powi(2));
        add_variance(&mut self.p, V..V + 3, VELOCITY_WALK_M_S.powi(2) * dt);
        left
    }

    /// Takes the direction of up in body axes.
    fn watch_tilt(&mut self, up: &Vector3<f64>, dt: f64) {
        self.upright += (up - self.upright) * (dt / UPRIGHT_S);
        self.least_cos += (1.0 - self.least_cos) * (dt / TILTS_S);
        // At least 0: a board that has been upside down does not take longer to be upright.
        let cos = up.angle(&self.upright).cos().max(0.0);
        self.least_cos = self.least_cos.min(cos);
    }

    /// The arm decays to 0, and its variance returns to what is expected: the hand may turn the board about another point.
    fn let_arm_change(&mut self, dt: f64) {
        let keep = (-dt / ARM_LASTS_S).exp();
        self.arm *= keep;
        self.p.fixed_rows_mut::<3>(ARM).scale_mut(keep);
        self.p.fixed_columns_mut::<3>(ARM).scale_mut(keep);
        let gained = ARM_M.powi(2) * (1.0 - keep * keep);
        add_variance(&mut self.p, ARM..ARM + 3, gained);
    }
}
