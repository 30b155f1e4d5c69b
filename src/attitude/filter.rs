//! Runs VQF on the even clock, resets its accelerometer filters when the accelerometer comes or goes, and disables its rest detection while
//! the field moves.

use std::f64::consts::SQRT_2;

use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector2, Vector3};
use vqf_rs::{Params, VQF};

use super::clock::TICK_S;
use super::field_motion::FieldMotion;
use super::force_readings::{ForceReadings, GRAVITY_M_S2};
use super::gyro_errors::GyroErrors;
use super::stillness::{MOVING_RAD_S, Stillness};
use super::trim::Trim;
use super::{BoardMotion, Pose, TiltError};
use crate::frame::hypot;

/// The vertical is known once the accelerometer has levelled the frame for this long, seconds.
const LEVELLING_S: f64 = 1.0;
/// Tilt that gyro errors may cause, radians (1.4°). The accelerometer's time constant is the longest one that keeps it: a vehicle
/// accelerates for seconds, a gyro error lasts. Where acceleration causes more tilt than this, gyro errors may cause as much: a shorter
/// time constant would let in more acceleration.
const TILT_BUDGET_RAD: f64 = 0.025;
/// Upper limit of that budget while acceleration raises it, radians: the tilt that a wrong gyro causes looks like acceleration.
const MOST_BUDGET_RAD: f64 = 0.1;
/// Error of the gyro for each rad/s that the board turns, as a share of an entry's deviation: a board seldom turns about
/// one axis for as long as the time constant.
const TURNS_ON: f64 = 0.43;
/// Limits of that time constant, seconds. The shortest keeps the budget with an unknown bias of 3.3°/s, one deviation.
const TAU_S: std::ops::RangeInclusive<f64> = 0.4..=20.0;
/// Tilt error of a board that is not accelerated, by the accelerometer's bias, radians: a hundredth of g.
pub const STILL_TILT_RAD: f64 = 0.01;
/// Share of the acceleration over the time constant that passes for tilt. With half, the deviations of a simulated hand and drone are
/// 1.3 and 1.4 times their errors, with 0.7 they are 1.4 and 1.5 times.
const PASSES_FOR_TILT: f64 = 0.5;
/// Rate and acceleration are averaged over this time, seconds.
const MEAN_S: f64 = 3.0;
/// The time constant is replaced when the wanted one differs by more than this factor.
const TAU_STEP: f64 = 1.25;

pub(super) struct AttitudeFilter {
    vqf: VQF,
    pub(super) errors: GyroErrors,
    pub(super) force_readings: ForceReadings,
    pub(super) field_motion: FieldMotion,
    pub(super) stillness: Stillness,
    /// `None` until a force has been felt in a level frame.
    trim: Option<Trim>,
    pub(super) frame_id: u32,
    ticked: bool,
    /// For how long the accelerometer has levelled the frame without a break, seconds.
    levelled_s: Option<f64>,
    /// Whether the board has moved since the vertical became known, or was moving then.
    moved: bool,
    /// Variance of the rotation that the gyro has missed since the last tick, each axis, rad².
    pub(super) missed_rad2: f64,
    /// Both from the first tick on: see [`BoardMotion::missed_rad2`] and [`BoardMotion::turned_rad`].
    all_missed_rad2: f64,
    turned_rad: Vector3<f64>,
    /// Horizontal specific force in the frame over the time constant of the tilt, m/s².
    horizontal_force: Vector2<f64>,
    /// Rotation of the levelled frame for each rad/s of the gyro's bias, body axes, seconds: the rotation matrix from body to that frame,
    /// integrated, and forgotten over the time constant of the tilt.
    tilt_by_bias_s: Matrix3<f64>,
    /// Means over the last seconds: the rate, rad/s, and the tilt error by acceleration, radians.
    mean_rate_rad_s: f64,
    mean_by_acceleration_rad: f64,
    pub(super) rate_rad_s: Vector3<f64>,
}

impl AttitudeFilter {
    pub(super) fn new(bias_limit_deg_s: f64) -> Self {
        let params = Params {
            // `GyroErrors` estimates the bias.
            motion_bias_est_enabled: false,
            bias_clip: bias_limit_deg_s,
            tau_acc: *TAU_S.start(),
            ..Params::default()
        };
        Self {
            errors: GyroErrors::new(bias_limit_deg_s.to_radians()),
            vqf: VQF::new(TICK_S, None, None, Some(params)),
            force_readings: ForceReadings::default(),
            field_motion: FieldMotion::default(),
            stillness: Stillness::default(),
            trim: None,
            frame_id: 0,
            ticked: false,
            levelled_s: None,
            moved: false,
            missed_rad2: 0.0,
            all_missed_rad2: 0.0,
            turned_rad: Vector3::zeros(),
            horizontal_force: Vector2::zeros(),
            tilt_by_bias_s: Matrix3::zeros(),
            mean_rate_rad_s: 0.0,
            mean_by_acceleration_rad: 0.0,
            rate_rad_s: Vector3::zeros(),
        }
    }

