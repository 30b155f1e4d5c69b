//! Learns the gyro's bias, scale and cross-axis errors from gravity.
//!
//! A board moves, but it does not fly away: its velocity stays bounded, so over seconds the specific force in the frame that
//! the gyro carries along is the reaction to gravity. An error of the gyro turns that in the frame. A Kalman filter
//! estimates
//!
//! | state | what it is |
//! |---|---|
//! | u | reaction to gravity in the gyro's frame, m/s²: it points up |
//! | v | velocity as the leaky integral of specific force less u, m/s |
//! | b | bias that is left in the rates, body axes, rad/s |
//! | M | scale and cross-axis errors that are left, row by row: the rates are (I + M) ω + b |
//! | a | bias of the accelerometer, body axes, m/s² |
//!
//! and measures in every window that v is 0, within the velocities that this board has. b and M go straight into what
//! is taken out of the rates, so that the states of both are always 0.

use std::collections::VecDeque;

use nalgebra::{Matrix3, SMatrix, Vector3};

use super::gravity::GRAVITY_M_S2;
use super::{GyroBias, follow};
use crate::frame::rows;
use window::Window;

#[cfg(test)]
mod tests;
mod window;

const U: usize = 0;
const V: usize = 3;
const B: usize = 6;
const M: usize = 9;
const A: usize = 18;
const N: usize = 21;
type ErrorCovariance = SMatrix<f64, N, N>;

/// Scale error to expect of a gyro: an MPU-6050's data sheet allows 3 %, and all up to that is as likely, 3 % / √3. An ITG-3200's may
/// be 6 %.
const SCALE: f64 = 0.017;
/// Cross-axis errors to expect; both data sheets: 2 % at most.
const CROSS_AXIS: f64 = 0.01;
/// Most that is taken out: the 6 % of an ITG-3200, and some drift with temperature. Larger errors are another fault.
const MOST_MATRIX: f64 = 0.07;
/// Bias to expect, as a share of the largest.
const BIAS: f64 = 0.33;
/// A gyro's bias at the next start differs from the last by this on an axis, rad/s (1°/s): data sheets allow 20 °/s (MPU-6050) to
/// 40 °/s (ITG-3200) over 125 K, so that is a room some kelvin warmer.
pub(super) const RESTART_BIAS_RAD_S: f64 = 0.0175;
/// Bias to expect of an accelerometer, m/s² (5 thousandths of g).
const FORCE_BIAS_M_S2: f64 = 0.05;
/// u at first: the specific force of a board that may be shaken, m/s².
const FIRST_M_S2: f64 = 2.0;
/// The integral forgets over this time, seconds: a steady velocity is no acceleration.
const LEAK_S: f64 = 30.0;
/// Velocity and acceleration of a board at first, m/s and m/s²: a hand's.
const SPEED_M_S: f64 = 1.0;
const ACCELERATION_M_S2: f64 = 1.0;
/// Least velocity that is believed, m/s.
const LEAST_SPEED_M_S: f64 = 0.1;
/// A larger velocity than this, m/s, is an error of u, b or M: no vehicle that steers by a compass keeps up a fifth of g for
/// `LEAK_S`. The filter is then too sure of that error to correct it, and begins anew.
const MOST_SPEED_M_S: f64 = 60.0;
/// Velocity and acceleration are measured over these times, seconds: quickly when they grow, slowly when they shrink.
const GROWS_S: f64 = 1.0;
const SHRINKS_S: f64 = 60.0;
/// A velocity lasts for this share of the time in which the acceleration makes it, within limits, seconds.
const LASTS: f64 = 0.5;
const LASTS_S: std::ops::RangeInclusive<f64> = 0.1..=30.0;
/// Walk of the gyro's frame, rad/√s (0.03 °/√s, the noise density of an ITG-3200's data sheet).
const ANGLE_WALK_RAD: f64 = 0.000_5;
/// The same for each radian turned: readings come up to 2 ms early or late.
const TURN_WALK_RAD: f64 = 0.003;
/// Walk of a gyro's bias, rad/s per √s: 0.3°/s in an hour of warming up.
pub const GYRO_BIAS_WALK_RAD_S: f64 = 0.000_087;
/// A gyro's bias after a gap differs by this on an axis, rad/s (0.3°/s), its walk of an hour: times do not tell how long a chip or its recorder
/// was off.
pub(super) const GAP_BIAS_RAD_S: f64 = 60.0 * GYRO_BIAS_WALK_RAD_S;
/// Walk of the velocity by an accelerometer's noise, m/s per √s.
const VELOCITY_WALK_M_S: f64 = 0.03;
/// A gyro at rest reads its bias, and an accelerometer gravity, within this over one second, rad/s and m/s²: the ITG-3200's
/// noise of up to 0.38 °/s, its 0.1 °/s a g, and hands that are not quite at rest.
const REST_RATE_RAD_S: f64 = 0.007;
const REST_FORCE_M_S2: f64 = 0.1;
/// It takes a moment to see that a gentle start was one: so many windows of rest are held back.
const DOUBTED: usize = 8;
/// Which body axis is vertical is the mean over this time, seconds. A board whose mean is longer than this, of 1, stays
/// upright (tilts by less than 37° to 18°): its rotation about the vertical shows in gravity only as far as it sways, and
/// accelerations sway with it.
const UPRIGHT_S: f64 = 20.0;
const UPRIGHT: std::ops::Range<f64> = 0.8..0.95;
/// The same over a longer time, seconds: a board that stays upright for minutes may do so for hours, and what it learns wrongly adds up.
const STAYS_UPRIGHT_S: f64 = 60.0;

