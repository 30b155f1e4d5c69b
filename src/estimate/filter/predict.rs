//! The filter's step in time: what turns, what fades, and the process noise.

use nalgebra::{Matrix3, SMatrix, Vector3};

use super::{
    DISTURBED, FORGET_MOVING_S, Filter, Input, PLACE_LASTS_S, SWING_RAD, USUAL_UNEVENNESS,
};
use crate::estimate::covariance::{B, D, E, G, H, M, Q, S, Transition};
use crate::frame::{add_variance, angle_between_rad, put, variance_along};
use crate::reading::STRONGEST_MGAUSS;

/// The second-order noise treats the gyro's bias as a new random value in each such period, seconds. The term is small, so the value is not
/// critical.
const BIAS_DRAWN_S: f64 = 1.0;
/// Walk of the frame by a gyro's cross-axis errors, one standard deviation, radians per √rad turned. Gravity leaves part of a
/// cross-axis error of 1 % (data sheets: 2 % at most), which turns the frame another way in each radian. With 0.0028 boards that turn
/// fast are too sure, with 0.004 drones not sure enough.
const GYRO_CROSS: f64 = 0.0035;
/// Angle random walk of the frame, rad/√s (0.02 °/√s): data sheets state noise densities of 0.005 (MPU-6050) to 0.03 °/s/√Hz (ITG-3200).
/// The attitude (`attitude/gyro_errors/predict.rs`) takes the larger one.
const ANGLE_WALK_RAD: f64 = 0.000_35;
/// Share of that walk's variance which is left on a still board: its true turn is 0, so most of the gyro's noise is known.
const STILL_WALK: f64 = 0.1;
/// Unevenness is forgotten by turning this far, radians, and on a still board in this time, seconds: what people bring near such a board
/// stays for minutes.
const FORGET_RAD: f64 = 0.52;
const FORGET_STILL_S: f64 = 600.0;
/// Uncertain iron may have absorbed part of the unevenness. So in motion the unevenness is at least this fraction of the iron's deviation
/// (both as shares of the field), but this floor never exceeds `USUAL_UNEVENNESS`. At 0 a simulated car that others pass before its first
/// turn learns wrong iron and is sure of it; at twice the value cars learn later, for nothing.
const IRON_HIDES: f64 = 0.3;
/// Walk of the earth's field, share per √s, and of the hard iron, milligauss per √s: 1.2 % and 3 mG in an hour of motion, as the
/// chip's gain and offset drift while it warms up. Half or twice as much changes no simulated family by more than a few per cent.
const FIELD_WALK: f64 = 0.0002;
const IRON_WALK_MGAUSS: f64 = 0.05;
/// Model errors repeat with the attitude, so swinging back and forth does not average them out. Their size, as a share of the field, is
/// that of the measured unevenness and tilt error, limited to `USUAL_UNEVENNESS`. So iron and matrix walk by turning: the iron by this
/// multiple of that size per √rad. Without the tilt error a boat at anchor is falsely sure twice as often.
const IRON_TURN: f64 = 0.2;
/// Walk of each entry of D per √rad, as a multiple of the same size. Half or twice as much keeps the simulated families within their
/// limits.
const MATRIX_TURN: f64 = 0.067;
/// Mean square over the axes of what a tilt error makes of a field, as a share of both: it moves the field on two of three axes.
const BY_TILT: f64 = 2.0 / 3.0;
/// Unusual unevenness on a turning board is probably new iron: its variance is added to the hard iron in full, and this share of it to the
/// field.
const FIELD_SHARE: f64 = 0.003;
/// Only a rate above this moves that variance to the iron, rad/s (3°/s): a gyro's bias may be as much.
const NO_TURN_RAD_S: f64 = 0.05;

