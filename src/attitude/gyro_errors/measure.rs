//! Corrects the filter by what a window shows.

use nalgebra::{Matrix3, SMatrix, Vector3};

use super::window::Window;
use super::{A, ARM, B, GyroErrors, M, N, U, V};
use crate::attitude::follow;
use crate::frame::{reset_variance, rows};

/// Most that is taken out: the 6 % of an ITG-3200, and some drift with temperature. Larger errors are another fault.
pub(super) const MOST_MATRIX: f64 = 0.07;
/// Most that is taken out of the specific force, m/s²: the 250 thousandths of g of an ADXL345's Z at worst.
const MOST_FORCE_BIAS_M_S2: f64 = 2.5;
/// Least velocity that is believed, m/s.
const LEAST_SPEED_M_S: f64 = 0.1;
/// The mean square velocity grows within the first of these times, seconds, and shrinks within the second; that of the acceleration takes
/// the second for both.
const GROWS_S: f64 = 1.0;
const SHRINKS_S: f64 = 60.0;
/// A velocity lasts for this share of the time in which the acceleration makes it, within limits, seconds.
const LASTS: f64 = 0.5;
const LASTS_S: std::ops::RangeInclusive<f64> = 0.1..=30.0;
/// A gyro at rest reads its bias, and an accelerometer gravity, within this over one second, rad/s (0.4 °/s) and m/s²: an ITG-3200's total
/// noise of 0.38 °/s, though the mean over a second has less, its 0.1 °/s a g, and hands that are not quite at rest. The estimate has a
/// smaller rate, see `estimate/filter/gyro_bias.rs`: with a larger one north drifts in hours of rest.
const REST_RATE_RAD_S: f64 = 0.007;
const REST_FORCE_M_S2: f64 = 0.1;
/// Rest is still reported for a moment after a gentle start: the newest windows are held back.
pub(super) const HELD_BACK_WINDOWS: usize = 8;

impl GyroErrors {
    /// At rest the gyro reads its bias.
    pub(super) fn measure_bias_at_rest(&mut self, window: &Window) {
        if !window.at_rest {
            self.resting.clear();
            return;
        }
        self.resting
            .push_back(window.angle_rad / window.length_s + self.bias);
        if self.resting.len() > HELD_BACK_WINDOWS
            && let Some(raw) = self.resting.pop_front()
        {
            let variance = REST_RATE_RAD_S.powi(2) / window.length_s;
            self.correct((B, B), &Matrix3::zeros(), &(raw - self.bias), variance);
        }
    }

    /// The board is at rest: its velocity is 0, and all specific force is gravity's and the accelerometer's bias.
    pub(super) fn measure_up_at_rest(&mut self, left: &Vector3<f64>, window: &Window) {
        let dt = window.length_s;
        let by_bias = window.rotation_s * (self.felt_share() / dt);
        self.correct((U, A), &by_bias, &(left / dt), REST_FORCE_M_S2.powi(2) / dt);
        self.velocity.fill(0.0);
        reset_variance(&mut self.p, V..V + 3, LEAST_SPEED_M_S.powi(2));
    }

    /// The chips' velocity is R (ω × r), within those that this board has.
    pub(super) fn measure_velocity(&mut self, left: &Vector3<f64>, window: &Window) {
        let dt = window.length_s;
        let uncertain = self.p.fixed_view::<3, 3>(V, V).trace();
        // On each of the two axes in which boards mostly move.
        let now = 0.5 * (self.velocity.norm_squared() - uncertain);
        follow(&mut self.speed2, now, dt, (GROWS_S, SHRINKS_S));
        self.speed2 = self.speed2.max(LEAST_SPEED_M_S.powi(2));
        let now = 0.5 * left.norm_squared() / (dt * dt);
        follow(&mut self.acceleration2, now, dt, (SHRINKS_S, SHRINKS_S));
        self.expected_share *= 1.0 - dt / SHRINKS_S;
        let lasts_s = LASTS * (self.speed2 / self.acceleration2.max(1e-6)).sqrt();
        let lasts_s = lasts_s.clamp(*LASTS_S.start(), *LASTS_S.end());
        // Neighbouring windows share their velocity.
        let variance = self.speed2 * 2.0 * lasts_s / dt;
        // −R [ω]×, the mean over the window, of which `rotation_s` and `angle_rad` are integrals.
        let by_arm = -window.rotation_s * (window.angle_rad / dt.powi(2)).cross_matrix();
        let innovation = -self.velocity - by_arm * self.arm;
        self.correct((V, ARM), &by_arm, &innovation, variance);
    }

    /// Takes in a measurement of three states plus `by` times three others, each with this variance.
    fn correct(
        &mut self,
        (at, other): (usize, usize),
        by: &Matrix3<f64>,
        innovation: &Vector3<f64>,
        variance: f64,
    ) {
        let cross =
            self.p.fixed_columns::<3>(at) + self.p.fixed_columns::<3>(other) * by.transpose();
        let own = cross.fixed_rows::<3>(at) + by * cross.fixed_rows::<3>(other);
        let scatter = own + Matrix3::identity() * variance;
        let Some(inverse) = scatter.try_inverse() else {
            return;
        };
        let mut gain = cross * inverse;
        self.hold_unseen(&mut gain);
        // P − K Cᵀ − C Kᵀ + K S Kᵀ holds for any gain K, also for one that holds states back.
        let learnt = gain * cross.transpose();
        self.p += gain * scatter * gain.transpose() - learnt - learnt.transpose();
        let change = gain * innovation;
        if let Some(up) = &mut self.up {
            *up += change.fixed_rows::<3>(U);
        }
        self.velocity += change.fixed_rows::<3>(V);
        let most = MOST_FORCE_BIAS_M_S2;
        self.force_bias =
            (self.force_bias + change.fixed_rows::<3>(A)).map(|bias| bias.clamp(-most, most));
        self.arm += change.fixed_rows::<3>(ARM);
        let most = self.largest_bias_rad_s;
        self.bias = (self.bias + change.fixed_rows::<3>(B)).map(|bias| bias.clamp(-most, most));
        let rows = Matrix3::from_row_slice(change.fixed_rows::<9>(M).as_slice());
        self.matrix = (self.matrix + rows).map(|entry| entry.clamp(-MOST_MATRIX, MOST_MATRIX));
    }

    /// Takes out of a gain what gravity does not show on a board that stays upright:
    ///
    /// - the gyro's errors about the vertical, M's row for that axis. While the board sways, the axis that is taken for the vertical sways
    ///   with it and lets a little through. If the motion repeats, that little always has the same sign. Without holding it back, rates
    ///   about the vertical were off by a fifth after four hours;
    /// - the accelerometer's bias: accelerations would teach a wrong one.
    fn hold_unseen(&self, gain: &mut SMatrix<f64, N, 3>) {
        let seen = self.across();
        for innovation in 0..3 {
            let mut column = gain.fixed_view_mut::<9, 1>(M, innovation);
            let left = seen * Matrix3::from_row_slice(column.as_slice());
            column.copy_from(&rows(&left));
        }
        gain.fixed_rows_mut::<3>(A)
            .scale_mut(1.0 - self.upright_share());
    }
}
