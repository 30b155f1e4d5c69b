//! Learns the gyro's bias, scale and cross-axis errors, and the accelerometer's bias, from gravity.
//!
//! A board's velocity stays bounded, so over seconds the mean specific force in the frame that the gyro carries along is the reaction to
//! gravity. An error of the gyro turns that in the frame. A Kalman filter estimates
//!
//! | state | what it is |
//! |---|---|
//! | u | reaction to gravity in the gyro's frame, m/s²: it points up |
//! | v | velocity as the leaky integral of specific force less u, m/s |
//! | b | bias that is left in the rates, body axes, rad/s |
//! | M | scale and cross-axis errors that are left, row by row: the rates are (I + M) ω + b |
//! | a | bias that is left in the specific force, body axes, m/s² |
//! | r | arm, from the point about which a hand turns the board to its chips, body axes, m |
//!
//! In every window it takes the measurement v = R (ω × r), R from body to the gyro's frame, with the board's mean square velocity as noise.
//! Without the arm, the centripetal acceleration of a board that turns about a wrist would look like a bias of its accelerometer. b, M and
//! a go straight into what is taken out of the readings, so that their states are always 0.
//!
//! `gyro_errors/predict.rs` carries the state on over a window, `gyro_errors/measure.rs` corrects it.

use std::collections::VecDeque;

use nalgebra::{Matrix3, SMatrix, Vector3};

use super::GyroBias;
use super::bias_walk::{BiasWalk, LEAST_WALK_RAD_S};
use super::force_readings::GRAVITY_M_S2;
use crate::frame::{add_variance, reset_variance, variance_along};
use measure::HELD_BACK_WINDOWS;
use window::Window;

mod measure;
mod predict;
#[cfg(test)]
mod tests;
mod window;

const U: usize = 0;
const V: usize = 3;
const B: usize = 6;
const M: usize = 9;
const A: usize = 18;
const ARM: usize = 21;
const N: usize = 24;
type ErrorCovariance = SMatrix<f64, N, N>;

/// Scale error to expect of a gyro: an MPU-6050's data sheet allows 3 %, and all up to that is as likely, 3 % / √3. An ITG-3200's may
/// be 6 %.
const SCALE: f64 = 0.017;
/// Cross-axis errors to expect; both data sheets: 2 % at most.
const CROSS_AXIS: f64 = 0.01;
/// Bias to expect, as a share of the largest.
const BIAS: f64 = 0.33;
/// A gyro's bias at the next start differs from the last by this on an axis, rad/s (1°/s): data sheets allow 20 °/s (MPU-6050) to
/// 40 °/s (ITG-3200) over 125 K, so that is a room some kelvin warmer.
pub(super) const RESTART_BIAS_RAD_S: f64 = 0.0175;
/// Bias to expect of an accelerometer at first, m/s² (10 thousandths of g): between a trimmed chip's 5 and those of chips as delivered,
/// typically up to 35 (ADXL345) or 50 (MPU-6050). With 25, simulated boards as delivered gain a tenth of a degree, and recorded ones, which are
/// trimmed, lose up to half a degree.
const FORCE_BIAS_M_S2: f64 = 0.1;
/// Arm to expect, m: a wrist's.
const ARM_M: f64 = 0.1;
/// Share of the accelerometer's bias that is ignored on an upright board, where it only tilts the frame by a constant (the estimate learns
/// that as a rotation between the chips). A larger one makes a boat at anchor falsely sure more often; with a smaller one, motions that
/// repeat teach wrong errors of the gyro.
const STAYS: f64 = 0.7;
/// u at first: the specific force of a board that may be shaken, m/s².
const FIRST_M_S2: f64 = 2.0;
/// Velocity and acceleration of a board at first, m/s and m/s²: a hand's.
const SPEED_M_S: f64 = 1.0;
const ACCELERATION_M_S2: f64 = 1.0;
/// A larger velocity than this, m/s, is an error of another state: no vehicle that steers by a compass keeps up a fifth of g for
/// 30 s. The filter is then too sure of that error to correct it, and begins anew.
const MOST_SPEED_M_S: f64 = 60.0;
/// Walk of an accelerometer's bias, m/s² per √s: 5 thousandths of g in an hour, ten kelvin of an ADXL345 or MPU-6050.
const FORCE_BIAS_WALK_M_S2: f64 = 0.000_8;
/// A gyro's bias after a gap differs by this on an axis, rad/s (0.3°/s), its least walk of an hour: the length of the gap does not tell
/// whether the chip was off.
pub(super) const GAP_BIAS_RAD_S: f64 = 60.0 * LEAST_WALK_RAD_S;
/// A board that keeps within 18° of its mean up surely stays upright, one that has left 37° does not; cosines. Rotation about the vertical
/// of an upright board shows in gravity only as far as it sways, and accelerations sway with it.
const UPRIGHT: std::ops::Range<f64> = 0.8..0.95;

