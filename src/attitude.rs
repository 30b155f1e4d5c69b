//! Where the board points, how it turns and whether it rests.
//!
//! `clock` makes even ticks, `gyro_errors` learns the errors of gyro and accelerometer, `trim` finds a vehicle's acceleration, and `filter`
//! carries VQF on. Pure: time comes with the readings.
//!
//! | whether the board moves | by | for |
//! |---|---|---|
//! | [`BoardState::still`] | gyro and accelerometer, over half a second | what moves then is the field, not the board |
//! | [`BoardState::at_rest`] | gyro and accelerometer over 1.5 s (VQF), and the raw field over ten | the gyro reads its bias |

use nalgebra::{Matrix3, UnitQuaternion, Vector3};

use crate::check::settings;
use crate::frame::{Mountings, hypot};
use crate::reading::Reading;

mod bias_jump;
mod bias_walk;
mod clipping;
mod clock;
mod field_motion;
mod filter;
mod force_readings;
mod gyro_errors;
mod lateness;
mod past;
mod rate_changes;
mod seam;
mod stillness;
#[cfg(test)]
pub(crate) mod test_board;
#[cfg(test)]
mod tests;
mod trim;

use bias_jump::{BiasJumps, FOUND_AFTER_S};
pub use bias_walk::BiasWalk;
use clipping::ClipWatch;
use clock::EvenClock;
pub use clock::TICK_S;
use filter::AttitudeFilter;
pub use filter::STILL_TILT_RAD;
pub use force_readings::GRAVITY_M_S2;
use gyro_errors::{GAP_BIAS_RAD_S, RESTART_BIAS_RAD_S};
pub use lateness::Lateness;
use past::Past;
use rate_changes::RateChanges;
use seam::SeamWatch;

/// If the gyro may have missed more than this, the frame is lost, radians: about the tilt that a hand's acceleration leaves in a frame that is
/// levelled anew. From half to twice as much changes no figure.
const MOST_MISSED_RAD: f64 = 0.1;

/// Where the board points at one instant, by gyro and accelerometer alone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Turns body vectors into an earth frame whose Z points up and whose X is arbitrary; without an
    /// accelerometer the whole frame is arbitrary.
    pub orientation: UnitQuaternion<f64>,
    /// Whether the earth frame's Z is known to be up.
    pub vertical_known: bool,
    /// Changes whenever the frame is lost (gap, seam, clipping, missed turn) and whenever an accelerometer begins to level it: poses of
    /// different frames cannot be compared.
    pub frame_id: u32,
}

/// How the board lay and turned at one instant: at the end of a tick of the even clock, or between two.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoardMotion {
    /// That instant, seconds. Ticks end evenly, except across a gap in the gyro's readings.
    pub t_s: f64,
    /// The pose then.
    pub pose: Pose,
    /// Angular rate in the body frame, freed of its bias, rad/s.
    pub rate_rad_s: Vector3<f64>,
    /// Integral of that rate from the first tick on, radians.
    pub turned_rad: Vector3<f64>,
    /// Variance of the rotation that the gyro has missed from the first tick on, each axis, rad².
    pub missed_rad2: f64,
    /// The board is at rest: what the gyro reads now is bias and noise.
    pub at_rest: bool,
}

/// A bias of the gyro, as it is taken out of the rates.
#[derive(Clone, Copy, Debug, Default)]
pub struct GyroBias {
    /// Body axes, rad/s.
    pub rad_s: Vector3<f64>,
    /// Its covariance, (rad/s)².
    pub covariance: Matrix3<f64>,
    /// Variance, (rad/s)², that has been added on each axis since the start, where the gyro may have been started again or its bias has
    /// jumped.
    pub doubted2: f64,
    /// Variance, (rad/s)², that its walk has added on each axis since the start.
    pub walked2: f64,
    /// How often the bias has been forgotten since the start.
    pub begun_anew: u32,
}

/// What the tilt of a pose is off by. It fades as the accelerometer corrects it, and an error of the gyro's bias adds to it.
#[derive(Clone, Copy, Debug)]
pub struct TiltError {
    /// Time constant with which it fades, seconds.
    pub tau_s: f64,
    /// Share of the bias's tilt that is evidence of the bias, 0 to 1.
    pub by_bias: f64,
    /// One standard deviation on each horizontal axis, radians.
    pub whole_sd_rad: f64,
    /// The same without what `by_bias` and recent levelling add.
    pub sd_rad: f64,
}