impl Filter {
    /// Carries the state on to the sample. With `fixed`, hard iron and matrix do not walk: no sample would reduce their variance again, and
    /// headings would be lost within minutes.
    pub(super) fn predict(&mut self, input: &Input, fixed: bool) -> Transition {
        self.still = input.board.still;
        self.vertical_known = input.vertical_known;
        let h = self.vector(H);
        let strength2 = h.norm_squared() + self.trace(H, 3);
        // Uncertain iron makes the field uncertain, not stronger than any on earth.
        let strength2 = strength2.min(STRONGEST_MGAUSS.powi(2).max(h.norm_squared()));
        let turned_rad = self.turned_since_last(input);
        let noise_share = self.noise_share(input);
        let transition = self.transition(input, turned_rad, noise_share);
        self.propagate(&transition);

        let uneven = self.unevenness_ahead2(input.board.still) * strength2;
        let place = self.place2 * strength2;
        let noise = self.frame_noise(input, &h, turned_rad, noise_share);
        self.add_walks(input, strength2, turned_rad, fixed);
        let gained = |kept: f64, variance: f64| (1.0 - kept * kept) * variance;
        let tilt2 = gained(transition.tilt, input.board.tilt_error.sd_rad.powi(2));
        add_variance(&mut self.p, M..M + 3, gained(transition.unevenness, uneven));
        add_variance(&mut self.p, Q..Q + 3, gained(transition.place, place));
        add_variance(&mut self.p, E..E + 2, tilt2 + input.missed_rad2);
        let mut field = self.p.fixed_view_mut::<3, 3>(H, H);
        field += noise;
        self.strength_rms_mgauss = strength2.sqrt();
        transition
    }

    /// How the state changes until the sample, before which the board has turned by `turned_rad`. Of the turn that the gyro has measured,
    /// `noise_share` is noise.
    fn transition(&self, input: &Input, turned_rad: f64, noise_share: f64) -> Transition {
        let (r, dt, still) = (input.to_frame, input.period_s, input.board.still);
        let w = input.turn_rate();
        // The turn that the gyro's errors add to the frame. At rest the true turn is 0: all that is measured is error, as far as the
        // gyro's noise explains it. If the vertical is known, the accelerometer holds the tilt.
        let by_errors_rad = (self.vector(G) + self.vector(S).component_mul(&w)) * dt;
        let mut turn = r * (by_errors_rad * (1.0 - noise_share) + input.turned_rad * noise_share);
        let mut by_errors = SMatrix::<f64, 3, 6>::zeros();
        put(&mut by_errors, (0, 0), &(r * dt * (1.0 - noise_share)));
        let by_scale = r * Matrix3::from_diagonal(&w) * dt;
        put(&mut by_errors, (0, 3), &by_scale);
        if input.vertical_known {
            (turn.x, turn.y) = (0.0, 0.0);
            by_errors.fixed_rows_mut::<2>(0).fill(0.0);
        }
        let forget_s = if still {
            FORGET_STILL_S
        } else {
            FORGET_MOVING_S
        };
        let length = turned_rad / FORGET_RAD + dt / forget_s;
        let tilt_error = &input.board.tilt_error;
        let tilt = (-dt / tilt_error.tau_s).exp();
        let tilt_s = tilt_error.tau_s * (1.0 - tilt) * tilt_error.by_bias;
        let place = if still {
            1.0
        } else {
            (-dt / PLACE_LASTS_S).exp()
        };
        Transition {
            field: Matrix3::identity() + turn.cross_matrix(),
            by_gyro: -self.vector(H).cross_matrix() * by_errors,
            tilt,
            tilt_by_bias: r.fixed_rows::<2>(0) * tilt_s,
            unevenness: (-length).exp(),
            place,
        }
    }

    fn propagate(&mut self, transition: &Transition) {
        transition.propagate(&mut self.p);
        let field = transition.field * self.vector(H);
        put(&mut self.x, (H, 0), &field);
        let tilt =
            self.x.fixed_rows::<2>(E) * transition.tilt + transition.tilt_by_bias * self.vector(G);
        put(&mut self.x, (E, 0), &tilt);
        self.x
            .fixed_rows_mut::<3>(M)
            .scale_mut(transition.unevenness);
        // How the gyro's errors turn m and q is neglected, here as in P: each sample measures m, and q is at most 2 % of the field.
        self.x.fixed_rows_mut::<3>(Q).scale_mut(transition.place);
    }

    /// Covariance that the frame's walk adds to the field, which it turns: to first order by the field, to second order by its covariance.
    /// To second order an uncertain gyro bias counts as a walk: as a new random value in each `BIAS_DRAWN_S`.
    fn frame_noise(
        &self,
        input: &Input,
        h: &Vector3<f64>,
        turned_rad: f64,
        noise_share: f64,
    ) -> Matrix3<f64> {
        let dt = input.period_s;
        let walk = ANGLE_WALK_RAD.powi(2) * dt * if input.board.still { STILL_WALK } else { 1.0 }
            + GYRO_CROSS.powi(2) * turned_rad
            + input.missed_rad2;
        let bias = self.gyro_bias_covariance() * (1.0 - noise_share).powi(2);
        let axes = if input.vertical_known { 2..3 } else { 0..3 };
        let uncertain = self.field_covariance();
        let mut noise = Matrix3::zeros();
        for axis in axes {
            let lever = input.to_frame.row(axis).transpose();
            let drift = variance_along(&bias, &lever) * BIAS_DRAWN_S * dt;
            let cross = Vector3::ith(axis, 1.0).cross_matrix();
            let turned = h * h.transpose() * walk + uncertain * (walk + drift);
            noise += cross * turned * cross.transpose();
        }
        noise
    }