/// The filter, and the errors that it takes out of the readings of gyro and accelerometer.
pub(super) struct GyroErrors {
    /// b as it is taken out, body axes, rad/s.
    pub(super) bias: Vector3<f64>,
    /// M as it is taken out.
    pub(super) matrix: Matrix3<f64>,
    largest_bias_rad_s: f64,
    /// a as it is taken out, body axes, m/s², and r.
    pub(super) force_bias: Vector3<f64>,
    arm: Vector3<f64>,
    /// Deviation that is expected of the accelerometer's bias, m/s².
    expected_force_bias: f64,
    /// u; `None` until there is a specific force.
    up: Option<Vector3<f64>>,
    velocity: Vector3<f64>,
    /// Mean of up in body axes.
    upright: Vector3<f64>,
    /// Cosine of the largest recent angle from `upright`.
    least_cos: f64,
    /// Mean squares of velocity and acceleration on an axis.
    speed2: f64,
    acceleration2: f64,
    /// Weight of the initial `ACCELERATION_M_S2` in that mean, 0 to 1.
    expected_share: f64,
    p: ErrorCovariance,
    window: Window,
    bias_walk: BiasWalk,
    /// Walk of the times of the gyro's readings, s²/s.
    pub(super) timing_walk_s2: f64,
    /// Mean rates with the bias, one a window of rest, that are not believed yet, rad/s.
    resting: VecDeque<Vector3<f64>>,
    /// Sums and counts since the start, see [`GyroBias`].
    doubted2: f64,
    walked2: f64,
    begun_anew: u32,
}

impl GyroErrors {
    pub(super) fn new(bias_limit_rad_s: f64) -> Self {
        let mut p = ErrorCovariance::zeros();
        let expected = [
            (B, 3, BIAS * bias_limit_rad_s),
            (M, 9, CROSS_AXIS),
            // On the diagonal.
            (M, 1, SCALE),
            (M + 4, 1, SCALE),
            (M + 8, 1, SCALE),
            (A, 3, FORCE_BIAS_M_S2),
            (ARM, 3, ARM_M),
        ];
        for (at, count, sd) in expected {
            for index in at..at + count {
                p[(index, index)] = sd * sd;
            }
        }
        Self {
            bias: Vector3::zeros(),
            matrix: Matrix3::zeros(),
            largest_bias_rad_s: bias_limit_rad_s,
            force_bias: Vector3::zeros(),
            arm: Vector3::zeros(),
            expected_force_bias: FORCE_BIAS_M_S2,
            up: None,
            velocity: Vector3::zeros(),
            upright: Vector3::zeros(),
            least_cos: 1.0,
            speed2: SPEED_M_S.powi(2),
            acceleration2: ACCELERATION_M_S2.powi(2),
            expected_share: 1.0,
            p,
            window: Window::default(),
            bias_walk: BiasWalk::default(),
            timing_walk_s2: 0.0,
            resting: VecDeque::with_capacity(HELD_BACK_WINDOWS + 1),
            doubted2: 0.0,
            walked2: 0.0,
            begun_anew: 0,
        }
    }

