//! The extended Kalman filter behind the estimate.
//!
//! The field of the earth stands still in the frame that gyro and accelerometer carry along. With R from body to that
//! frame, a magnetometer sample at time t is
//!
//! ```text
//! y(t) = D · R(t − T)ᵀ · (I + [ε]×) · (h + m) + b + white noise
//! ```
//!
//! | state | what it is | changes by |
//! |---|---|---|
//! | h | field in the frame, milligauss; its azimuth is north | the gyro's errors, which turn the frame |
//! | ε | tilt error of the frame, two angles, radians | acceleration: forgotten over the time constant of the tilt |
//! | b | hard iron, body axes, milligauss | a slow walk |
//! | m | unevenness of the field here, in the frame, milligauss | forgotten by turning and moving |
//! | D | soft iron, scale factors and rotation between the chips; trace held at 3 | nothing |
//! | T | lag of the magnetometer behind the gyro, seconds | nothing |
//! | G | what is left of the gyro's bias, body axes, rad/s | a slow walk |
//! | S | scale error of each axis of the gyro | nothing |
//!
//! The trace of D is held since only the product of D and h can be seen.

use nalgebra::{Matrix2, Matrix3, Matrix3x2, SMatrix, SVector, SymmetricEigen, Vector3};

use super::covariance::{B, Covariance, D, E, G, H, M, N, S, Sensitivity, Step, T, subtract};
use super::prior::{FIELD_MGAUSS, Measured, Prior};
use crate::frame::hypot;

type State = SVector<f64, N>;

/// The strongest field anywhere: an iron that is not known yet makes it no stronger.
const STRONGEST_MGAUSS: f64 = 670.0;
/// Bias to expect of a gyro after its filter has had its say, rad/s: data sheets allow ±5 to ±40°/s before it.
const GYRO_BIAS_RAD_S: f64 = 0.035;
/// Scale error to expect on an axis of a gyro; data sheets: 1 to 3 % at most.
const GYRO_SCALE: f64 = 0.01;
/// What cross-axis errors of a gyro add to the frame's turn for each radian turned, one standard deviation.
const GYRO_CROSS: f64 = 0.002;
/// Lag to expect of a magnetometer, seconds: half its period and some filtering; 16 ms on a real recorder.
const LAG_S: f64 = 0.015;
/// Angle random walk of the frame, rad/√s: 0.02 °/√s, four times the noise density of an ITG-3200's data sheet.
const ANGLE_WALK_RAD: f64 = 0.000_35;
/// Walk of the gyro's bias, rad/s per √s: 0.3°/s in an hour of warming up.
const BIAS_WALK_RAD_S: f64 = 0.000_087;
/// A gyro at rest reads its bias within this over one second, rad/s (0.3°/s).
const REST_RATE_RAD_S: f64 = 0.0052;
/// Jitter of the times of samples, seconds.
const JITTER_S: f64 = 0.002;
/// White noise of a sample at first, and at least, milligauss; in between it is measured.
const NOISE_MGAUSS: f64 = 7.0;
const LEAST_NOISE_MGAUSS: f64 = 1.5;
/// Over this time the noise is measured, seconds.
const NOISE_TAU_S: f64 = 2.0;
/// Tilt error of the frame, radians.
const TILT_RAD: f64 = 0.012;
/// Unevenness of the field as a share of it: at first, and at least. Rooms have 1 to 2 % over half a metre.
const FIRST_UNEVENNESS: f64 = 0.035;
const LEAST_UNEVENNESS: f64 = 0.004;
/// Unevenness of usual places: more than that, while the board turns, is iron that came to stay on the board.
const USUAL_UNEVENNESS: f64 = 0.015;
/// A disturbance by this share of the field is no place's unevenness: four deviations.
const DISTURBED: f64 = 4.0 * USUAL_UNEVENNESS;
/// Unevenness is forgotten by turning this far, radians, by moving this long, or by resting this long, seconds: people, doors
/// and lifts near a board at rest.
const FORGET_RAD: f64 = 0.52;
const FORGET_MOVING_S: f64 = 1.0;
const FORGET_RESTING_S: f64 = 60.0;
/// Uncertain iron may have absorbed some of the field's unevenness, which is therefore taken for at least this fraction of the iron's
/// deviation (as a share of the field), up to `USUAL_UNEVENNESS`. At 0 a simulated car that others pass before its first turn learns
/// wrong iron and is sure of it; at twice the value cars learn later, for nothing.
const IRON_HIDES: f64 = 0.3;
/// Least change of the field around a board at rest over `FORGET_RESTING_S`, as a share, however even the place was in motion.
const RESTING_UNEVENNESS: f64 = 0.01;
/// Its size is measured over so many of those lengths: quickly when it grows, slowly when it shrinks.
const LENGTHS_UP: f64 = 3.0;
const LENGTHS_DOWN: f64 = 4.0;
/// The place as a whole is off by as much as it is uneven: at first, at least and at most, as a share of the field …
const FIRST_PLACE: f64 = 0.01;
const LEAST_PLACE: f64 = 0.004;
const MOST_PLACE: f64 = 0.02;
/// A place differs from the next by less than the field does within it: half of the variance.
const PLACE_SHARE: f64 = 0.5;
/// … measured over this time, and another place after this time, seconds.
const PLACE_TAU_S: f64 = 60.0;
const PLACE_LASTS_S: f64 = 100.0;
/// Walk of the earth's field, share per √s, and of the hard iron, milligauss per √s.
const FIELD_WALK: f64 = 0.0002;
const IRON_WALK_MGAUSS: f64 = 0.05;
/// What the model leaves out is the same whenever the board is in the same attitude, and does not average out by
/// swinging to and fro: for each radian turned, so much is lost of what is known, as a share of the field, of D's entries.
const IRON_TURN: f64 = 0.003;
const MATRIX_TURN: f64 = 0.001;
/// How much of unusual unevenness is taken for a change of the hard iron, and of the field, while the board turns.
const IRON_SHARE: f64 = 1.0;
const FIELD_SHARE: f64 = 0.003;
/// The filter observes the tilt error only through the vertical field, so the tilt error may correct the field only as far as the
/// vertical field is known: by half if the deviation of the vertical field is this share of it, and not at all at the magnetic
/// equator. Without this limit a car's first turns converge to a wrong vertical field and a tilt that matches it. With half the value
/// a car that turns fast learns the vertical field too late to be sure of its heading.
const VERTICAL_KNOWN: f64 = 0.0625;
/// A still board that has turned by so much, 6°, swings.
const SWING_RAD: f64 = 0.1;
/// A normalised innovation squared beyond this is no chance (3 degrees of freedom: 0.1 %).
const GATE: f64 = 16.0;
/// Before the board has turned this far, the field does not tell iron from north, radians.
const BEGIN_RAD: f64 = 0.1;

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
    /// Time between the arrivals of both samples, seconds. After a pause of the host it is not the time between their measurements.
    pub(super) period_s: f64,
    /// Lag for which frame, rate and turn are already corrected, seconds.
    pub(super) lag_s: f64,
    /// Time constant of the tilt's errors, seconds.
    pub(super) tilt_tau_s: f64,
    /// What the tilt is off by, one standard deviation, radians.
    pub(super) tilt_sd_rad: f64,
    /// For how long the gyro has read the same to the last bit, seconds.
    pub(super) gyro_constant_s: f64,
    /// Specific force, body axes, m/s².
    pub(super) force_m_s2: Option<Vector3<f64>>,
    /// The board is at rest, by gyro, accelerometer and field: the gyro's rate is its bias.
    pub(super) at_rest: bool,
    /// The board does not move, by gyro and accelerometer.
    pub(super) still: bool,
}

