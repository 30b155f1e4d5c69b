//! The extended Kalman filter behind the estimate.
//!
//! The field of the earth stands still in the frame that gyro and accelerometer carry along. With R from body to that
//! frame, a magnetometer sample at time t is
//!
//! ```text
//! y(t) = D · R(t − T)ᵀ · (I + [ε]×) · (h + m + q) + b + white noise
//! ```
//!
//! | state | what it is | changes by |
//! |---|---|---|
//! | h | field in the frame, milligauss; its azimuth is north | the gyro's errors, which turn the frame; a slow walk |
//! | ε | tilt error of the frame, two angles, radians | acceleration and the gyro's bias; fades with the time constant of the tilt |
//! | b | hard iron, body axes, milligauss | a slow walk, and by turning |
//! | D | soft iron, scale factors and rotation between the chips; trace held at 3; the state has D − I, row by row | turning |
//! | m | unevenness of the field here, in the frame, milligauss | forgotten by turning and moving, and slowly on a still board |
//! | T | lag of the magnetometer behind the gyro, seconds | nothing |
//! | G | what is left of the gyro's bias, body axes, rad/s | what the attitude takes out of the rates; its walk, see `attitude/bias_walk.rs` |
//! | S | scale error of each axis of the gyro | nothing |
//! | q | offset of the place as a whole, in the frame, milligauss | forgotten in `PLACE_LASTS_S` of motion, kept on a still board |
//!
//! The trace of D is held since only the product of D and h can be seen.
//!
//! `filter/begin.rs` starts and restarts the state, `filter/predict.rs` carries it on in time, and `filter/correct.rs` corrects it by a
//! sample; `filter/whiteness.rs` finds how much that tells. `filter/unevenness.rs` measures noise and unevenness,
//! `filter/turn_result.rs` puts in the result of a full turn, `filter/gyro_bias.rs` learns the gyro's bias, by the attitude and on a still board,
//! `filter/rest.rs` tells a board at rest from one that swings, and `filter/known.rs` answers what is known.

use std::ops::{Range, RangeInclusive};

use nalgebra::{Matrix3, SVector, Vector3};

#[cfg(test)]
use super::covariance::G;
use super::covariance::{B, Covariance, D, E, H, M, N, Q, S, T, subtract};
use super::prior::{FIELD_MGAUSS, Measured, Prior, USUAL_UNEVENNESS};
use crate::attitude::{BiasWalk, BoardState};
#[cfg(test)]
use crate::attitude::{GyroBias, TiltError};
use crate::frame::{add_variance, put, reset_variance, rows};
use rest::RestWatch;
use unevenness::LEAST_NOISE_MGAUSS;
use whiteness::Whiteness;

mod begin;
mod correct;
pub(super) mod gyro_bias;
pub(super) mod known;
mod predict;
mod rest;
mod turn_result;
mod unevenness;
mod whiteness;

type State = SVector<f64, N>;