    /// Begins with the bias of the last start, body axes, rad/s.
    pub(super) fn expect_bias(&mut self, bias_rad_s: Vector3<f64>) {
        self.bias = bias_rad_s;
        reset_variance(&mut self.p, B..B + 3, RESTART_BIAS_RAD_S.powi(2));
    }

    /// Begins with this bias of the accelerometer, body axes, m/s².
    pub(super) fn expect_force_bias(&mut self, bias_m_s2: Vector3<f64>) {
        self.force_bias = bias_m_s2;
        self.expected_force_bias = FORCE_BIAS_M_S2.max(bias_m_s2.amax());
        reset_variance(&mut self.p, A..A + 3, FORCE_BIAS_M_S2.powi(2));
    }

    /// The gyro may have been started again, or its bias has jumped: adds this deviation to that of its bias on each axis, rad/s.
    pub(super) fn doubt_bias(&mut self, sd_rad_s: f64) {
        let variance = sd_rad_s * sd_rad_s;
        self.doubted2 += variance;
        self.bias_walk.doubt(variance);
        add_variance(&mut self.p, B..B + 3, variance);
    }

    /// A rate without what is known of its errors, body axes, rad/s.
    pub(super) fn corrected(&self, rate: &Vector3<f64>) -> Vector3<f64> {
        let free = rate - self.bias;
        free - self.matrix * free
    }

    /// A specific force without what is known of the accelerometer's bias, body axes, m/s².
    pub(super) fn corrected_force(&self, force: &Vector3<f64>) -> Vector3<f64> {
        force - self.force_bias
    }

    /// Deviation of the bias across the vertical, rad/s: what tilts the frame.
    pub(super) fn bias_sd_rad_s(&self) -> f64 {
        let own = self.bias_covariance();
        let up = self.upright;
        let across = own.trace() - variance_along(&own, &up);
        (across / (3.0 - up.norm_squared())).max(0.0).sqrt()
    }

    /// The bias, and what the filter knows of it.
    pub(super) fn gyro_bias(&self) -> GyroBias {
        GyroBias {
            rad_s: self.bias,
            covariance: self.bias_covariance(),
            doubted2: self.doubted2,
            walked2: self.walked2,
            begun_anew: self.begun_anew,
        }
    }

    /// Covariance of the bias, body axes, (rad/s)².
    pub(super) fn bias_covariance(&self) -> Matrix3<f64> {
        self.p.fixed_view::<3, 3>(B, B).into()
    }

    /// Deviation of an entry of M.
    pub(super) fn matrix_sd(&self) -> f64 {
        (self.p.fixed_view::<9, 9>(M, M).trace() / 9.0).sqrt()
    }

    /// The velocity that the board has, root mean square on an axis, m/s.
    pub(super) fn speed_m_s(&self) -> f64 {
        self.speed2.sqrt()
    }

    /// Its acceleration, root mean square on an axis, m/s², without the initial value.
    pub(super) fn acceleration_m_s2(&self) -> f64 {
        let measured2 = self.acceleration2 - self.expected_share * ACCELERATION_M_S2.powi(2);
        let share = 1.0 - self.expected_share;
        (measured2 / share.max(1e-3)).max(0.0).sqrt()
    }

    /// The gyro has missed a rotation of this variance on each axis, rad².
    pub(super) fn miss(&mut self, missed_rad2: f64) {
        let turned2 = missed_rad2 * GRAVITY_M_S2.powi(2);
        add_variance(&mut self.p, U..U + 3, turned2);
    }

    /// The gyro's frame is lost.
    pub(super) fn lose_frame(&mut self) {
        self.up = None;
        self.window = Window::default();
    }

