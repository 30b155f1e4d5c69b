//! Whether the accelerometer shows gravity, or how the board is shaken.
//!
//! There are two signs of shaking: the specific force is longer or shorter than gravity, or the rate of rotation changes fast. If a lever
//! swings with the angular frequency w, each radian changes the acceleration of the board at its end by w² times the lever's length, and
//! gravity in body axes by g. On an arm that swings faster than a pendulum of its length, the specific force therefore turns the opposite way,
//! though its length hardly changes.

use nalgebra::Vector3;

/// Specific force that is longer or shorter than gravity by more than this share is not gravity.
const LENGTH: f64 = 0.1;
/// If its length has been off for more than this share of the recent time, it is not gravity either: accelerations across gravity hardly
/// change its length.
const MOST_OFF: f64 = 0.2;
/// Length of the recent time, seconds.
const RECENT_S: f64 = 3.0;
/// The rate is compared with its mean over this time, seconds.
const MEAN_S: f64 = 0.1;
/// A motion is fast if the mean square of the difference exceeds this share of the rate's: (w τ)² / (1 + (w τ)²), with τ `MEAN_S` and w
/// the 3.7 rad/s of a pendulum of 0.7 m, an arm.
const FAST: f64 = 0.12;
/// A board whose mean square rate is below this, (18°/s)², is not shaken by turning: the difference is then the gyro's noise.
const TURNS2: f64 = 0.1;

/// Means of the recent motion.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Shaking {
    /// Share of the time in which the specific force was not as long as gravity.
    off: f64,
    mean_rad_s: Vector3<f64>,
    /// Mean squares of the rate, and of its difference from the mean, (rad/s)².
    rate2: f64,
    difference2: f64,
}

impl Shaking {
    /// Takes a specific force, as a share of gravity, and the rate of rotation, rad/s. Whether that force is gravity.
    pub(super) fn take(&mut self, up: &Vector3<f64>, rate: &Vector3<f64>, dt: f64) -> bool {
        let share = (dt / RECENT_S).min(1.0);
        let off = (up.norm() - 1.0).abs() > LENGTH;
        self.off += share * (f64::from(off) - self.off);
        self.mean_rad_s += dt / (MEAN_S + dt) * (rate - self.mean_rad_s);
        self.rate2 += share * (rate.norm_squared() - self.rate2);
        self.difference2 += share * ((rate - self.mean_rad_s).norm_squared() - self.difference2);
        let fast = self.rate2 > TURNS2 && self.difference2 > FAST * self.rate2;
        !off && !fast && self.off < MOST_OFF
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::GRAVITY_M_S2;

    const DT: f64 = 0.01;

    /// The share of ten seconds in which the force of a board on a lever of this length is taken for gravity. It swings by this angle
    /// about the horizontal with this angular frequency, rad/s, so slightly that the force's length hardly changes.
    fn believed(lever_m: f64, swing_rad: f64, frequency: f64) -> f64 {
        let mut shaking = Shaking::default();
        let believed = (0..1000).filter(|&step| {
            let phase = frequency * f64::from(step) * DT;
            let (angle, rate) = (swing_rad * phase.sin(), swing_rad * frequency * phase.cos());
            let along = -angle * frequency.powi(2) * lever_m / GRAVITY_M_S2;
            let across = rate.powi(2) * lever_m / GRAVITY_M_S2;
            let up = Vector3::new(angle.sin() + along, 0.0, angle.cos() + across);
            assert!((up.norm() - 1.0).abs() < LENGTH);
            shaking.take(&up, &(Vector3::y() * rate), DT)
        });
        believed.count() as f64 / 1000.0
    }

    #[test]
    fn a_slow_swing_shows_gravity_and_a_fast_one_does_not() {
        assert!(believed(0.1, 0.3, 3.0) > 0.9);
        // The specific force turns the opposite way.
        assert!(believed(0.2, 0.1, 10.0) < 0.1);
    }

    #[test]
    fn a_board_pushed_to_and_fro_does_not_show_gravity() {
        let mut shaking = Shaking::default();
        let believed = (0..1000).filter(|&step| {
            let pushed = 0.7 * (f64::from(step) * DT * 8.0).sin();
            shaking.take(&Vector3::new(pushed, 0.0, 1.0), &Vector3::zeros(), DT)
        });
        assert!(believed.count() < 200);
    }
}
