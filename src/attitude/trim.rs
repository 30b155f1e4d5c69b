//! Trim: the attitude that a vehicle keeps.
//!
//! A car leans by a degree or two on its springs and on its roads, while its acceleration tilts what an accelerometer feels by ten
//! degrees, for seconds. So while accelerometer and gyro disagree, the measured force is blended with the direction that is up on
//! average, in body axes; the weights follow from the variances of both. A board that tumbles has no trim, and for one that is not
//! accelerated the accelerometer counts alone.

use nalgebra::{Matrix3, UnitQuaternion, Vector3};

use super::clock::TICK_S;
use super::follow;
use super::force_readings::GRAVITY_M_S2;

/// The trim is learnt from the specific force averaged over this time, seconds: jolts are shorter.
const FELT_S: f64 = 5.0;
/// The trim may change by one deviation of the swings in this time, seconds: the next road, another load.
const LASTS_S: f64 = 100.0;
/// Deviation of the trim at first, radians (2°): the tilt's own while a board is accelerated a little.
const FIRST_RAD: f64 = 0.035;
/// The gyro shows swings for this long, seconds: a bias of 0.02°/s then adds 0.4°.
const SWING_S: f64 = 20.0;
/// Their mean square grows and shrinks within these times, seconds.
const SWING_MEAN_S: (f64, f64) = (1.0, 30.0);
/// A board that swings by this much, radians (8°), has no trim: cars roll and pitch by less, boats and hands by more.
const NO_TRIM_RAD: f64 = 0.14;
/// A low-pass over this time separates acceleration from vibration, seconds.
const ACCELERATED_S: f64 = 1.0;
/// The acceleration's mean square grows and shrinks within these times, seconds: a driver brakes and turns for seconds.
const ACCELERATION_MEAN_S: (f64, f64) = (0.5, 3.0);
/// A force in one direction that lasts longer than this, seconds, is heel, not acceleration: a car reaches 80 km/h in 20 s.
const HEEL_S: f64 = 30.0;
/// Variance of what is felt at least, rad²: an accelerometer's noise.
const LEAST2: f64 = 1e-6;

/// Learns the attitude that the board keeps. All vectors are shares of gravity.
pub(super) struct Trim {
    /// Mean up in body axes, a unit vector, and its variance, rad².
    up: Vector3<f64>,
    variance: f64,
    /// Specific force over `FELT_S`, in the frame.
    felt: Vector3<f64>,
    /// Up as the gyro carries it in body axes, drawn to `up` over `SWING_S`, and the variance of its swings on an axis, rad².
    carried: Vector3<f64>,
    swing2: f64,
    /// Specific force less up as the gyro carries it, in the frame, over `ACCELERATED_S` and over `HEEL_S`; and the mean square
    /// of their difference on an axis.
    acceleration: Vector3<f64>,
    heel: Vector3<f64>,
    acceleration2: f64,
    /// Deviation of the tilt that the trim adds, radians.
    pub(super) tilt_sd_rad: f64,
}

impl Trim {
    /// The trim of a board whose up is this in body axes.
    pub(super) fn new(up: Vector3<f64>) -> Self {
        Self {
            up,
            variance: FIRST_RAD.powi(2),
            felt: Vector3::z(),
            carried: up,
            swing2: NO_TRIM_RAD.powi(2),
            acceleration: Vector3::zeros(),
            heel: Vector3::zeros(),
            acceleration2: 0.0,
            tilt_sd_rad: 0.0,
        }
    }

    /// Takes the rate of a tick, rad/s.
    pub(super) fn turn(&mut self, rate: &Vector3<f64>) {
        // A vector that stands still in the world turns against the board.
        let turn = UnitQuaternion::from_scaled_axis(rate * TICK_S);
        self.carried = turn.inverse_transform_vector(&self.carried);
        self.carried += (self.up - self.carried) * (TICK_S / SWING_S);
        let swing2 = 0.5 * (self.carried - self.up).norm_squared();
        follow(&mut self.swing2, swing2, TICK_S, SWING_MEAN_S);
    }