    /// Takes a tick: the rotation into the gyro's frame in its middle, the corrected rate, the specific force if it is known,
    /// and whether the board is at rest.
    pub(super) fn take(
        &mut self,
        to_frame: &Matrix3<f64>,
        rate: &Vector3<f64>,
        force: Option<&Vector3<f64>>,
        at_rest: bool,
    ) {
        let Some(window) = self.window.take(to_frame, rate, force, at_rest) else {
            return;
        };
        self.measure_bias_at_rest(&window);
        match (window.impulse_m_s, self.up) {
            (None, _) => self.up = None,
            (Some(force), None) => self.begin(&force, &window),
            (Some(force), Some(up)) => {
                let left = self.predict(&force, &up, &window);
                if window.at_rest {
                    self.measure_up_at_rest(&left, &window);
                }
                self.measure_velocity(&left, &window);
                if self.velocity.norm() > MOST_SPEED_M_S {
                    self.begin_anew();
                }
            }
        }
        self.expect_larger_force_bias();
        let (bias, seen) = (self.bias_covariance(), self.across());
        let walked2 = self
            .bias_walk
            .take(&self.bias, &bias, &seen, window.length_s);
        self.walked2 += walked2;
        add_variance(&mut self.p, B..B + 3, walked2);
        let force2 = FORCE_BIAS_WALK_M_S2.powi(2) * window.length_s;
        add_variance(&mut self.p, A..A + 3, force2);
    }

    /// A chip that shows a larger bias than was expected may show a still larger one: the expected deviation doubles.
    fn expect_larger_force_bias(&mut self) {
        if self.force_bias.amax() > self.expected_force_bias {
            let gained = 3.0 * self.expected_force_bias.powi(2);
            add_variance(&mut self.p, A..A + 3, gained);
            self.expected_force_bias *= 2.0;
        }
    }

    /// Begins anew, but keeps the accelerometer's bias: it levels the frame.
    fn begin_anew(&mut self) {
        let mut anew = Self {
            timing_walk_s2: self.timing_walk_s2,
            force_bias: self.force_bias,
            expected_force_bias: self.expected_force_bias,
            ..Self::new(self.largest_bias_rad_s)
        };
        anew.inherit_totals(self);
        *self = anew;
    }

    /// Takes over from a filter that is dropped: its sums since the start, its count plus one, and how fast its bias walks.
    pub(super) fn inherit_totals(&mut self, before: &Self) {
        self.doubted2 = before.doubted2;
        self.walked2 = before.walked2;
        self.bias_walk = before.bias_walk.clone();
        self.bias_walk.begin_window();
        self.begun_anew = before.begun_anew + 1;
    }

    fn begin(&mut self, force: &Vector3<f64>, window: &Window) {
        let up = force / window.length_s;
        self.up = Some(up);
        self.upright = window.mean_in_body(&up.normalize());
        self.velocity.fill(0.0);
        reset_variance(&mut self.p, U..U + 3, FIRST_M_S2.powi(2));
        reset_variance(&mut self.p, V..V + 3, self.speed2);
        self.arm.fill(0.0);
        reset_variance(&mut self.p, ARM..ARM + 3, ARM_M.powi(2));
    }

    /// How much of the accelerometer's bias counts, 0 to 1, see `STAYS`.
    fn felt_share(&self) -> f64 {
        1.0 - STAYS * self.upright_share()
    }

    /// How surely the board stays upright, 0 to 1.
    pub(super) fn upright_share(&self) -> f64 {
        let beyond = self.least_cos - UPRIGHT.start;
        (beyond / (UPRIGHT.end - UPRIGHT.start)).clamp(0.0, 1.0)
    }

    /// Projection that removes an upright board's vertical, body axes.
    fn across(&self) -> Matrix3<f64> {
        let up = self.upright / self.upright.norm().max(1e-9);
        Matrix3::identity() - up * up.transpose() * self.upright_share()
    }
}