    /// Carries the filter on by one tick that ends at `end_s`; `mean_rate` with bias.
    pub(super) fn tick(&mut self, end_s: f64, mean_rate: Vector3<f64>) -> BoardMotion {
        let rate = self.errors.corrected(&mean_rate);
        self.rate_rad_s = rate;
        let felt = self.force_readings.take_tick(end_s, &rate);
        let force = felt.map(|force| self.errors.corrected_force(&force));
        let live = self.force_readings.live(end_s);
        self.follow_accelerometer(live, force.is_some());
        self.guard_rest(end_s, &mean_rate);
        self.stillness.take(rate, force);
        self.moved |= self.vertical_known() && !self.stillness.still();
        self.choose_tilt_tau(rate.norm());

        let missed_rad2 = std::mem::take(&mut self.missed_rad2);
        let before = unit(self.vqf.state().gyr_quat);
        // VQF detects rest by the rate with its bias: a bias that is being learnt would look like motion.
        let bias = self.errors.bias;
        self.vqf.state_mut().bias = bias.into();
        self.vqf.update_gyr((rate + bias).into());
        // At the midpoint, normalised linear interpolation equals slerp.
        let after = unit(self.vqf.state().gyr_quat);
        let middle = UnitQuaternion::new_normalize(before.lerp(&after, 0.5));
        let to_frame = middle.to_rotation_matrix().into_inner();
        self.follow_drift(middle);
        if let Some(trim) = &mut self.trim {
            trim.turn(&rate);
        }
        let at_rest = self.at_rest();
        let force = force.map(|force| self.levelled(force, at_rest));
        self.errors.take(&to_frame, &rate, force.as_ref(), at_rest);
        self.errors.miss(missed_rad2);
        if let Some(force) = force {
            self.vqf.update_acc(force.into());
            self.follow_force(&force);
        } else if !live {
            // VQF counts the time at rest only when the accelerometer reads. Without one it gets a constant, which must not
            // level the frame.
            let frame = self.vqf.state().acc_quat;
            self.vqf.update_acc([0.0, 0.0, GRAVITY_M_S2]);
            self.vqf.state_mut().acc_quat = frame;
        }
        self.ticked = true;
        self.turned_rad += rate * TICK_S;
        self.all_missed_rad2 += missed_rad2;
        BoardMotion {
            t_s: end_s,
            pose: self.pose(),
            rate_rad_s: rate,
            turned_rad: self.turned_rad,
            missed_rad2: self.all_missed_rad2,
            at_rest: self.at_rest(),
        }
    }

    /// The specific force, m/s², without what the board's trim shows to be acceleration.
    fn levelled(&mut self, force: Vector3<f64>, at_rest: bool) -> Vector3<f64> {
        if !self.vertical_known() {
            return force;
        }
        let to_frame = self.orientation().to_rotation_matrix().into_inner();
        let trim = self
            .trim
            .get_or_insert_with(|| Trim::new(to_frame.transpose() * Vector3::z()));
        trim.levelled(&to_frame, &force, at_rest)
    }

    /// Chooses the accelerometer's time constant.
    fn choose_tilt_tau(&mut self, rate_rad_s: f64) {
        self.mean_rate_rad_s += (rate_rad_s - self.mean_rate_rad_s) * (TICK_S / MEAN_S);
        let by_turning = TURNS_ON * self.errors.matrix_sd() * self.mean_rate_rad_s;
        let budget = TILT_BUDGET_RAD.max(self.mean_by_acceleration_rad.min(MOST_BUDGET_RAD));
        let wanted = budget / (self.errors.bias_sd_rad_s() + by_turning);
        let wanted = wanted.clamp(*TAU_S.start(), *TAU_S.end());
        let now = self.tilt_tau_s();
        if wanted > now * TAU_STEP || wanted * TAU_STEP < now {
            self.vqf.set_tau_acc(wanted);
        }
    }

    fn follow_force(&mut self, force: &Vector3<f64>) {
        let horizontal = (self.orientation() * force).xy();
        self.horizontal_force +=
            (horizontal - self.horizontal_force) * (TICK_S / self.tilt_tau_s());
        self.mean_by_acceleration_rad +=
            (self.by_acceleration_rad() - self.mean_by_acceleration_rad) * (TICK_S / MEAN_S);
    }

    /// What acceleration adds to the tilt, radians.
    fn by_acceleration_rad(&self) -> f64 {
        PASSES_FOR_TILT * self.horizontal_force.norm() / GRAVITY_M_S2
    }

    /// Integrates the rotation from body to the levelled frame. The argument is the rotation from body to the gyro's own frame, which is
    /// not level.
    fn follow_drift(&mut self, to_gyro_frame: UnitQuaternion<f64>) {
        let to_frame = unit(self.vqf.state().acc_quat) * to_gyro_frame;
        let to_frame = to_frame.to_rotation_matrix().into_inner();
        self.tilt_by_bias_s += (to_frame - self.tilt_by_bias_s / self.tilt_tau_s()) * TICK_S;
    }