/// Deviation of each part of the field before anything is known, as a share of `FIELD_MGAUSS`: 750 mG, more than the strongest on earth.
const FIELD_SD: f64 = 1.5;
/// Scale error to expect on an axis of a gyro: less than the attitude expects (`SCALE` in `attitude/gyro_errors.rs`), which has taken out
/// what gravity shows.
const GYRO_SCALE: f64 = 0.01;
/// Lag to expect of a magnetometer, one standard deviation, seconds: half its period and some filtering. On recorders
/// it is 16 ms, and 60 ms at most, which is three deviations. With 15 ms, a board that only pitches at first takes a lag of 56 ms for iron.
const LAG_S: f64 = 0.02;
/// Limits of the lag, seconds. The upper one is twice the longest on any recorder. The lower one is for recorders on which the gyro is late
/// instead, so that the magnetometer seems early. The limits are needed because, if the board is shaken from the start, a lag outside them
/// can fit the motion as well as the true one.
const LAG_RANGE_S: RangeInclusive<f64> = -0.06..=0.12;
/// Jitter of the times of samples, seconds: that of a bus which the kernel polls. Any value from 1 to 5 ms gives nearly the same simulated figures.
const JITTER_S: f64 = 0.002;
/// Tilt error of the frame until the attitude states its own, radians.
const FIRST_TILT_RAD: f64 = 0.012;
/// Unevenness of the field at first without a calibration, as a share of it: more than that of usual places, since the model may be wrong
/// too.
const FIRST_UNEVENNESS: f64 = 0.035;
/// An unevenness above this share of the field is a disturbance: four deviations of that of usual places.
pub(super) const DISTURBED: f64 = 4.0 * USUAL_UNEVENNESS;
/// Unevenness is forgotten by moving this long, seconds.
const FORGET_MOVING_S: f64 = 1.0;
/// After this time in motion the board is at another place, seconds: a robot has then gone some metres, the distance
/// between pieces of iron in a room. At 10 s its headings are falsely sure 1.7 times as often; at 40 s they are `good` in 80 % instead of
/// 85 % of the time. A board that turns on one spot for minutes counts as moving on: north is then the field's mean over that spot.
const PLACE_LASTS_S: f64 = 20.0;
/// A still board that has turned by more than this, radians (6°), swings.
pub(super) const SWING_RAD: f64 = 0.1;

/// What the filter is told of one magnetometer sample.
#[derive(Clone, Copy, Debug)]
pub(super) struct Input {
    /// Turns body vectors into the frame.
    pub(super) to_frame: Matrix3<f64>,
    /// Whether the frame's Z is known to point up.
    pub(super) vertical_known: bool,
    /// Rate freed of the bias that the frame was carried along with, body axes, rad/s.
    pub(super) rate_rad_s: Vector3<f64>,
    /// Raw field, body axes, milligauss.
    pub(super) field_mgauss: Vector3<f64>,
    /// Integral of the rate from the measurement of the sample before to that of this one, radians.
    pub(super) turned_rad: Vector3<f64>,
    /// Variance of the rotation that the gyro has missed meanwhile, each axis, rad².
    pub(super) missed_rad2: f64,
    /// Time between the measurements of both samples, seconds, not corrected for the magnetometer's lag.
    pub(super) period_s: f64,
    /// Lag for which frame, rate and turn are already corrected, seconds.
    pub(super) lag_s: f64,
    /// The board's state.
    pub(super) board: BoardState,
}

impl Input {
    /// Whether both detectors see rest. `still` ends sooner when the board begins to move.
    fn rests(&self) -> bool {
        self.board.at_rest && self.board.still
    }

    /// The body axis that is nearest to the vertical: Z if that is unknown.
    pub(super) fn upright_axis(&self) -> usize {
        if self.vertical_known {
            self.to_frame.row(2).transpose().iamax()
        } else {
            2
        }
    }

    /// Angular rate of the board, body axes, rad/s; 0 while it is still. The gyro then reads only noise, which is in `to_frame` too:
    /// the correlation would bias the lag.
    fn turn_rate(&self) -> Vector3<f64> {
        if self.board.still {
            Vector3::zeros()
        } else {
            self.rate_rad_s
        }
    }
}