/// The state of board and gyro at one instant, beside pose and rate.
#[derive(Clone, Copy, Debug)]
pub struct BoardState {
    /// Whether the board is at rest, by gyro, accelerometer and field: the gyro's rate is its bias.
    pub at_rest: bool,
    /// Whether gyro and accelerometer have been quiet for half a second; a field that changes does not matter.
    pub still: bool,
    /// The gyro's bias as learnt so far.
    pub gyro_bias: GyroBias,
    /// M, the gyro's scale and cross-axis errors that are taken out of the rates: it reads (I + M) times the rate.
    pub gyro_matrix: Matrix3<f64>,
    /// What the tilt is off by.
    pub tilt_error: TiltError,
    /// For how long the gyro has read the same to the last bit, seconds, beyond the usual repetition of its readings.
    pub gyro_constant_s: f64,
    /// Specific force, body axes, m/s², low-passed over 0.2 s; `None` while the accelerometer is silent.
    pub force_m_s2: Option<Vector3<f64>>,
}

settings! {
    /// Settings of the attitude.
    #[derive(Copy)]
    pub struct Settings {
        /// Largest gyro bias to expect on an axis, degrees per second.
        gyro_bias_limit_deg_s: f64 = 10.0, 1.0..=60.0, "degrees per second";
        /// A longer silence of the gyro is a gap, seconds.
        gap_s: f64 = 0.5, 0.05..=2.0, "seconds";
        /// The gyro's full scale, degrees per second. Without it, the largest rate that an axis has repeated counts as full scale until
        /// the gyro exceeds it.
        gyro_range_deg_s: Option<f64> = None, 50.0..=10_000.0, "degrees per second";
    }
}

/// Follows the board's attitude reading by reading.
pub struct Attitude {
    mountings: Mountings,
    clock: EvenClock,
    clip: ClipWatch,
    rate_changes: RateChanges,
    rate_late: Lateness,
    force_late: Lateness,
    seam: SeamWatch,
    bias_jumps: BiasJumps,
    filter: AttitudeFilter,
    past: Past,
}

impl Attitude {
    /// An attitude that knows nothing yet.
    pub fn new(settings: &Settings, mountings: &Mountings) -> Self {
        Self {
            mountings: *mountings,
            clock: EvenClock::new(settings.gap_s),
            clip: ClipWatch::new(settings.gyro_range_deg_s),
            rate_changes: RateChanges::default(),
            rate_late: Lateness::default(),
            force_late: Lateness::default(),
            seam: SeamWatch::default(),
            bias_jumps: BiasJumps::default(),
            filter: AttitudeFilter::new(settings.gyro_bias_limit_deg_s),
            past: Past::default(),
        }
    }

    /// Begins with the gyro's bias of the last start, gyro chip axes, rad/s.
    pub fn expect_gyro_bias(&mut self, chip_rad_s: Vector3<f64>) {
        self.filter
            .errors
            .expect_bias(self.mountings.gyro.to_body(chip_rad_s));
    }

    /// Goes on with this bias of the accelerometer, accelerometer chip axes, m/s².
    pub fn expect_force_bias(&mut self, chip_m_s2: Vector3<f64>) {
        self.filter
            .errors
            .expect_force_bias(self.mountings.accel.to_body(chip_m_s2));
    }

    /// The bias that is taken out of the specific force, accelerometer chip axes, m/s²; `None` while none is.
    pub fn force_bias_m_s2(&self) -> Option<Vector3<f64>> {
        let body = self.filter.errors.force_bias;
        (body != Vector3::zeros()).then(|| self.mountings.accel.to_chip(body))
    }

    /// Forgets everything but the walk of the gyro's bias, and counts that in [`GyroBias::begun_anew`]. Poses from before are of another
    /// frame.
    pub fn renew(&mut self, settings: &Settings, mountings: &Mountings) {
        let mut anew = Self::new(settings, mountings);
        anew.filter.frame_id = self.filter.frame_id.wrapping_add(1);
        anew.filter.errors.inherit_totals(&self.filter.errors);
        *self = anew;
    }

    /// Takes a reading whose numbers are possible (`outliers` drops the others), raw field and all, and calls `on_tick` with each tick
    /// that it completes. Ticks come with the gyro.
    pub fn take(&mut self, reading: &Reading, on_tick: impl FnMut(&BoardMotion)) {
        if let Some(field) = reading.whole_field_mgauss() {
            self.take_field(reading.t_s, field);
        }
        if let Some(force) = reading.specific_force_m_s2 {
            self.take_force(reading.t_s, force);
        }
        if let Some(rate) = reading.rate_rad_s {
            self.take_rate(reading.t_s, rate, on_tick);
        }
    }