impl Input {
    /// How the board turns, body axes, rad/s. What the gyro of a still board reads is noise, and the same noise is in the
    /// frame: a lag would be learnt from it.
    fn turning(&self) -> Vector3<f64> {
        if self.still {
            Vector3::zeros()
        } else {
            self.rate_rad_s
        }
    }
}

/// The field in the frame, the frame's tilt error, and their covariances.
pub(super) struct SeenNorth {
    /// Milligauss.
    pub(super) field: Vector3<f64>,
    /// A rotation vector in the frame, radians.
    pub(super) tilt_rad: Vector3<f64>,
    pub(super) field_covariance: Matrix3<f64>,
    pub(super) tilt_covariance: Matrix2<f64>,
    /// Of the field with the tilt error.
    pub(super) cross: Matrix3x2<f64>,
}

/// The filter's state and covariance.
#[derive(Clone)]
pub(super) struct Filter {
    x: State,
    p: Covariance,
    /// Whether the state has begun.
    begun: bool,
    /// The frame when the first sample came.
    first: Option<Matrix3<f64>>,
    vertical_known: bool,
    /// Expected strength of the field, milligauss.
    strength_mgauss: f64,
    /// What a turn has measured, until there is a field to go with it.
    measured: Vec<Measured>,
    /// Variances: unevenness and place as shares of the field, noise in milligauss².
    unevenness2: f64,
    place2: f64,
    noise2: f64,
    innovation: Option<Vector3<f64>>,
    odd: Option<Vector3<f64>>,
    jumped: bool,
    /// In the frame, milligauss: the sum of recent jumps of the field, and the innovation of an odd sample that was rejected.
    jumps_mgauss: Vector3<f64>,
    odd_mgauss: Vector3<f64>,
    still: bool,
    /// How the board lay when it last moved or swung.
    lay: Matrix3<f64>,
    /// Sum of the log-likelihoods of the samples taken.
    log_likelihood: f64,
    /// Mean normalised innovation squared for each degree of freedom, over 2 s.
    consistency: f64,
}