/// The filter's state and covariance.
#[derive(Clone)]
pub(super) struct Filter {
    x: State,
    p: Covariance,
    /// Whether the state has begun.
    pub(super) begun: bool,
    /// Time in motion without a disturbance since this frame began, summed, seconds.
    pub(super) undisturbed_s: f64,
    /// Strength of the field in which its calibration was made, milligauss; `None` once it has been compared.
    made_in_mgauss: Option<f64>,
    /// Orientation at the first sample, body to frame.
    first_attitude: Option<Matrix3<f64>>,
    /// Whether the frame's Z is known to point up.
    pub(super) vertical_known: bool,
    /// Root mean square of what the field's strength may be, milligauss: √(|h|² + tr P_h), at most |h| or the strongest field on earth,
    /// whichever is larger.
    strength_rms_mgauss: f64,
    /// What a calibration's turn has measured, until there is a field to go with it. `None` without a calibration, and once begun.
    measured: Option<Vec<Measured>>,
    /// Variance of the unevenness, as a share of the field's square.
    unevenness2: f64,
    /// Mean of that in motion.
    mean_unevenness2: f64,
    /// Variance of the place's offset, as a share of the field's square.
    place2: f64,
    /// Variance of a sample's white noise, milligauss².
    noise2: f64,
    innovation: Option<Vector3<f64>>,
    whiteness: Whiteness,
    odd: Option<Vector3<f64>>,
    jumped: bool,
    /// In the frame, milligauss: the sum of recent jumps of the field, and the innovation of an odd sample that was rejected.
    jumps_mgauss: Vector3<f64>,
    odd_mgauss: Vector3<f64>,
    /// Whether the board did not move at the last sample, by gyro and accelerometer.
    pub(super) still: bool,
    rest: RestWatch,
    gyro_bias_walk: BiasWalk,
    /// Orientation when the board last moved or swung, body to frame.
    last_attitude: Matrix3<f64>,
    /// Sum of the log-likelihoods of the samples taken, but for the constant that each has.
    pub(super) log_likelihood: f64,
    /// Mean normalised innovation squared for each degree of freedom, over 2 s; 1 where all is as expected.
    pub(super) consistency: f64,
}

impl Filter {
    pub(super) fn new(prior: &Prior) -> Self {
        let mut x = State::zeros();
        let mut p = Covariance::zeros();
        // With a calibration only the field here is in doubt; without one the model may be wrong too.
        let calibrated = prior.strength_mgauss.is_some() || !prior.measured.is_empty();
        let unevenness = if calibrated {
            USUAL_UNEVENNESS
        } else {
            FIRST_UNEVENNESS
        };
        let diagonal = [
            (H, FIELD_SD * FIELD_MGAUSS),
            (M, unevenness * FIELD_MGAUSS),
            (Q, USUAL_UNEVENNESS * FIELD_MGAUSS),
            (S, GYRO_SCALE),
        ];
        for (at, sd) in diagonal {
            add_variance(&mut p, at..at + 3, sd * sd);
        }
        add_variance(&mut p, E..E + 2, FIRST_TILT_RAD * FIRST_TILT_RAD);
        p[(T, T)] = LAG_S * LAG_S;
        put(&mut x, (B, 0), &prior.bias_mgauss);
        put(&mut x, (D, 0), &rows(&(prior.matrix - Matrix3::identity())));
        put(&mut p, (B, B), &prior.covariance);
        Self {
            x,
            p,
            begun: false,
            undisturbed_s: 0.0,
            made_in_mgauss: prior.made_in_mgauss,
            first_attitude: None,
            vertical_known: false,
            strength_rms_mgauss: prior.strength_mgauss.unwrap_or(FIELD_MGAUSS),
            measured: calibrated.then(|| prior.measured.clone()),
            unevenness2: unevenness.powi(2),
            mean_unevenness2: USUAL_UNEVENNESS.powi(2),
            place2: USUAL_UNEVENNESS.powi(2),
            noise2: prior.noise_mgauss.powi(2).max(LEAST_NOISE_MGAUSS.powi(2)),
            innovation: None,
            whiteness: Whiteness::default(),
            odd: None,
            jumped: false,
            jumps_mgauss: Vector3::zeros(),
            odd_mgauss: Vector3::zeros(),
            still: false,
            rest: RestWatch::default(),
            gyro_bias_walk: BiasWalk::default(),
            last_attitude: Matrix3::identity(),
            log_likelihood: 0.0,
            consistency: 1.0,
        }
    }

    /// Takes a sample, or begins a new frame with it where the last was lost.
    pub(super) fn follow(&mut self, input: &Input, lost: bool, fixed: bool) {
        if lost {
            self.restart_frame(input);
        } else {
            self.take(input, fixed);
        }
    }