    fn take_field(&mut self, t_s: f64, field: Vector3<f64>) {
        self.filter.field_motion.take(t_s, field);
        self.seam.take_field(t_s, field, self.filter.up());
    }

    fn take_force(&mut self, t_s: f64, chip: Vector3<f64>) {
        let t_s = t_s - self.force_late.take(t_s);
        let force = self.mountings.accel.to_body(chip);
        self.filter.force_readings.take(t_s, force);
        self.seam.take_force(t_s, force, self.filter.up());
    }

    fn take_rate(&mut self, t_s: f64, chip: Vector3<f64>, mut on_tick: impl FnMut(&BoardMotion)) {
        let t_s = t_s - self.rate_late.take(t_s);
        if self.clock.gap_before(t_s) {
            self.filter.errors.doubt_bias(GAP_BIAS_RAD_S);
        }
        let missed_rad = self.rate_changes.take(t_s, chip);
        if !self.still() {
            self.miss(missed_rad);
        }
        self.filter.errors.timing_walk_s2 = self.rate_late.walk_s2();
        let rate = self.mountings.gyro.to_body(chip);
        let (filter, past, seam) = (&mut self.filter, &mut self.past, &mut self.seam);
        let bias_jumps = &mut self.bias_jumps;
        let (mut seam_found, mut bias_jump) = (false, None);
        let gap = self.clock.gap_before(t_s);
        let taken = self.clock.take(t_s, rate, |end_s, mean_rate| {
            let tick = filter.tick(end_s, mean_rate);
            past.take(&tick);
            bias_jump = bias_jumps
                .take(mean_rate, &filter.errors.bias)
                .or(bias_jump);
            seam_found |= seam.tick(&tick.rate_rad_s, filter.force_readings.newest(end_s));
            on_tick(&tick);
        });
        if let Some(jump_rad_s) = bias_jump {
            self.filter.errors.doubt_bias(jump_rad_s);
            self.miss(jump_rad_s * FOUND_AFTER_S);
        }
        if seam_found {
            self.filter.errors.doubt_bias(RESTART_BIAS_RAD_S);
        }
        let reads_again = taken && self.clip.take(&chip);
        if seam_found || gap || reads_again {
            self.lose_frame();
        }
    }

    /// The gyro has missed a rotation of this deviation on each axis, radians.
    fn miss(&mut self, sd_rad: f64) {
        self.filter.missed_rad2 += sd_rad * sd_rad;
        if sd_rad > MOST_MISSED_RAD {
            self.clock.forget();
            self.lose_frame();
        }
    }

    /// Begins a new frame: orientation and vertical are unknown.
    fn lose_frame(&mut self) {
        self.filter.lose_frame();
        self.seam.stop_comparing();
        self.bias_jumps = BiasJumps::default();
    }

    /// The pose at `t_s`, up to a quarter of a second ago, or carried on from the last tick with the current rate; `None` if the
    /// gyro has been silent for longer than a gap, or has not been read yet.
    pub fn pose_at(&self, t_s: f64) -> Option<Pose> {
        let beyond = self.clock.beyond_tick_rad(t_s, self.filter.errors.bias)?;
        if self.past.reaches(t_s) {
            return self.motion_at(t_s).map(|motion| motion.pose);
        }
        let mut pose = self.filter.pose();
        pose.orientation *= UnitQuaternion::from_scaled_axis(beyond);
        Some(pose)
    }

    /// Pose and rate at `t_s`, up to a quarter of a second ago; outside that time the nearest rate is held. `None` before the first tick
    /// of this frame.
    pub fn motion_at(&self, t_s: f64) -> Option<BoardMotion> {
        let motion = self.past.at(t_s)?;
        (motion.pose.frame_id == self.filter.frame_id).then_some(motion)
    }

    /// Where down is at `t_s`, a unit vector of body axes: from gyro and accelerometer, from the accelerometer
    /// alone where the gyro is silent or new, `None` without an accelerometer.
    pub fn down(&self, t_s: f64) -> Option<Vector3<f64>> {
        match self.pose_at(t_s) {
            Some(pose) if pose.vertical_known && self.accelerometer_live(t_s) => {
                Some(-pose.orientation.inverse_transform_vector(&Vector3::z()))
            }
            _ => self.felt_down(t_s),
        }
    }