impl Filter {
    pub(super) fn new(prior: &Prior) -> Self {
        let mut x = State::zeros();
        let mut p = Covariance::zeros();
        // What is off under a calibration is the place; without one, it may be anything.
        let calibrated = prior.strength_mgauss.is_some() || !prior.measured.is_empty();
        let unevenness = if calibrated {
            USUAL_UNEVENNESS
        } else {
            FIRST_UNEVENNESS
        };
        let diagonal = [
            (H, 1.5 * FIELD_MGAUSS),
            (M, unevenness * FIELD_MGAUSS),
            (G, GYRO_BIAS_RAD_S),
            (S, GYRO_SCALE),
        ];
        for (at, sd) in diagonal {
            for axis in 0..3 {
                p[(at + axis, at + axis)] = sd * sd;
            }
        }
        for axis in 0..2 {
            p[(E + axis, E + axis)] = TILT_RAD * TILT_RAD;
        }
        p[(T, T)] = LAG_S * LAG_S;
        x.fixed_rows_mut::<3>(B).copy_from(&prior.bias_mgauss);
        x.fixed_rows_mut::<9>(D).copy_from(&prior.matrix_rows());
        p.fixed_view_mut::<3, 3>(B, B)
            .copy_from(&prior.covariance.fixed_view::<3, 3>(0, 0));
        p.fixed_view_mut::<3, 9>(B, D)
            .copy_from(&prior.covariance.fixed_view::<3, 9>(0, 3));
        p.fixed_view_mut::<9, 3>(D, B)
            .copy_from(&prior.covariance.fixed_view::<9, 3>(3, 0));
        p.fixed_view_mut::<9, 9>(D, D)
            .copy_from(&prior.covariance.fixed_view::<9, 9>(3, 3));
        Self {
            x,
            p,
            begun: false,
            first: None,
            vertical_known: false,
            strength_mgauss: prior.strength_mgauss.unwrap_or(FIELD_MGAUSS),
            measured: prior.measured.clone(),
            unevenness2: unevenness.powi(2),
            place2: FIRST_PLACE.powi(2),
            noise2: NOISE_MGAUSS.powi(2),
            innovation: None,
            odd: None,
            jumped: false,
            jumps_mgauss: Vector3::zeros(),
            odd_mgauss: Vector3::zeros(),
            still: false,
            lay: Matrix3::identity(),
            log_likelihood: 0.0,
            consistency: 1.0,
        }
    }

    /// The gyro's filter has changed its own bias by this much, body axes, rad/s: what is left changes the other way.
    pub(super) fn shift_gyro_bias(&mut self, by_rad_s: &Vector3<f64>) {
        for axis in 0..3 {
            self.x[G + axis] -= by_rad_s[axis];
        }
    }

    /// Takes a sample, or begins a new frame with it where the last was lost.
    pub(super) fn follow(&mut self, input: &Input, lost: bool, frozen: bool) {
        if lost {
            self.restart_frame(input);
        } else {
            self.take(input, frozen);
        }
    }

    /// Takes a sample. With `frozen`, bias and matrix stay as they are, and only their uncertainty is counted
    /// (a Schmidt–Kalman filter).
    fn take(&mut self, input: &Input, frozen: bool) {
        if input.at_rest && input.still {
            self.learn_bias_at_rest(input);
        }
        if !self.begun && !self.begin(input) {
            return;
        }
        self.still = input.still;
        self.vertical_known = input.vertical_known;
        let forgotten = self.predict(input);
        // A board that does not turn cannot tell iron from north: what changes then is the place or the frame.
        self.correct(input, frozen || input.still);
        self.measure_unevenness(input, forgotten);
    }

    /// The frame has been lost: the field in it comes anew from one sample.
    fn restart_frame(&mut self, input: &Input) {
        if !self.begun {
            self.first = None;
            return;
        }
        let Some(inverse) = self.matrix().try_inverse() else {
            return;
        };
        let rate = input.turning().cross_matrix();
        let lag = self.x[T] - input.lag_s;
        let turn = input.to_frame * (Matrix3::identity() - rate * lag);
        let map = turn * inverse;
        let corrected = inverse * (input.field_mgauss - self.vector(B));
        let field = turn * corrected;
        self.clear(H, 5);
        self.clear(M, 3);
        let unevenness = self.unevenness2 * self.strength_mgauss.powi(2);
        for axis in 0..3 {
            self.p[(M + axis, M + axis)] = unevenness;
        }
        for axis in 0..2 {
            self.p[(E + axis, E + axis)] = input.tilt_sd_rad.powi(2);
        }
        // h = R (I − [ω]× lag) D⁻¹ (y − b) − ε × h − m, where the lag is what `input.lag_s` leaves of it
        let mut jacobian = SMatrix::<f64, 3, N>::zeros();
        jacobian.fixed_columns_mut::<3>(B).copy_from(&-map);
        for row in 0..3 {
            for column in 0..3 {
                let change = -map.column(row) * corrected[column];
                jacobian
                    .fixed_columns_mut::<1>(D + 3 * row + column)
                    .copy_from(&change);
            }
        }
        jacobian
            .fixed_columns_mut::<3>(M)
            .copy_from(&-Matrix3::identity());
        let by_tilt = field.cross_matrix();
        jacobian
            .fixed_columns_mut::<2>(E)
            .copy_from(&by_tilt.fixed_columns::<2>(0));
        let by_time = input.to_frame * rate * corrected;
        jacobian.fixed_columns_mut::<1>(T).copy_from(&-by_time);
        let cross = jacobian * self.p;
        let timed = by_time * by_time.transpose() * JITTER_S.powi(2);
        let own = cross * jacobian.transpose() + map * map.transpose() * self.noise2 + timed;
        self.p.fixed_rows_mut::<3>(H).copy_from(&cross);
        self.p
            .fixed_columns_mut::<3>(H)
            .copy_from(&cross.transpose());
        self.p.fixed_view_mut::<3, 3>(H, H).copy_from(&own);
        self.x.fixed_rows_mut::<3>(H).copy_from(&field);
        self.innovation = None;
        self.odd = None;
        self.jumped = false;
        self.jumps_mgauss = Vector3::zeros();
        self.odd_mgauss = Vector3::zeros();
    }