    /// Carries the state on to a sample that is no measurement. With `fixed`, hard iron and matrix stay as they are.
    pub(super) fn pass(&mut self, input: &Input, fixed: bool) {
        if self.begun {
            self.predict(input, fixed);
            self.innovation = None;
            self.whiteness.interrupt();
            self.odd = None;
        }
    }

    /// Takes a sample. With `fixed`, hard iron and matrix stay as they are, and so does their uncertainty, which counts (a Schmidt–Kalman
    /// filter). On a still board the field never changes them; the gyro's readings may, since its bias is correlated with them.
    fn take(&mut self, input: &Input, fixed: bool) {
        if input.rests() {
            self.learn_bias_at_rest(input, fixed);
        } else if input.board.still {
            self.rest.interrupt();
        } else {
            self.rest = RestWatch::default();
        }
        if !self.begun && !self.begin(input, fixed) {
            return;
        }
        let forgotten = 1.0 - self.predict(input, fixed).unevenness;
        // A board that does not turn cannot tell iron from north: what changes then is the place or the frame.
        self.correct(input, fixed || input.board.still);
        self.measure_unevenness(input, forgotten, fixed);
        if !input.board.still && !self.disturbed() {
            self.undisturbed_s += input.period_s;
        }
    }

    /// Corrects the state by a scalar measurement. `cross` is its covariance with the state, `variance` that of the innovation.
    fn correct_by_scalar(&mut self, innovation: f64, cross: &State, variance: f64) {
        let gain = cross / variance;
        self.x += gain * innovation;
        subtract(&mut self.p, &gain, cross);
    }

    fn vector(&self, at: usize) -> Vector3<f64> {
        self.x.fixed_rows::<3>(at).into()
    }

    /// The tilt error, a rotation vector in the frame, radians.
    fn tilt_rad(&self) -> Vector3<f64> {
        Vector3::new(self.x[E], self.x[E + 1], 0.0)
    }

    fn trace(&self, at: usize, count: usize) -> f64 {
        (at..at + count).map(|index| self.p[(index, index)]).sum()
    }

    /// Resets these states to 0 with this variance, without correlations.
    fn restart(&mut self, states: Range<usize>, variance: f64) {
        self.x.rows_range_mut(states.clone()).fill(0.0);
        reset_variance(&mut self.p, states, variance);
    }
}

#[cfg(test)]
impl Filter {
    /// The same, sure that the magnetometer does not lag.
    pub(super) fn without_lag(mut self) -> Self {
        self.restart(T..T + 1, 0.0);
        self
    }

    /// The same, with the gyro's bias known to 2°/s on each axis.
    pub(super) fn unsure_of_gyro(mut self) -> Self {
        self.restart(G..G + 3, 0.035f64.powi(2));
        self
    }
}

#[cfg(test)]
impl Input {
    /// A sample, 0.1 s after the one before, of a board that turns in this attitude.
    pub(super) fn turning_at(
        to_frame: Matrix3<f64>,
        rate_rad_s: Vector3<f64>,
        field_mgauss: Vector3<f64>,
    ) -> Self {
        Self {
            to_frame,
            vertical_known: true,
            rate_rad_s,
            field_mgauss,
            turned_rad: rate_rad_s * 0.1,
            missed_rad2: 0.0,
            period_s: 0.1,
            lag_s: 0.0,
            board: BoardState {
                at_rest: false,
                still: false,
                gyro_bias: GyroBias::default(),
                gyro_matrix: Matrix3::zeros(),
                tilt_error: TiltError {
                    tau_s: 2.0,
                    by_bias: 0.0,
                    whole_sd_rad: 0.01,
                    sd_rad: 0.01,
                },
                gyro_constant_s: 0.0,
                force_m_s2: None,
            },
        }
    }

    /// The same of a board that is still.
    pub(super) fn still(mut self) -> Self {
        self.board.still = true;
        self
    }

    /// The same of a board at rest.
    pub(super) fn resting(mut self) -> Self {
        self.board.at_rest = true;
        self.still()
    }
}