    /// Down at `t_s`, with a standard deviation, radians. If the gyro is not trusted, down is what the accelerometer feels. If it is
    /// trusted, the deviation is 0: `Estimate::heading_of_sample` adds that of a still board.
    pub fn down_and_sd(&self, t_s: f64, gyro_trusted: bool) -> Option<(Vector3<f64>, f64)> {
        if gyro_trusted {
            return Some((self.down(t_s)?, 0.0));
        }
        let readings = &self.filter.force_readings;
        let turned_rad = self.rate_rad_s().norm() * readings.held_s(t_s);
        let sd_rad = hypot(readings.down_sd_rad(), turned_rad);
        Some((self.felt_down(t_s)?, sd_rad))
    }

    /// Down by the accelerometer alone.
    fn felt_down(&self, t_s: f64) -> Option<Vector3<f64>> {
        let filter = &self.filter;
        filter.force_readings.down(t_s, &filter.errors.force_bias)
    }

    /// The accelerometer's newest reading, body axes, m/s²; `None` while it is silent.
    pub fn specific_force_m_s2(&self, t_s: f64) -> Option<Vector3<f64>> {
        self.filter.force_readings.newest(t_s)
    }

    /// Whether the accelerometer has lately been read.
    pub fn accelerometer_live(&self, t_s: f64) -> bool {
        self.filter.force_readings.live(t_s)
    }

    /// The board's state at `t_s`, as of the last tick.
    pub fn state(&self, t_s: f64) -> BoardState {
        BoardState {
            at_rest: self.filter.at_rest(),
            still: self.still(),
            gyro_bias: self.filter.errors.gyro_bias(),
            gyro_matrix: self.filter.errors.matrix,
            tilt_error: self.filter.tilt_error(),
            gyro_constant_s: self.rate_changes.constant_s(),
            force_m_s2: self.filter.force_readings.low_passed(t_s),
        }
    }

    /// See [`BoardState::still`].
    pub fn still(&self) -> bool {
        self.filter.stillness.still()
    }

    /// Rate of the last tick freed of its bias, body axes, rad/s.
    pub fn rate_rad_s(&self) -> Vector3<f64> {
        self.filter.rate_rad_s
    }

    /// The gyro's bias that is taken out of the rates, body axes, rad/s.
    pub fn gyro_bias_rad_s(&self) -> Vector3<f64> {
        self.filter.errors.gyro_bias().rad_s
    }

    /// Mean delay of the gyro's readings that their times do not show, seconds; its deviation is as large. Poses are older than their times
    /// by as much.
    pub fn unobservable_delay_s(&self) -> f64 {
        self.rate_late.unobservable_s()
    }

    /// Rotation, radians, that the gyro may have missed by `t_s`: since a jump of its rate, since its newest reading, and during its
    /// unobservable delay.
    pub fn missed_turn_rad(&self, t_s: f64) -> f64 {
        let delayed_rad = self.unobservable_delay_s() * self.rate_rad_s().norm();
        let missed_rad = hypot(self.rate_changes.missed_turn_rad(t_s), delayed_rad);
        hypot(missed_rad, self.held_turn_rad(t_s))
    }

    /// Rotation, radians, that the gyro may have missed by `t_s` since its newest reading, after which the rate is held.
    pub fn held_turn_rad(&self, t_s: f64) -> f64 {
        let held_s = self.clock.newest_s().map_or(0.0, |newest_s| t_s - newest_s);
        self.rate_changes.held_turn_rad(held_s.max(0.0))
    }

    /// Whether field and force have just jumped: gravity is being averaged to detect a turn that the gyro missed.
    pub fn may_have_jumped(&self) -> bool {
        self.seam.compares()
    }

    /// Whether the gyro's newest reading is at its full scale: the board turns faster than it reads.
    pub fn clipping(&self) -> bool {
        self.clip.clipped
    }
}

/// Lets a mean follow a value over a tick of `dt`, within the first of these times if it grows and within the second if it shrinks,
/// seconds.
fn follow(mean: &mut f64, now: f64, dt: f64, (grows_s, shrinks_s): (f64, f64)) {
    let tau_s = if now > *mean { grows_s } else { shrinks_s };
    *mean += dt / tau_s * (now - *mean);
}