/// How surely a board whose up has this mean in body axes stays upright, 0 to 1.
fn share(upright: &Vector3<f64>) -> f64 {
    let beyond = upright.norm() - UPRIGHT.start;
    (beyond / (UPRIGHT.end - UPRIGHT.start)).clamp(0.0, 1.0)
}

/// Takes away the vertical of a board that stays upright, body axes.
fn across(upright: &Vector3<f64>) -> Matrix3<f64> {
    let up = upright / upright.norm().max(1e-9);
    Matrix3::identity() - up * up.transpose() * share(upright)
}

/// The filter, and the errors that it takes out of the gyro's rates.
pub(super) struct GyroErrors {
    /// Body axes, rad/s.
    pub(super) bias: Vector3<f64>,
    matrix: Matrix3<f64>,
    largest_bias_rad_s: f64,
    force_bias: Vector3<f64>,
    /// u; `None` until there is a specific force.
    up: Option<Vector3<f64>>,
    velocity: Vector3<f64>,
    /// Mean of up in body axes.
    upright: Vector3<f64>,
    /// The same over `STAYS_UPRIGHT_S`; 0 at first.
    long_upright: Vector3<f64>,
    /// Mean squares of velocity and acceleration on an axis.
    speed2: f64,
    acceleration2: f64,
    /// Weight of the initial `ACCELERATION_M_S2` in that mean, 0 to 1.
    expected_share: f64,
    p: ErrorCovariance,
    window: Window,
    /// Walk of the times of the gyro's readings, s²/s.
    pub(super) timing_walk_s2: f64,
    /// Mean rates with the bias, one a window of rest, that are not believed yet, rad/s.
    resting: VecDeque<Vector3<f64>>,
    /// Counts, see [`GyroBias`].
    doubted2: f64,
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
            up: None,
            velocity: Vector3::zeros(),
            upright: Vector3::zeros(),
            long_upright: Vector3::zeros(),
            speed2: SPEED_M_S.powi(2),
            acceleration2: ACCELERATION_M_S2.powi(2),
            expected_share: 1.0,
            p,
            window: Window::default(),
            timing_walk_s2: 0.0,
            resting: VecDeque::with_capacity(DOUBTED + 1),
            doubted2: 0.0,
            begun_anew: 0,
        }
    }

    /// Begins with the bias of the last start, body axes, rad/s.
    pub(super) fn expect_bias(&mut self, bias_rad_s: Vector3<f64>) {
        self.bias = bias_rad_s;
        self.clear(B, RESTART_BIAS_RAD_S);
    }

    /// The gyro may have been started again, or its bias has jumped: adds this deviation to that of its bias on each axis, rad/s.
    pub(super) fn doubt_bias(&mut self, sd_rad_s: f64) {
        let variance = sd_rad_s * sd_rad_s;
        self.doubted2 += variance;
        for axis in B..B + 3 {
            self.p[(axis, axis)] += variance;
        }
    }

    /// A rate without what is known of its errors, body axes, rad/s.
    pub(super) fn corrected(&self, rate: &Vector3<f64>) -> Vector3<f64> {
        let free = rate - self.bias;
        free - self.matrix * free
    }

    /// Deviation of the bias across the vertical, rad/s: what tilts the frame.
    pub(super) fn bias_sd_rad_s(&self) -> f64 {
        let own = self.bias_covariance();
        let up = self.upright;
        let across = own.trace() - (up.transpose() * own * up)[0];
        (across / (3.0 - up.norm_squared())).max(0.0).sqrt()
    }

    /// The bias, and what the filter knows of it.
    pub(super) fn gyro_bias(&self) -> GyroBias {
        GyroBias {
            rad_s: self.bias,
            covariance: self.bias_covariance(),
            doubted2: self.doubted2,
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
        for axis in 0..3 {
            self.p[(U + axis, U + axis)] += missed_rad2 * GRAVITY_M_S2.powi(2);
        }
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
        match (window.force, self.up) {
            (None, _) => self.up = None,
            (Some(force), None) => self.begin(&force, &window),
            (Some(force), Some(up)) => {
                let left = self.predict(&force, &up, &window);
                if window.at_rest {
                    self.measure_up_at_rest(&left, window.s);
                }
                self.measure_velocity(&left, window.s);
                if self.velocity.norm() > MOST_SPEED_M_S {
                    self.begin_anew();
                }
            }
        }
        for axis in 0..3 {
            self.p[(B + axis, B + axis)] += GYRO_BIAS_WALK_RAD_S.powi(2) * window.s;
        }
    }

    fn begin_anew(&mut self) {
        let mut anew = Self {
            timing_walk_s2: self.timing_walk_s2,
            ..Self::new(self.largest_bias_rad_s)
        };
        anew.take_place_of(self);
        *self = anew;
    }

    /// Carries on the counts of errors that are forgotten.
    pub(super) fn take_place_of(&mut self, before: &Self) {
        self.doubted2 = before.doubted2;
        self.begun_anew = before.begun_anew + 1;
    }

    /// At rest the gyro reads its bias.
    fn measure_bias_at_rest(&mut self, window: &Window) {
        if !window.at_rest {
            self.resting.clear();
            return;
        }
        self.resting.push_back(window.rate / window.s + self.bias);
        if self.resting.len() > DOUBTED
            && let Some(raw) = self.resting.pop_front()
        {
            let variance = REST_RATE_RAD_S.powi(2) / window.s;
            self.correct(B, &(raw - self.bias), variance);
        }
    }

    fn begin(&mut self, force: &Vector3<f64>, window: &Window) {
        let up = force / window.s;
        self.up = Some(up);
        self.upright = window.mean_in_body(&up.normalize());
        self.velocity.fill(0.0);
        self.clear(U, FIRST_M_S2);
        self.clear(V, self.speed2.sqrt());
    }

    /// Carries the state over a window. What the specific force is more than u accounts for, integrated, m/s.
    fn predict(
        &mut self,
        force: &Vector3<f64>,
        up: &Vector3<f64>,
        window: &Window,
    ) -> Vector3<f64> {
        let dt = window.s;
        let keep = (-dt / LEAK_S).exp();
        let left = force - up * dt - window.turn * self.force_bias;
        self.velocity = self.velocity * keep + left;
        let upright = window.mean_in_body(&up.normalize());
        self.upright += (upright - self.upright) * (dt / UPRIGHT_S);
        self.long_upright += (upright - self.long_upright) * (dt / STAYS_UPRIGHT_S);

        // An error e of the rate, body axes, turns u by R e.
        let by_turn = -up.cross_matrix();
        let seen = across(&self.upright);
        // Of the transition only the rows of u and v differ from the identity's.
        let mut step = SMatrix::<f64, 6, N>::identity();
        step.fixed_view_mut::<3, 3>(U, B)
            .copy_from(&(by_turn * window.turn * seen));
        for column in 0..3 {
            let by = by_turn * window.turn_by[column] * seen;
            for row in 0..3 {
                step.fixed_view_mut::<3, 1>(U, M + 3 * row + column)
                    .copy_from(&by.column(row));
            }
        }
        for axis in 0..3 {
            step[(V + axis, V + axis)] = keep;
            step[(V + axis, U + axis)] = -dt;
        }
        step.fixed_view_mut::<3, 3>(V, A).copy_from(&-window.turn);
        let rows = step * self.p;
        self.p.fixed_rows_mut::<6>(U).copy_from(&rows);
        let columns = self.p * step.transpose();
        self.p.fixed_columns_mut::<6>(U).copy_from(&columns);
        self.p = (self.p + self.p.transpose()) * 0.5;
        let walk = ANGLE_WALK_RAD.powi(2) * dt
            + TURN_WALK_RAD.powi(2) * window.turned
            + self.timing_walk_s2 * window.rate2;
        for axis in 0..3 {
            self.p[(U + axis, U + axis)] += walk * GRAVITY_M_S2.powi(2);
            self.p[(V + axis, V + axis)] += VELOCITY_WALK_M_S.powi(2) * dt;
        }
        left
    }

    /// How surely the board stays upright, 0 to 1.
    pub(super) fn upright_share(&self) -> f64 {
        share(&self.upright)
    }

    /// The board is at rest: its velocity is 0, and all specific force is gravity's.
    fn measure_up_at_rest(&mut self, left: &Vector3<f64>, dt: f64) {
        self.correct(U, &(left / dt), REST_FORCE_M_S2.powi(2) / dt);
        self.velocity.fill(0.0);
        self.clear(V, LEAST_SPEED_M_S);
    }

    /// The velocity is 0, within those that the board has.
    fn measure_velocity(&mut self, left: &Vector3<f64>, dt: f64) {
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
        self.correct(V, &-self.velocity, variance);
    }

    /// Takes in a measurement of three states, each with this variance.
    fn correct(&mut self, at: usize, innovation: &Vector3<f64>, variance: f64) {
        let cross: SMatrix<f64, N, 3> = self.p.fixed_columns::<3>(at).into();
        let own: Matrix3<f64> = cross.fixed_rows::<3>(at).into();
        let scatter = own + Matrix3::identity() * variance;
        let Some(inverse) = scatter.try_inverse() else {
            return;
        };
        let mut gain = cross * inverse;
        if at != B {
            self.hold_unseen(&mut gain);
        }
        // P − K Cᵀ − C Kᵀ + K S Kᵀ holds for any gain K, also for one that holds states back.
        let learnt = gain * cross.transpose();
        self.p += gain * scatter * gain.transpose() - learnt - learnt.transpose();
        let change = gain * innovation;
        if let Some(up) = &mut self.up {
            *up += change.fixed_rows::<3>(U);
        }
        self.velocity += change.fixed_rows::<3>(V);
        self.force_bias += change.fixed_rows::<3>(A);
        let most = self.largest_bias_rad_s;
        self.bias = (self.bias + change.fixed_rows::<3>(B)).map(|bias| bias.clamp(-most, most));
        let rows = Matrix3::from_row_slice(change.fixed_rows::<9>(M).as_slice());
        self.matrix = (self.matrix + rows).map(|entry| entry.clamp(-MOST_MATRIX, MOST_MATRIX));
    }

    /// Takes the gyro's errors about the vertical of a board that stays upright, M's row for that axis, out of a gain: gravity does not show
    /// them. While the board sways, the axis that is taken for the vertical sways with it and lets a little through. Where a motion repeats that
    /// is always of the same sign: without this, rates about the vertical were off by a fifth after four hours.
    fn hold_unseen(&self, gain: &mut SMatrix<f64, N, 3>) {
        let seen = across(&self.long_upright);
        for innovation in 0..3 {
            let mut column = gain.fixed_view_mut::<9, 1>(M, innovation);
            let left = seen * Matrix3::from_row_slice(column.as_slice());
            column.copy_from(&rows(&left));
        }
    }

    /// Forgets three states, and how they go with others.
    fn clear(&mut self, at: usize, sd: f64) {
        for index in at..at + 3 {
            self.p.row_mut(index).fill(0.0);
            self.p.column_mut(index).fill(0.0);
            self.p[(index, index)] = sd * sd;
        }
    }
}