    /// Puts what a turn has measured in the place of what was known of it. The samples of the turn have been used
    /// before, so nothing is multiplied.
    pub(super) fn replace(&mut self, measured: &[Measured], input: &Input) {
        for one in measured {
            let weights = one.weights();
            for row in 0..12 {
                for column in 0..12 {
                    let at = (parameter(row), parameter(column));
                    self.p[at] += one.forgotten * weights[row] * weights[column];
                }
            }
        }
        // The verdict has found the field even all the way round.
        self.unevenness2 = self.unevenness2.min(USUAL_UNEVENNESS.powi(2));
        self.place2 = self.place2.min(FIRST_PLACE.powi(2));
        self.restart_frame(input);
        for one in measured {
            self.learn(one);
        }
    }

    /// Variance of what a turn has measured, as far as it is known here.
    pub(super) fn variance_of(&self, measured: &Measured) -> f64 {
        let jacobian = self.jacobian_of(measured);
        jacobian.dot(&(self.p * jacobian))
    }

    fn jacobian_of(&self, measured: &Measured) -> State {
        let mut jacobian = State::zeros();
        let weights = measured.weights();
        for index in 0..12 {
            jacobian[parameter(index)] = weights[index];
        }
        jacobian[H + 2] = measured.up;
        if let Some(across) = measured.across {
            // The turn was level: across its plane is up or down.
            let field = -across.z * self.x[H + 2];
            for row in 0..3 {
                for column in 0..3 {
                    jacobian[D + 3 * row + column] += measured.bias[row] * across[column] * field;
                }
            }
        }
        jacobian
    }

    fn learn(&mut self, measured: &Measured) {
        let jacobian = self.jacobian_of(measured);
        let told = jacobian.dot(&self.x) + measured.matrix.trace();
        let cross = self.p * jacobian;
        let gain = cross / (jacobian.dot(&cross) + measured.variance);
        self.x += gain * (measured.value - told);
        self.p -= gain * cross.transpose();
    }

    /// Iron may have come or gone: the hard iron is as unknown as the disturbance is large, and the field here is as
    /// even as places are.
    pub(super) fn doubt_iron(&mut self) {
        let disturbance = self.vector(M).norm() + 0.1 * self.strength_mgauss;
        self.clear(M, 3);
        self.unevenness2 = USUAL_UNEVENNESS.powi(2);
        let unevenness = self.unevenness2 * self.strength_mgauss.powi(2);
        for axis in 0..3 {
            self.p[(M + axis, M + axis)] = unevenness;
            self.p[(B + axis, B + axis)] += disturbance * disturbance;
        }
    }

    /// A rest tells the gyro's bias.
    fn learn_bias_at_rest(&mut self, input: &Input) {
        let variance = REST_RATE_RAD_S.powi(2) / input.period_s;
        for axis in 0..3 {
            let innovation = input.rate_rad_s[axis] - self.x[G + axis];
            let column: State = self.p.column(G + axis).into();
            let gain = column / (column[G + axis] + variance);
            self.x += gain * innovation;
            subtract(&mut self.p, &gain, &column);
        }
    }

    /// Once the board has turned a little, the state begins with half of the field taken for iron.
    fn begin(&mut self, input: &Input) -> bool {
        let first = *self.first.get_or_insert(input.to_frame);
        let known = self.iron_known_within(FIELD_MGAUSS);
        if known || !self.measured.is_empty() {
            self.begun = true;
            self.restart_frame(input);
            for measured in std::mem::take(&mut self.measured) {
                self.learn(&measured);
            }
            return true;
        }
        let cosine = ((first.transpose() * input.to_frame).trace() - 1.0) / 2.0;
        if cosine > BEGIN_RAD.cos() {
            return false;
        }
        self.begun = true;
        let half = 0.5 * input.field_mgauss;
        self.x
            .fixed_rows_mut::<3>(H)
            .copy_from(&(input.to_frame * half));
        self.x.fixed_rows_mut::<3>(B).copy_from(&half);
        true
    }