    /// The share of the measured turn that is the gyro's noise, 0 to 1; 0 unless the board rests.
    fn noise_share(&self, input: &Input) -> f64 {
        if input.rests() {
            self.rest.noise_share()
        } else {
            0.0
        }
    }

    /// Adds the walks of field and gyro bias, and, unless they are `fixed`, of hard iron and matrix.
    fn add_walks(&mut self, input: &Input, strength2: f64, turned_rad: f64, fixed: bool) {
        let dt = input.period_s;
        let unusual = self.unusual_unevenness2();
        let rate = input.turn_rate().norm();
        let turned = 1.0 - (-2.0 * (rate - NO_TURN_RAD_S).max(0.0) * dt / FORGET_RAD).exp();
        let moved_iron = unusual * turned * strength2;
        let by_tilt2 = BY_TILT * input.board.tilt_error.whole_sd_rad.powi(2);
        let left_out2 = (self.unevenness2 + by_tilt2).min(USUAL_UNEVENNESS.powi(2));
        let moving_s = if input.board.still { 0.0 } else { dt };
        let field = FIELD_WALK.powi(2) * moving_s * strength2 + FIELD_SHARE * moved_iron;
        let iron = IRON_WALK_MGAUSS.powi(2) * moving_s
            + moved_iron
            + IRON_TURN.powi(2) * left_out2 * strength2 * turned_rad;
        add_variance(&mut self.p, H..H + 3, field);
        let bias = input.board.gyro_bias.rad_s + self.vector(G);
        let uncertain = self.gyro_bias_covariance();
        let walk = &mut self.gyro_bias_walk;
        let walked2 = walk.take(&bias, &uncertain, &Matrix3::identity(), dt);
        add_variance(&mut self.p, G..G + 3, walked2);
        if fixed {
            return;
        }
        add_variance(&mut self.p, B..B + 3, iron);
        let matrix_walk = MATRIX_TURN.powi(2) * left_out2 * turned_rad;
        add_variance(&mut self.p, D..D + 9, matrix_walk);
        // D's trace is held: of its entries, row by row, 0, 4 and 8 are on the diagonal.
        for row in (0..9).step_by(4) {
            for column in (0..9).step_by(4) {
                self.p[(D + row, D + column)] -= matrix_walk / 3.0;
            }
        }
    }

    /// Variance of the unevenness to come on each axis, as a share of the field. On a still board, which hardly measures it, it is at least
    /// that of usual places. Iron nearby may move on: above `DISTURBED` the variance covers all that the iron adds, so that the change is
    /// not taken for drift of the frame.
    fn unevenness_ahead2(&self, still: bool) -> f64 {
        if !still {
            let iron2 = self.trace(B, 3) / 3.0 / self.strength_rms_mgauss.powi(2);
            let hidden2 = (IRON_HIDES.powi(2) * iron2).min(USUAL_UNEVENNESS.powi(2));
            return self.unevenness2.max(hidden2);
        }
        let still2 = self.unevenness2.max(USUAL_UNEVENNESS.powi(2));
        let share = self.unevenness_share();
        if share > DISTURBED {
            still2.max(share.powi(2) / 3.0)
        } else {
            still2
        }
    }

    /// How far the board has turned since the sample before, radians. On a still board rotation counts in steps of `SWING_RAD`; otherwise
    /// the gyro's noise would add up.
    fn turned_since_last(&mut self, input: &Input) -> f64 {
        if !input.board.still {
            self.last_attitude = input.to_frame;
            return input.rate_rad_s.norm() * input.period_s;
        }
        let turned_rad = angle_between_rad(&self.last_attitude, &input.to_frame);
        if turned_rad < SWING_RAD {
            return 0.0;
        }
        self.last_attitude = input.to_frame;
        turned_rad
    }
}
