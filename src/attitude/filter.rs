//! VQF on the even clock, and what it must be told: where the accelerometer comes and goes, when the board
//! may be at rest, which field it sees.

use nalgebra::{UnitQuaternion, Vector2, Vector3};
use vqf_rs::{Params, VQF};

use super::clock::PERIOD_S;
use super::gravity::Gravity;
use super::steadiness::Steadiness;
use super::stillness::Stillness;
use super::{Pose, Tick, unit};

/// So long must the accelerometer have had its part before the vertical is called known.
const LEVELLING_S: f64 = 1.0;
/// What gyro errors may add to the tilt, radians (1.4°): the accelerometer's time constant is as long as that allows, since
/// a vehicle's acceleration lasts for seconds, and an error of the gyro for ever.
const TILT_BUDGET_RAD: f64 = 0.025;
/// Error of the gyro for each rad/s that the board turns: scale and cross-axis errors.
const GYRO_ERROR: f64 = 0.005;
/// Limits of that time constant, seconds.
const TAU_S: std::ops::RangeInclusive<f64> = 1.0..=60.0;
/// A horizontal acceleration, as the frame shows it, that is as large as what is left of the tilt, m/s² (3°), and over
/// which time it is seen, seconds. Larger ones are the board's, and lengthen the time constant.
const SWAY_M_S2: f64 = 0.5;
const SWAY_TAU_S: f64 = 1.0;
const GRAVITY_M_S2: f64 = 9.81;
/// The time constant is lengthened no further than by this share, and only while the board turns slowly, rad/s: the
/// gyro's own errors grow with it.
const LONGEST: f64 = 1.5;
const SLOW_RAD_S: f64 = 0.5;
/// Tilt error of a board that is not accelerated, radians: what its accelerometer is off.
const TILT_RAD: f64 = 0.012;
/// Share of the acceleration over the time constant that passes for tilt.
const PASSES_FOR_TILT: f64 = 0.5;
/// It follows the mean rate over this time, seconds, in steps of this factor.
const RATE_TAU_S: f64 = 3.0;
const TAU_STEP: f64 = 1.25;
/// Without a magnetometer, a rate that differs by more from the bias learnt so far is motion, rad/s.
const BLIND_REST_RAD_S: f64 = 2.0 * std::f64::consts::PI / 180.0;
/// Ticks between two entries of the bias history, and its length: 3 s.
const HISTORY_TICKS: u32 = 50;
const HISTORY: usize = 6;

pub(super) struct Filter {
    vqf: VQF,
    pub(super) gravity: Gravity,
    pub(super) steadiness: Steadiness,
    stillness: Stillness,
    pub(super) stretch: u32,
    ticked: bool,
    /// Since when the accelerometer has had its part without a break.
    levelled_since_s: Option<f64>,
    vertical_known: bool,
    /// Horizontal specific force in the frame, m/s²: over a second, and over the time constant of the tilt.
    sway: Vector2<f64>,
    pull: Vector2<f64>,
    /// Mean rate over the last seconds, rad/s.
    mean_rate_rad_s: f64,
    rate_rad_s: Vector3<f64>,
    /// Biases while at rest, oldest first, one each half second.
    rest_history: Vec<[f64; 3]>,
    rest_ticks: u32,
}

impl Filter {
    pub(super) fn new(bias_limit_deg_s: f64) -> Self {
        let params = Params {
            motion_bias_est_enabled: false,
            bias_clip: bias_limit_deg_s,
            // A wider start would swing far before it settles on a board that moves from the first.
            bias_sigma_init: (bias_limit_deg_s / 10.0).max(0.5),
            tau_acc: *TAU_S.start(),
            ..Params::default()
        };
        Self {
            vqf: VQF::new(PERIOD_S, None, None, Some(params)),
            gravity: Gravity::default(),
            steadiness: Steadiness::default(),
            stillness: Stillness::default(),
            stretch: 0,
            ticked: false,
            levelled_since_s: None,
            vertical_known: false,
            sway: Vector2::zeros(),
            pull: Vector2::zeros(),
            mean_rate_rad_s: 0.0,
            rate_rad_s: Vector3::zeros(),
            rest_history: Vec::with_capacity(HISTORY + 1),
            rest_ticks: 0,
        }
    }

    /// Carries the filter on by one tick that ends at `end_s`; `mean_rate` with bias.
    pub(super) fn tick(&mut self, end_s: f64, mean_rate: Vector3<f64>) -> Tick {
        let force = self.gravity.at_tick(end_s);
        let live = self.gravity.live(end_s);
        self.follow_accelerometer(end_s, live);
        self.guard_rest(end_s, &mean_rate);
        let rate = mean_rate - self.bias();
        self.rate_rad_s = rate;
        self.stillness.take(PERIOD_S, rate, force);
        self.follow_rate(rate.norm());

        self.vqf.update_gyr(mean_rate.into());
        if let Some(force) = force {
            self.vqf.update_acc(force.into());
            self.follow_force(&force);
        } else if !live {
            // VQF counts the time at rest with the accelerometer. A made-up one serves for that, but must
            // not level the frame.
            let frame = self.vqf.state().acc_quat;
            self.vqf.update_acc([0.0, 0.0, 9.81]);
            self.vqf.state_mut().acc_quat = frame;
        }
        self.remember_rest();
        self.ticked = true;
        Tick {
            t_s: end_s,
            period_s: PERIOD_S,
            pose: Pose {
                orientation: self.orientation(),
                vertical_known: self.vertical_known,
                stretch: self.stretch,
            },
            rate_rad_s: rate,
            at_rest: self.at_rest(),
        }
    }