    /// Carries the state on to the sample. Returns how much of the unevenness has been forgotten.
    fn predict(&mut self, input: &Input) -> f64 {
        let Input {
            to_frame: r,
            period_s: dt,
            still,
            ..
        } = *input;
        let h = self.vector(H);
        let strength2 = h.norm_squared() + self.trace(H, 3);
        let strength2 = strength2.min(STRONGEST_MGAUSS.powi(2).max(h.norm_squared()));
        let w = input.turning();
        let rate = w.norm();
        let turned_rad = self.turned_rad(input);
        // The turn that the gyro's errors add to the frame; its tilt is the accelerometer's, if there is one.
        let mut turn = r * (self.vector(G) + self.vector(S).component_mul(&w)) * dt;
        let mut by_errors = SMatrix::<f64, 3, 6>::zeros();
        by_errors.fixed_columns_mut::<3>(0).copy_from(&(r * dt));
        by_errors
            .fixed_columns_mut::<3>(3)
            .copy_from(&(r * Matrix3::from_diagonal(&w) * dt));
        if input.vertical_known {
            (turn.x, turn.y) = (0.0, 0.0);
            by_errors.fixed_rows_mut::<2>(0).fill(0.0);
        }
        let length = turned_rad / FORGET_RAD
            + dt / if still {
                FORGET_RESTING_S
            } else {
                FORGET_MOVING_S
            };
        let kept = (-length).exp();
        let tilt_kept = (-dt / input.tilt_tau_s).exp();

        let step = Step {
            field: Matrix3::identity() + turn.cross_matrix(),
            by_gyro: -h.cross_matrix() * by_errors,
            tilt: tilt_kept,
            unevenness: kept,
        };
        step.carry(&mut self.p);
        self.x.fixed_rows_mut::<3>(H).copy_from(&(step.field * h));
        self.x.fixed_rows_mut::<2>(E).scale_mut(tilt_kept);
        self.x.fixed_rows_mut::<3>(M).scale_mut(kept);

        let uneven = self.unevenness_ahead2(still) * strength2;

        // Process noise. The frame's walk turns h, which is itself uncertain: second order.
        let walk = ANGLE_WALK_RAD.powi(2) * dt * if still { 0.1 } else { 1.0 }
            + 2.0 * GYRO_CROSS.powi(2) * turned_rad;
        let bias: Matrix3<f64> = self.p.fixed_view::<3, 3>(G, G).into();
        let axes = if input.vertical_known { 2..3 } else { 0..3 };
        let uncertain: Matrix3<f64> = self.p.fixed_view::<3, 3>(H, H).into();
        let mut noise = Matrix3::zeros();
        for axis in axes {
            let lever = r.row(axis) * dt;
            let drift = (lever * bias * lever.transpose())[0] / dt.max(1e-3);
            let mut unit = Vector3::zeros();
            unit[axis] = 1.0;
            let cross = unit.cross_matrix();
            let turned = h * h.transpose() * walk + uncertain * (walk + drift);
            noise += cross * turned * cross.transpose();
        }
        let unusual = (self.unevenness2 - USUAL_UNEVENNESS.powi(2)).max(0.0);
        let turned = 1.0 - (-2.0 * (rate - 0.05).max(0.0) * dt / FORGET_RAD).exp();
        let moved_iron = unusual * turned * strength2;
        let moved = if still {
            0.0
        } else {
            (self.place2 * 2.0 / PLACE_LASTS_S + FIELD_WALK.powi(2)) * dt * strength2
        };
        let field = moved + FIELD_SHARE * moved_iron;
        let iron = if still {
            0.0
        } else {
            IRON_WALK_MGAUSS.powi(2) * dt
        } + IRON_SHARE * moved_iron
            + IRON_TURN.powi(2) * strength2 * turned_rad;
        for axis in 0..3 {
            self.p[(H + axis, H + axis)] += field;
            self.p[(B + axis, B + axis)] += iron;
            self.p[(G + axis, G + axis)] += BIAS_WALK_RAD_S.powi(2) * dt;
            self.p[(M + axis, M + axis)] += (1.0 - kept * kept) * uneven;
        }
        let third = 1.0 / 3.0;
        for entry in 0..9 {
            for other in 0..9 {
                let held = match (entry == other, entry % 4 == 0 && other % 4 == 0) {
                    (true, true) => 1.0 - third,
                    (true, false) => 1.0,
                    (false, true) => -third,
                    (false, false) => continue,
                };
                self.p[(D + entry, D + other)] += held * MATRIX_TURN.powi(2) * turned_rad;
            }
        }
        for axis in 0..2 {
            self.p[(E + axis, E + axis)] +=
                (1.0 - tilt_kept * tilt_kept) * input.tilt_sd_rad.powi(2);
        }
        for row in 0..3 {
            for column in 0..3 {
                self.p[(H + row, H + column)] += noise[(row, column)];
            }
        }
        self.strength_mgauss = strength2.sqrt();
        1.0 - kept
    }

    /// Variance of the unevenness to come, as a share of the field. Iron near a board at rest is expected to move on: the field
    /// may change by all that the iron adds, and tells nothing about the frame.
    fn unevenness_ahead2(&self, still: bool) -> f64 {
        if !still {
            let iron2 = self.trace(B, 3) / 3.0 / self.strength_mgauss.powi(2);
            let hidden2 = (IRON_HIDES.powi(2) * iron2).min(USUAL_UNEVENNESS.powi(2));
            return self.unevenness2.max(hidden2);
        }
        let resting2 = self.unevenness2.max(RESTING_UNEVENNESS.powi(2));
        let disturbance = self.disturbance();
        if disturbance > DISTURBED {
            resting2.max(disturbance.powi(2) / 3.0)
        } else {
            resting2
        }
    }