    /// Takes the tick's specific force, m/s², and the rotation into the levelled frame. Returns the force that the board would most
    /// likely feel without acceleration, m/s².
    pub(super) fn levelled(
        &mut self,
        to_frame: &Matrix3<f64>,
        force: &Vector3<f64>,
        at_rest: bool,
    ) -> Vector3<f64> {
        let felt = to_frame * force / GRAVITY_M_S2;
        self.feel(to_frame, &felt, at_rest);
        let kept2 = self.swing2 + self.variance;
        let share = self.acceleration2 / (self.acceleration2 + kept2 + LEAST2)
            * (1.0 - kept2 / NO_TRIM_RAD.powi(2)).max(0.0);
        self.tilt_sd_rad = share * kept2.sqrt();
        force * (1.0 - share) + self.up * (GRAVITY_M_S2 * share)
    }

    fn feel(&mut self, to_frame: &Matrix3<f64>, felt: &Vector3<f64>, at_rest: bool) {
        if at_rest {
            // Whatever the board feels is gravity.
            self.carried = to_frame.transpose() * felt;
            self.acceleration.fill(0.0);
            self.heel.fill(0.0);
            self.acceleration2 = 0.0;
        }
        let residual = felt - to_frame * self.carried;
        self.acceleration += (residual - self.acceleration) * (TICK_S / ACCELERATED_S);
        self.heel += (residual - self.heel) * (TICK_S / HEEL_S);
        let acceleration2 = 0.5 * (self.acceleration - self.heel).xy().norm_squared();
        follow(
            &mut self.acceleration2,
            acceleration2,
            TICK_S,
            ACCELERATION_MEAN_S,
        );

        self.felt += (felt - self.felt) * (TICK_S / FELT_S);
        self.variance += TICK_S / LASTS_S * self.swing2;
        // Neighbouring ticks share what is felt.
        let noise = (self.acceleration2 + self.swing2 + LEAST2) * 2.0 * FELT_S / TICK_S;
        let gain = self.variance / (self.variance + noise);
        if let Some(up) = (to_frame.transpose() * self.felt).try_normalize(0.1) {
            self.up = (self.up + (up - self.up) * gain).normalize();
            self.variance -= gain * self.variance;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A board in motion, with its true attitude as the frame's.
    struct Ride {
        trim: Trim,
        t_s: f64,
        attitude: UnitQuaternion<f64>,
    }

    impl Ride {
        fn new(roll_deg: f64) -> Self {
            let attitude = UnitQuaternion::from_euler_angles(roll_deg.to_radians(), 0.0, 0.0);
            Self {
                trim: Trim::new(attitude.inverse_transform_vector(&Vector3::z())),
                t_s: 0.0,
                attitude,
            }
        }

        /// Turns and accelerates for so long. Returns the angle between the levelled force and gravity at the end, degrees.
        fn go(
            &mut self,
            seconds: f64,
            rate: impl Fn(f64) -> Vector3<f64>,
            acceleration: Vector3<f64>,
        ) -> f64 {
            let mut off_deg = 0.0;
            for _ in 0..(seconds / TICK_S) as u32 {
                self.t_s += TICK_S;
                let rate = rate(self.t_s);
                self.attitude *= UnitQuaternion::from_scaled_axis(rate * TICK_S);
                let gravity = self
                    .attitude
                    .inverse_transform_vector(&(Vector3::z() * GRAVITY_M_S2));
                let force = gravity + self.attitude.inverse_transform_vector(&acceleration);
                let to_frame = self.attitude.to_rotation_matrix().into_inner();
                let at_rest = rate == Vector3::zeros();
                self.trim.turn(&rate);
                let levelled = self.trim.levelled(&to_frame, &force, at_rest);
                off_deg = levelled.angle(&gravity).to_degrees();
            }
            off_deg
        }

        /// Drives on for five minutes, and brakes. Returns that angle, degrees.
        fn brakes(&mut self) -> f64 {
            self.go(300.0, springs, Vector3::zeros());
            self.go(3.0, springs, BRAKING)
        }
    }

    /// Two degrees to and fro on its springs.
    fn springs(t_s: f64) -> Vector3<f64> {
        Vector3::x() * (0.035 * 4.0 * (4.0 * t_s).cos())
    }

    /// 3 m/s² are 17°.
    const BRAKING: Vector3<f64> = Vector3::new(-3.0, 0.0, 0.0);

    #[test]
    fn a_car_that_brakes_keeps_its_trim() {
        let mut car = Ride::new(7.0);
        let off_deg = car.brakes();
        assert!(off_deg < 3.0, "{off_deg}");
        assert!(car.trim.tilt_sd_rad.to_degrees() > 0.3);
    }

    #[test]
    fn a_tumbling_board_has_no_trim() {
        let mut hand = Ride::new(0.0);
        let tumbling = |t_s: f64| Vector3::new((0.9 * t_s).sin(), (1.3 * t_s).sin(), 0.5);
        let felt = BRAKING.norm().atan2(GRAVITY_M_S2).to_degrees();
        hand.go(60.0, tumbling, Vector3::zeros());
        let off_deg = hand.go(3.0, tumbling, BRAKING);
        assert!((off_deg - felt).abs() < 0.01, "{off_deg}");
        assert_eq!(hand.trim.tilt_sd_rad, 0.0);
    }

    /// Mounted anew, 5° further over, on the road.
    #[test]
    fn another_trim_is_learnt() {
        let mut car = Ride::new(7.0);
        car.go(300.0, springs, Vector3::zeros());
        car.go(1.0, |_| Vector3::y() * 0.087, Vector3::zeros());
        let off_deg = car.brakes();
        assert!(off_deg < 3.0, "{off_deg}");
    }

    /// In smooth water, by 15° in ten minutes.
    #[test]
    fn a_boat_that_heels_over_slowly_is_not_accelerated() {
        let mut boat = Ride::new(0.0);
        boat.go(60.0, |_| Vector3::zeros(), Vector3::zeros());
        let heeling = |t_s: f64| Vector3::x() * (0.26 / 600.0) + springs(t_s) * 0.1;
        let off_deg = boat.go(600.0, heeling, Vector3::zeros());
        assert!(off_deg < 1.0, "{off_deg}");
    }

    #[test]
    fn a_board_that_was_spun_has_a_trim_again() {
        let mut car = Ride::new(7.0);
        car.go(60.0, |_| Vector3::new(6.0, 6.0, 6.0), Vector3::zeros());
        let off_deg = car.brakes();
        assert!(off_deg < 3.0, "{off_deg}");
    }

    /// The accelerometer's readings are missing while the car turns.
    #[test]
    fn a_turn_without_force_is_no_acceleration() {
        let mut car = Ride::new(7.0);
        car.go(300.0, springs, Vector3::zeros());
        let turn = Vector3::x() * 0.5;
        for _ in 0..20 {
            car.attitude *= UnitQuaternion::from_scaled_axis(turn * TICK_S);
            car.trim.turn(&turn);
        }
        let off_deg = car.go(1.0, |_| Vector3::zeros(), Vector3::zeros());
        assert!(off_deg < 0.5, "{off_deg}");
    }

    /// Laid down in another way, by 5°, and not accelerated.
    #[test]
    fn a_board_at_rest_feels_gravity() {
        let mut board = Ride::new(0.0);
        board.go(300.0, |_| Vector3::zeros(), Vector3::zeros());
        board.go(1.0, |_| Vector3::x() * 0.087, Vector3::zeros());
        let off_deg = board.go(30.0, |_| Vector3::zeros(), Vector3::zeros());
        assert!(off_deg < 0.3, "{off_deg}");
    }
}