    /// Chooses how long the accelerometer's time constant is.
    fn follow_rate(&mut self, rate_rad_s: f64) {
        self.mean_rate_rad_s += (rate_rad_s - self.mean_rate_rad_s) * PERIOD_S / RATE_TAU_S;
        let bias_sd = self.vqf.bias_estimate().1;
        let accelerated = (self.sway.norm() / SWAY_M_S2).powi(2);
        let wanted = TILT_BUDGET_RAD / (bias_sd + GYRO_ERROR * self.mean_rate_rad_s);
        let wanted = wanted.min(20.0)
            * (1.0
                + accelerated.min(LONGEST * (-(self.mean_rate_rad_s / SLOW_RAD_S).powi(2)).exp()));
        let wanted = wanted.clamp(*TAU_S.start(), *TAU_S.end());
        let now = self.tilt_tau_s();
        if wanted > now * TAU_STEP || wanted * TAU_STEP < now {
            self.vqf.set_tau_acc(wanted);
        }
    }

    fn follow_force(&mut self, force: &Vector3<f64>) {
        let horizontal = (self.orientation() * force).xy();
        self.sway += (horizontal - self.sway) * (PERIOD_S / SWAY_TAU_S);
        self.pull += (horizontal - self.pull) * (PERIOD_S / self.tilt_tau_s());
    }

    /// What the tilt is off by now, one standard deviation, radians.
    pub(super) fn tilt_sd_rad(&self) -> f64 {
        TILT_RAD.hypot(PASSES_FOR_TILT * self.pull.norm() / GRAVITY_M_S2)
    }

    /// Time constant of the tilt, seconds.
    pub(super) fn tilt_tau_s(&self) -> f64 {
        self.vqf.params().tau_acc
    }

    fn follow_accelerometer(&mut self, end_s: f64, live: bool) {
        if live != self.levelled_since_s.is_some() {
            self.forget_force();
            self.levelled_since_s = live.then_some(end_s);
            // Levelling turns the frame: poses before and after cannot be compared.
            if live && self.ticked {
                self.stretch = self.stretch.wrapping_add(1);
            }
        }
        self.vqf.set_motion_bias_est_enabled(live);
        self.vertical_known = self
            .levelled_since_s
            .is_some_and(|since_s| end_s - since_s >= LEVELLING_S);
    }

    fn forget_force(&mut self) {
        let state = self.vqf.state_mut();
        state.acc_lp_state = [[f64::NAN; 2]; 3];
        state.rest_acc_lp_state = [[f64::NAN; 2]; 3];
        state.motion_bias_est_rlp_state = [[f64::NAN; 2]; 9];
        state.motion_bias_est_bias_lp_state = [[f64::NAN; 2]; 2];
        state.rest_t = 0.0;
        state.rest_detected = false;
    }

    /// Keeps the filter from taking a slow steady turn for rest, and its rate for bias.
    fn guard_rest(&mut self, end_s: f64, mean_rate: &Vector3<f64>) {
        let moving = self
            .steadiness
            .moving(end_s)
            .unwrap_or_else(|| (mean_rate - self.bias()).norm() > BLIND_REST_RAD_S);
        if moving && self.at_rest() && self.rest_history.len() == HISTORY {
            // It takes a moment to see that a gentle start was one; the bias learnt meanwhile is motion.
            self.vqf.set_bias_estimate(self.rest_history[0], None);
        }
        self.vqf.set_rest_bias_est_enabled(!moving);
    }

    fn remember_rest(&mut self) {
        if !self.at_rest() {
            self.rest_history.clear();
            self.rest_ticks = 0;
            return;
        }
        self.rest_ticks += 1;
        if self.rest_ticks >= HISTORY_TICKS {
            self.rest_ticks = 0;
            if self.rest_history.len() == HISTORY {
                self.rest_history.remove(0);
            }
            self.rest_history.push(self.vqf.state().bias);
        }
    }

    /// The gyro speaks again after a hole: nobody knows how the board has turned meanwhile.
    pub(super) fn resume_after_hole(&mut self) {
        self.stretch = self.stretch.wrapping_add(1);
        self.ticked = false;
        self.levelled_since_s = None;
        self.vertical_known = false;
        self.forget_force();
        let state = self.vqf.state_mut();
        state.rest_gyr_lp_state = [[f64::NAN; 2]; 3];
    }

    /// Body to earth with an arbitrary north.
    pub(super) fn orientation(&self) -> UnitQuaternion<f64> {
        unit(self.vqf.quat_6d())
    }

    pub(super) fn vertical_known(&self) -> bool {
        self.vertical_known
    }

    pub(super) fn bias(&self) -> Vector3<f64> {
        self.vqf.state().bias.into()
    }

    pub(super) fn at_rest(&self) -> bool {
        self.vqf.rest_detected()
    }

    pub(super) fn rate_rad_s(&self) -> Vector3<f64> {
        self.rate_rad_s
    }

    pub(super) fn still(&self) -> bool {
        self.stillness.still()
    }
}