    /// How far the board has turned since the sample before, radians. A still board that swings turns in steps: all else that
    /// its gyro reads is noise, which would add up.
    fn turned_rad(&mut self, input: &Input) -> f64 {
        if !input.still {
            self.lay = input.to_frame;
            return input.rate_rad_s.norm() * input.period_s;
        }
        let cosine = 0.5 * (self.lay.component_mul(&input.to_frame).sum() - 1.0);
        let turned_rad = cosine.clamp(-1.0, 1.0).acos();
        if turned_rad < SWING_RAD {
            return 0.0;
        }
        self.lay = input.to_frame;
        turned_rad
    }

    /// Takes the sample in.
    fn correct(&mut self, input: &Input, frozen: bool) {
        let Input {
            to_frame: r,
            field_mgauss: y,
            period_s: dt,
            ..
        } = *input;
        let w = input.turning();
        let tilt = Vector3::new(self.x[E], self.x[E + 1], 0.0);
        let lag = self.x[T] - input.lag_s;
        let here = self.vector(H) + self.vector(M);
        let matrix = self.matrix();
        let body = r.transpose() * (here + tilt.cross(&here));
        // A field fixed in the frame turns against the board: this is where it was earlier by what `input.lag_s` leaves of the lag.
        let body_rate = w.cross(&body);
        let seen = body + body_rate * lag;
        let by_field = matrix
            * (Matrix3::identity() + w.cross_matrix() * lag)
            * r.transpose()
            * (Matrix3::identity() + tilt.cross_matrix() * self.tilt_worth());
        let by_tilt = by_field * -here.cross_matrix();
        let sensitivity = Sensitivity {
            field: by_field,
            tilt: [by_tilt.column(0).into(), by_tilt.column(1).into()],
            lag: matrix * body_rate,
            row: seen,
        };
        let mut cross = sensitivity.cross(&self.p);
        let innovation = y - matrix * seen - self.vector(B);
        // What linearising neglects: products of two uncertain states.
        let neglected = self.trace(H, 3) * (self.trace(D, 9) / 9.0 + self.trace(E, 2) / 3.0)
            + w.norm_squared() * self.p[(T, T)] * self.trace(H, 3) / 3.0;
        let white = self.noise2 + neglected + (w.norm() * JITTER_S * self.strength_mgauss).powi(2);
        let expected = |cross: &_| sensitivity.squared(cross) + Matrix3::identity() * white;
        let mut s = expected(&cross);
        let Some(mut inverse) = s.try_inverse() else {
            return;
        };
        let squared = (innovation.transpose() * inverse * innovation)[0];
        self.measure_noise(&innovation, dt);
        // A field that changes over a board at rest says nothing of what is known: the gyro carries the heading.
        if !input.still {
            let now = (squared / 3.0).min(50.0);
            self.consistency += (dt / 2.0).min(1.0) * (now - self.consistency);
        }
        self.jumped = false;
        self.jumps_mgauss *= (-dt / FORGET_MOVING_S).exp();
        self.odd_mgauss = Vector3::zeros();
        if squared > GATE {
            // One odd sample is a spike, two alike are a change: of the field here, until turning shows otherwise.
            let again = self
                .odd
                .is_some_and(|odd| (innovation - odd).norm() < 0.5 * innovation.norm());
            self.odd = Some(innovation);
            if !again {
                self.odd_mgauss = r * innovation;
                return;
            }
            self.jumped = true;
            self.jumps_mgauss += r * innovation;
            let jump = innovation.norm_squared();
            for axis in 0..3 {
                self.p[(M + axis, M + axis)] += jump;
                let mut row = cross.row_mut(M + axis);
                row += by_field.column(axis).transpose() * jump;
            }
            s = expected(&cross);
            match s.try_inverse() {
                Some(found) => inverse = found,
                None => return,
            }
        } else {
            self.odd = None;
        }
        let fit = (innovation.transpose() * inverse * innovation)[0] + s.determinant().ln();
        self.log_likelihood -= 0.5 * fit;
        let gain = cross * inverse;
        let kept = frozen.then(|| {
            let bias = self.vector(B);
            let rows: SVector<f64, 9> = self.x.fixed_rows::<9>(D).into();
            (bias, rows, self.parameter_covariance())
        });
        let before = self.vector(H);
        self.x += gain * innovation;
        if input.still {
            self.keep_strength_and_dip(&before);
        }
        subtract(&mut self.p, &gain, &cross);
        if let Some((bias, rows, covariance)) = kept {
            self.x.fixed_rows_mut::<3>(B).copy_from(&bias);
            self.x.fixed_rows_mut::<9>(D).copy_from(&rows);
            self.put_parameter_covariance(&covariance);
        }
    }

