//! Detects seams: from one reading to the next the attitude jumps, as where two recordings were joined, or a source lost readings and
//! numbered their times anew.
//!
//! Field and specific force then jump together, and the gyro measures no such turn. A magnet that snaps onto the board makes both jump as
//! well, but gravity stays where it was.

use nalgebra::{UnitQuaternion, Vector3};

use super::clock::TICK_S;
use super::follow;

/// Field and force have jumped if both steps exceed the usual ones, root mean squares: each by more than `LEAST_FACTOR`, and by more than
/// `JUMP_FACTOR` in the geometric mean. The largest steps of a swinging hand are 1.4 times their root mean square, those of noise 4 times.
/// `rate_changes` has a larger factor, since it sees one sensor: here both must jump at once.
const JUMP_FACTOR: f64 = 6.0;
const LEAST_FACTOR: f64 = 3.0;
/// The usual step is averaged over this time, seconds.
const USUAL_S: f64 = 3.0;
/// Readings further apart than this are not compared, seconds.
const GAP_S: f64 = 0.2;
/// Steps that exceed the usual ones by `JUMP_FACTOR` while the sensors are quiet: of the field, milligauss (a turn by 12° at middle latitudes),
/// and of the force, m/s² (a turn by 18°).
const LEAST_MGAUSS: f64 = 100.0;
const LEAST_M_S2: f64 = 3.0;
/// Jumps of both within this time are one, seconds: the chips are read one after the other.
const TOGETHER_S: f64 = 0.05;
/// Gravity is the mean specific force over this time, seconds: it is off by 12 to 22° where a hand changes its velocity by 1 to 2 m/s.
const SEEN_S: f64 = 0.5;
/// A larger angle is a seam, radians (34°).
const ELSEWHERE_RAD: f64 = 0.6;

/// Watches the steps of a sensor's readings.
#[derive(Default)]
struct Steps {
    least: f64,
    newest: Option<(f64, Vector3<f64>)>,
    usual2: f64,
    watched_s: f64,
    jumped_s: f64,
    /// Factor by which the last jump exceeded the usual step.
    factor: f64,
}

impl Steps {
    fn new(least: f64) -> Self {
        Self {
            least,
            jumped_s: f64::NEG_INFINITY,
            ..Self::default()
        }
    }

    /// Takes a reading. Whether it may have jumped.
    fn take(&mut self, t_s: f64, reading: Vector3<f64>) -> bool {
        let Some((last_s, last)) = self.newest.replace((t_s, reading)) else {
            return false;
        };
        let period_s = t_s - last_s;
        if !(0.0..GAP_S).contains(&period_s) {
            return false;
        }
        let usual = self.usual2.sqrt().max(self.least / JUMP_FACTOR);
        let step = (reading - last).norm();
        let step2 = step.min(JUMP_FACTOR * usual).powi(2);
        follow(&mut self.usual2, step2, period_s, (USUAL_S, USUAL_S));
        self.watched_s += period_s;
        let factor = step / usual;
        let jumped = factor > LEAST_FACTOR && self.watched_s > USUAL_S;
        if jumped {
            (self.jumped_s, self.factor) = (t_s, factor);
        }
        jumped
    }
}

/// What has been felt since field and force have jumped.
struct Since {
    /// Up as it was, in the body axes of that time.
    up: Vector3<f64>,
    turned: UnitQuaternion<f64>,
    force_sum: Vector3<f64>,
    age_s: f64,
}

/// Watches field and force.
pub(super) struct SeamWatch {
    field: Steps,
    force: Steps,
    since: Option<Since>,
}

impl Default for SeamWatch {
    fn default() -> Self {
        Self {
            field: Steps::new(LEAST_MGAUSS),
            force: Steps::new(LEAST_M_S2),
            since: None,
        }
    }
}

impl SeamWatch {
    /// Takes a field, milligauss, and up as it is now, body axes.
    pub(super) fn take_field(&mut self, t_s: f64, field: Vector3<f64>, up: Vector3<f64>) {
        if self.field.take(t_s, field) {
            self.compare_after_jump(up);
        }
    }

    /// The same for a specific force, m/s².
    pub(super) fn take_force(&mut self, t_s: f64, force: Vector3<f64>, up: Vector3<f64>) {
        if self.force.take(t_s, force) {
            self.compare_after_jump(up);
        }
    }

    /// Begins to compare the mean specific force with `up` if the last jumps of field and force are one.
    fn compare_after_jump(&mut self, up: Vector3<f64>) {
        let apart_s = (self.field.jumped_s - self.force.jumped_s).abs();
        if apart_s < TOGETHER_S && self.field.factor * self.force.factor > JUMP_FACTOR.powi(2) {
            self.since = Some(Since {
                up,
                turned: UnitQuaternion::identity(),
                force_sum: Vector3::zeros(),
                age_s: 0.0,
            });
        }
    }

    /// The frame has been lost, and up with it.
    pub(super) fn stop_comparing(&mut self) {
        self.since = None;
    }

    /// Takes a tick: its rate, rad/s, and the specific force. Whether a seam has been found.
    pub(super) fn tick(&mut self, rate: &Vector3<f64>, force: Option<Vector3<f64>>) -> bool {
        let Some(since) = &mut self.since else {
            return false;
        };
        since.turned *= UnitQuaternion::from_scaled_axis(rate * TICK_S);
        since.force_sum += since.turned * force.unwrap_or_default();
        since.age_s += TICK_S;
        if since.age_s < SEEN_S {
            return false;
        }
        let elsewhere = since.force_sum.angle(&since.up) > ELSEWHERE_RAD;
        self.since = None;
        elsewhere
    }

    /// Whether it is comparing: there may have been a seam.
    pub(super) fn compares(&self) -> bool {
        self.since.is_some()
    }
}