    /// What the tilt is off by now.
    pub(super) fn tilt_error(&self) -> TiltError {
        // On an upright board sway tilts the frame as a bias would, so the tilt is no evidence of the bias. The same holds at rest, where
        // the estimate leaves out its tilt error.
        let by_bias = if self.vertical_known() && !self.stillness.still() {
            1.0 - self.errors.upright_share()
        } else {
            0.0
        };
        let by_trim = self.trim.as_ref().map_or(0.0, |trim| trim.tilt_sd_rad);
        let by_accelerometer = hypot(STILL_TILT_RAD, by_trim);
        let level = self.tilt_by_bias_s.fixed_rows::<2>(0);
        let drift = level * self.errors.bias_covariance() * level.transpose();
        let by_gyro = (drift.trace() / 2.0).max(0.0).sqrt();
        let sd_rad = |by_gyro| hypot(by_accelerometer, hypot(self.by_acceleration_rad(), by_gyro));
        let (by_levelling, tau_s) = self.levelling_error();
        TiltError {
            tau_s,
            by_bias,
            whole_sd_rad: hypot(sd_rad(by_gyro), by_levelling),
            sd_rad: sd_rad(by_gyro * (1.0 - by_bias.powi(2)).sqrt()),
        }
    }

    /// The tilt error of a frame that has been levelled for a short time, radians, and the time constant with which the whole tilt error
    /// fades, seconds. Until its own time constant has passed, VQF takes the mean specific force for gravity. The error of that mean is the
    /// change of the board's velocity divided by the time, and at most the board's acceleration.
    fn levelling_error(&self) -> (f64, f64) {
        let tau_s = self.tilt_tau_s();
        let lately_s = self.levelled_s.filter(|s| self.moved && *s < tau_s);
        let Some(levelled_s) = lately_s else {
            return (0.0, tau_s);
        };
        let most_m_s2 = self.errors.acceleration_m_s2();
        let mean_m_s2 = SQRT_2 * self.errors.speed_m_s() / levelled_s;
        if mean_m_s2 < most_m_s2 {
            (mean_m_s2 / GRAVITY_M_S2, levelled_s)
        } else {
            (most_m_s2 / GRAVITY_M_S2, *TAU_S.end())
        }
    }

    /// Time constant of the tilt, seconds.
    fn tilt_tau_s(&self) -> f64 {
        self.vqf.params().tau_acc
    }

    fn follow_accelerometer(&mut self, live: bool, read: bool) {
        if live != self.levelled_s.is_some() {
            self.forget_force();
            self.levelled_s = live.then_some(0.0);
            if !live {
                (self.horizontal_force, self.mean_by_acceleration_rad) = (Vector2::zeros(), 0.0);
            } else if self.ticked {
                // Levelling turns the frame: poses before and after cannot be compared.
                self.frame_id = self.frame_id.wrapping_add(1);
            }
        }
        if let (Some(levelled_s), true) = (&mut self.levelled_s, read) {
            *levelled_s += TICK_S;
        }
    }

    fn vertical_known(&self) -> bool {
        self.levelled_s.is_some_and(|s| s > LEVELLING_S)
    }

    fn forget_force(&mut self) {
        self.trim = None;
        self.moved = false;
        self.tilt_by_bias_s.fill(0.0);
        let state = self.vqf.state_mut();
        state.acc_lp_state = [[f64::NAN; 2]; 3];
        state.rest_acc_lp_state = [[f64::NAN; 2]; 3];
        state.rest_t = 0.0;
        state.rest_detected = false;
    }

    /// Lets VQF detect rest, which depends on this option, only while the field stands still: a slow steady turn looks like rest.
    fn guard_rest(&mut self, end_s: f64, mean_rate: &Vector3<f64>) {
        let moving = self
            .field_motion
            .moving(end_s)
            // Without a magnetometer the rate alone tells.
            .unwrap_or_else(|| (mean_rate - self.errors.bias).norm() > MOVING_RAD_S);
        self.vqf.set_rest_bias_est_enabled(!moving);
    }

    /// Begins a new frame: how far the board has turned is unknown.
    pub(super) fn lose_frame(&mut self) {
        self.frame_id = self.frame_id.wrapping_add(1);
        self.ticked = false;
        self.levelled_s = None;
        self.missed_rad2 = 0.0;
        self.forget_force();
        self.errors.lose_frame();
        let state = self.vqf.state_mut();
        state.rest_gyr_lp_state = [[f64::NAN; 2]; 3];
    }

    /// The pose at the end of the last tick.
    pub(super) fn pose(&self) -> Pose {
        Pose {
            orientation: self.orientation(),
            vertical_known: self.vertical_known(),
            frame_id: self.frame_id,
        }
    }

    /// Up in body axes.
    pub(super) fn up(&self) -> Vector3<f64> {
        self.orientation().inverse_transform_vector(&Vector3::z())
    }

    /// Body to earth with an arbitrary north.
    fn orientation(&self) -> UnitQuaternion<f64> {
        unit(self.vqf.quat_6d())
    }

    pub(super) fn at_rest(&self) -> bool {
        self.vqf.rest_detected()
    }
}

/// The filter's quaternion as ours.
fn unit(quaternion: vqf_rs::Quaternion) -> UnitQuaternion<f64> {
    let vqf_rs::Quaternion(w, x, y, z) = quaternion;
    UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z))
}