    /// How far the estimated tilt error may correct the field, 0 to 1. There is no limit if the vertical is unknown.
    fn tilt_worth(&self) -> f64 {
        if !self.vertical_known {
            return 1.0;
        }
        let known2 = (VERTICAL_KNOWN * self.x[H + 2]).powi(2);
        known2 / (known2 + self.p[(H + 2, H + 2)]).max(f64::MIN_POSITIVE)
    }

    /// A board at rest does not see how strong or how steep the field is, only how the frame drifts. Its attitude's noise is in the
    /// innovation and in its sensitivity; their product does not average out, and would bend h by a tenth in some hours.
    fn keep_strength_and_dip(&mut self, before: &Vector3<f64>) {
        let field = self.vector(H);
        // Below 1 mG the direction is noise: the length stays as it is.
        let scale = |old: f64, new: f64| if new > 1.0 { old / new } else { 1.0 };
        let kept = if self.vertical_known {
            let level = field.xy() * scale(before.xy().norm(), field.xy().norm());
            Vector3::new(level.x, level.y, before.z)
        } else {
            field * scale(before.norm(), field.norm())
        };
        self.x.fixed_rows_mut::<3>(H).copy_from(&kept);
    }

    /// The steps from innovation to innovation are noise, whatever else is wrong.
    fn measure_noise(&mut self, innovation: &Vector3<f64>, dt: f64) {
        if let Some(before) = self.innovation.replace(*innovation) {
            let step = (innovation - before).norm_squared() / 6.0;
            let gain = (dt / NOISE_TAU_S).min(0.5);
            self.noise2 += gain * (step.min(4.5 * self.noise2) - self.noise2);
            self.noise2 = self.noise2.max(LEAST_NOISE_MGAUSS.powi(2));
        }
    }

    fn measure_unevenness(&mut self, input: &Input, forgotten: f64) {
        let m = self.vector(M).norm_squared() + self.trace(M, 3);
        let share = m / 3.0 / self.strength_mgauss.powi(2);
        let lengths = if share > self.unevenness2 {
            LENGTHS_UP
        } else {
            LENGTHS_DOWN
        };
        self.unevenness2 += forgotten / lengths * (share - self.unevenness2);
        self.unevenness2 = self.unevenness2.max(LEAST_UNEVENNESS.powi(2));
        if !input.still {
            let here = (PLACE_SHARE * self.unevenness2).min(MOST_PLACE.powi(2));
            self.place2 += input.period_s.min(1.0) / PLACE_TAU_S * (here - self.place2);
            self.place2 = self.place2.max(LEAST_PLACE.powi(2));
        }
    }

    /// What is left of the gyro's bias, body axes, rad/s, and its largest deviation.
    pub(super) fn gyro_bias(&self) -> (Vector3<f64>, f64) {
        let variance = (G..G + 3).map(|at| self.p[(at, at)]).fold(0.0, f64::max);
        (self.vector(G), variance.sqrt())
    }

    /// Whether a state has begun.
    pub(super) fn begun(&self) -> bool {
        self.begun
    }

    /// The field in the frame, milligauss.
    pub(super) fn field(&self) -> Vector3<f64> {
        self.vector(H)
    }

    /// The field in the frame with what disturbs it here, milligauss.
    pub(super) fn field_here(&self) -> Vector3<f64> {
        self.vector(H) + self.vector(M)
    }

    /// North in the frame, and how well it is known.
    pub(super) fn north(&self) -> SeenNorth {
        SeenNorth {
            field: self.vector(H),
            tilt_rad: Vector3::new(self.x[E], self.x[E + 1], 0.0),
            field_covariance: self.field_covariance(),
            tilt_covariance: self.p.fixed_view::<2, 2>(E, E).into(),
            cross: self.p.fixed_view::<3, 2>(H, E).into(),
        }
    }

    /// Whether the frame's Z is known to point up.
    pub(super) fn vertical_known(&self) -> bool {
        self.vertical_known
    }

    /// Covariance of the field in the frame, with what the place as a whole may be off, milligauss².
    pub(super) fn field_covariance(&self) -> Matrix3<f64> {
        let place = self.place2 * self.vector(H).norm_squared();
        let own: Matrix3<f64> = self.p.fixed_view::<3, 3>(H, H).into();
        own + Matrix3::identity() * place
    }

    /// D.
    pub(super) fn matrix(&self) -> Matrix3<f64> {
        Matrix3::identity() + Matrix3::from_row_slice(self.x.fixed_rows::<9>(D).as_slice())
    }

    /// b, body axes, milligauss.
    pub(super) fn bias_mgauss(&self) -> Vector3<f64> {
        self.vector(B)
    }

    /// Covariance of b, milligauss².
    pub(super) fn bias_covariance(&self) -> Matrix3<f64> {
        self.p.fixed_view::<3, 3>(B, B).into()
    }

    /// Covariance of b and of D, row by row.
    pub(super) fn parameter_covariance(&self) -> SMatrix<f64, 12, 12> {
        let mut covariance = SMatrix::<f64, 12, 12>::zeros();
        for row in 0..12 {
            for column in 0..12 {
                covariance[(row, column)] = self.p[(parameter(row), parameter(column))];
            }
        }
        covariance
    }

