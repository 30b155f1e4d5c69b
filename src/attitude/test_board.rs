//! A simulated board for tests: it is told how to move and writes down what its sensors say.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

use super::GRAVITY_M_S2;
use crate::reading::Reading;

/// Earth field, X east, Y north, Z up, milligauss: a dip of 67°.
const EARTH_FIELD: Vector3<f64> = Vector3::new(0.0, 180.0, -424.0);
/// Added to the field that the magnetometer sees, milligauss.
const HARD_IRON: Vector3<f64> = Vector3::new(60.0, -100.0, 30.0);

/// A board in motion, chip axes along the body's.
pub(crate) struct TestBoard {
    pub(crate) t_s: f64,
    /// Body to earth; starts level, heading north.
    pub(crate) attitude: UnitQuaternion<f64>,
    pub(crate) gyro_bias_deg_s: Vector3<f64>,
    pub(crate) gyro: bool,
    pub(crate) accel: bool,
    /// Times between readings, taken in turn.
    pub(crate) steps_s: Vec<f64>,
    pub(crate) readings: Vec<Reading>,
    pub(crate) next: usize,
    pub(crate) random: Xoshiro256PlusPlus,
}

impl Default for TestBoard {
    fn default() -> Self {
        let level = Matrix3::new(0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, -1.0);
        Self {
            t_s: 0.0,
            attitude: UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(
                level,
            )),
            gyro_bias_deg_s: Vector3::new(0.3, -0.2, 0.4),
            gyro: true,
            accel: true,
            steps_s: vec![0.005],
            readings: Vec::new(),
            next: 0,
            random: Xoshiro256PlusPlus::seed_from_u64(1),
        }
    }
}

impl TestBoard {
    /// Moves at the body rates (rad/s) that `rate` gives for the seconds since the start of this motion.
    pub(crate) fn go(&mut self, seconds: f64, rate: impl Fn(&Self, f64) -> Vector3<f64>) {
        let start = self.t_s;
        while self.t_s - start < seconds - 1e-9 {
            let step = self.steps_s[self.next % self.steps_s.len()];
            self.next += 1;
            let step = step.min(seconds - (self.t_s - start));
            // Fine steps, so that the truth is right however far apart the readings are.
            let parts = (step / 0.002).ceil();
            for i in 0..parts as usize {
                let dt = step / parts;
                let at = self.t_s - start + (i as f64 + 0.5) * dt;
                self.attitude *= UnitQuaternion::from_scaled_axis(rate(self, at) * dt);
            }
            self.t_s += step;
            let now = rate(self, self.t_s - start);
            self.read(now);
        }
    }

    fn read(&mut self, rate: Vector3<f64>) {
        let field = self.attitude.inverse() * EARTH_FIELD + HARD_IRON + self.noise(2.0);
        let force = self.attitude.inverse() * Vector3::z() * GRAVITY_M_S2 + self.noise(0.03);
        let bias = self.gyro_bias_deg_s.map(f64::to_radians);
        let rate = rate + bias + self.noise(0.002);
        self.readings.push(Reading {
            t_s: self.t_s,
            field_mgauss: Some(field.map(Some).into()),
            rate_rad_s: self.gyro.then_some(rate),
            specific_force_m_s2: self.accel.then_some(force),
        });
    }

    /// Even noise of this amplitude, the same in every run.
    fn noise(&mut self, amplitude: f64) -> Vector3<f64> {
        Vector3::from_fn(|_, _| self.random.random_range(-amplitude..amplitude))
    }

    pub(crate) fn rest(&mut self, seconds: f64) {
        self.go(seconds, |_, _| Vector3::zeros());
    }

    /// Turns about a body axis at an even rate.
    pub(crate) fn turn(&mut self, axis: Vector3<f64>, degrees: f64, deg_s: f64) {
        let rate = axis.normalize() * (degrees.signum() * deg_s).to_radians();
        self.go(degrees.abs() / deg_s, |_, _| rate);
    }

    /// Turns about the vertical, counter-clockwise from above, at an even rate.
    pub(crate) fn turn_up(&mut self, degrees: f64, deg_s: f64) {
        let rate = (degrees.signum() * deg_s).to_radians();
        self.go(degrees.abs() / deg_s, |board, _| {
            board.attitude.inverse() * Vector3::z() * rate
        });
    }
}
