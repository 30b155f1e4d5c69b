//! How well down is known, and where it is without an accelerometer: a board is level on average.

use nalgebra::Vector3;

use crate::attitude::STILL_TILT_RAD;
use crate::frame::hypot;

/// A board is taken for level within this, radians (3°).
pub(super) const SD_RAD: f64 = 0.052;
/// The mean direction of body Z over this time is taken for vertical, seconds, and the mean square of its lean shrinks in it.
const LEVEL_S: f64 = 60.0;
/// The mean square of the lean grows in this time, seconds.
const LEANS_S: f64 = 5.0;

/// Down in body axes with its deviation, radians; a board that does not know it is taken for level.
pub(super) fn known_or_level(down: Option<(Vector3<f64>, f64)>) -> (Vector3<f64>, f64) {
    match down {
        Some((down, sd)) => (down, hypot(STILL_TILT_RAD, sd)),
        None => (Vector3::z(), SD_RAD),
    }
}

/// A field along down and across it; across it is at least 1 milligauss, by which it can be divided.
pub(super) fn split(field: &Vector3<f64>, down: &Vector3<f64>) -> (f64, f64) {
    let vertical = field.dot(down);
    (vertical, (field - down * vertical).norm().max(1.0))
}

/// Follows body Z in the gyro's frame.
#[derive(Clone, Debug, Default)]
pub(super) struct Level {
    mean: Vector3<f64>,
    /// Mean square of the angle between body Z and the mean, radians².
    leaning2: f64,
}

impl Level {
    /// Takes body Z in the frame, `period_s` after the one before; `lost` where the frame has begun anew.
    pub(super) fn take(&mut self, body_z: Vector3<f64>, lost: bool, period_s: f64) {
        if lost || self.mean == Vector3::zeros() {
            self.mean = body_z;
        }
        self.mean += (body_z - self.mean) * (period_s / (period_s + LEVEL_S));
        let leaning2 = body_z.angle(&self.mean).powi(2);
        let tau_s = if leaning2 > self.leaning2 {
            LEANS_S
        } else {
            LEVEL_S
        };
        self.leaning2 += (leaning2 - self.leaning2) * (period_s / (period_s + tau_s));
    }

    /// Down in the frame, and how far the board leans from that, radians.
    pub(super) fn down(&self) -> Option<(Vector3<f64>, f64)> {
        Some((self.mean.try_normalize(1e-6)?, self.leaning2.sqrt()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_board_that_leans_is_not_taken_for_level() {
        let leaning_after = |tilt_rad: f64| {
            let mut level = Level::default();
            for step in 0..1000 {
                let angle = tilt_rad * (0.02 * f64::from(step)).sin();
                level.take(Vector3::new(angle.sin(), 0.0, -angle.cos()), false, 0.02);
            }
            level.down().unwrap().1
        };
        assert!(leaning_after(0.02) < 0.02);
        let leaning = leaning_after(1.0);
        assert!((0.5..1.0).contains(&leaning), "{leaning}");
    }
}