    fn put_parameter_covariance(&mut self, covariance: &SMatrix<f64, 12, 12>) {
        for row in 0..12 {
            for column in 0..12 {
                self.p[(parameter(row), parameter(column))] = covariance[(row, column)];
            }
        }
    }

    /// Expected strength of the field, milligauss.
    pub(super) fn strength_mgauss(&self) -> f64 {
        self.vector(H).norm()
    }

    /// Lag of the magnetometer behind the gyro, seconds.
    pub(super) fn lag_s(&self) -> f64 {
        self.x[T]
    }

    /// Root mean square of what that lag may be, seconds.
    pub(super) fn lag_rms_s(&self) -> f64 {
        hypot(self.x[T], self.p[(T, T)].max(0.0).sqrt())
    }

    /// White noise of a sample, one standard deviation, milligauss.
    pub(super) fn noise_mgauss(&self) -> f64 {
        self.noise2.sqrt()
    }

    /// Whether the field here is not the earth's: it has just jumped, is far off, or is more uneven than places are.
    pub(super) fn disturbed(&self) -> bool {
        self.jumped
            || self.disturbance() > DISTURBED
            || (!self.still && self.unevenness2 > (3.0 * USUAL_UNEVENNESS).powi(2))
    }

    /// Whether the board did not move at the last sample, by gyro and accelerometer.
    pub(super) fn still(&self) -> bool {
        self.still
    }

    /// The disturbance here, as a share of the field.
    pub(super) fn disturbance(&self) -> f64 {
        self.vector(M).norm() / self.strength_mgauss
    }

    /// Recent jumps of the field and the innovation of a rejected sample, in the frame, milligauss.
    pub(super) fn missed_mgauss(&self) -> Vector3<f64> {
        self.jumps_mgauss + self.odd_mgauss
    }

    /// Sum of the log-likelihoods of the samples taken.
    pub(super) fn log_likelihood(&self) -> f64 {
        self.log_likelihood
    }

    /// Mean normalised innovation squared for each degree of freedom; 1 where all is as expected.
    pub(super) fn consistency(&self) -> f64 {
        self.consistency
    }

    /// The least known direction of the hard iron, body axes: turning about an axis across it would teach most.
    pub(super) fn least_known(&self) -> Vector3<f64> {
        let eigen = SymmetricEigen::new(self.bias_covariance());
        eigen.eigenvectors.column(eigen.eigenvalues.imax()).into()
    }

    /// Whether the hard iron has a deviation below this in every direction, milligauss.
    pub(super) fn iron_known_within(&self, limit_mgauss: f64) -> bool {
        // What is left up to the limit is positive definite: no eigenvalue needs to be found.
        let left = Matrix3::identity() * limit_mgauss.powi(2) - self.bias_covariance();
        left.m11 > 0.0 && left.m11 * left.m22 > left.m12 * left.m21 && left.determinant() > 0.0
    }

    /// Covariance of one corrected sample: parameters, unevenness and noise, milligauss².
    pub(super) fn sample_covariance(&self, corrected: &Vector3<f64>) -> Matrix3<f64> {
        let mut jacobian = SMatrix::<f64, 3, 12>::zeros();
        jacobian
            .fixed_columns_mut::<3>(0)
            .copy_from(&Matrix3::identity());
        for row in 0..3 {
            for column in 0..3 {
                jacobian[(row, 3 + 3 * row + column)] = corrected[column];
            }
        }
        let uneven = (self.unevenness2 + self.place2) * self.strength_mgauss.powi(2);
        jacobian * self.parameter_covariance() * jacobian.transpose()
            + Matrix3::identity() * (uneven + self.noise2)
    }

    /// One standard deviation of the hard iron along each body axis, milligauss.
    pub(super) fn bias_sd_mgauss(&self) -> Vector3<f64> {
        Vector3::from_fn(|axis, _| self.p[(B + axis, B + axis)].max(0.0).sqrt())
    }

    fn vector(&self, at: usize) -> Vector3<f64> {
        self.x.fixed_rows::<3>(at).into()
    }

    fn trace(&self, at: usize, count: usize) -> f64 {
        (at..at + count).map(|index| self.p[(index, index)]).sum()
    }

    /// Forgets all about some states, and how they go with others.
    fn clear(&mut self, at: usize, count: usize) {
        for index in at..at + count {
            self.x[index] = 0.0;
            self.p.row_mut(index).fill(0.0);
            self.p.column_mut(index).fill(0.0);
        }
    }
}

impl SeenNorth {
    /// Variance of an angle that depends on the field in the frame and on its tilt error, as these slopes say.
    pub(super) fn variance(&self, by_field: &Vector3<f64>, by_tilt: &Vector3<f64>) -> f64 {
        let field = (by_field.transpose() * self.field_covariance * by_field)[0];
        let tilt = by_tilt.xy();
        field
            + (tilt.transpose() * self.tilt_covariance * tilt)[0]
            + 2.0 * (by_field.transpose() * self.cross * tilt)[0]
    }
}

/// Where a parameter, of b or of D row by row, is in the state.
fn parameter(index: usize) -> usize {
    if index < 3 { B + index } else { D + index - 3 }
}
