//! Recent change of the field that the gyro does not explain. Until its cause is known, a heading may be off by as much.

use std::f64::consts::PI;

use nalgebra::{Matrix3, Vector3};

use super::witness::VectorChange;

/// A difference between the change seen and the change predicted is explained below this: unevenness (1.5 %) and noise (as much),
/// each at both ends. Jitter of the sample times, seconds, adds its share of the rate.
const EXPLAINED: f64 = 0.06;
const SCATTER_S: f64 = 0.005;
/// A difference up to this share of the change is explained too: a drone's throttle changes the field during a turn.
const MOSTLY: f64 = 0.6;
/// Doubt about the gyro fades by 1/e over this much explained change: two moments.
const FADES: f64 = 0.3;

/// Unexplained change in recent moments, and in the current one.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Unexplained {
    recent: Doubt,
    current: Doubt,
}

/// Unexplained change, as a share of the field.
#[derive(Clone, Copy, Debug, Default)]
struct Doubt {
    /// While the gyro hardly turned: the vector sum in the frame. A change that reverses leaves no doubt: a passing car, or a turn and its
    /// return under a dead gyro.
    alone: Vector3<f64>,
    /// While the gyro turned another way: the sum of the lengths. The changes themselves go round and round, and their sum
    /// is small again and again.
    otherwise: f64,
}

impl Unexplained {
    /// Takes a change of the field on a board that turns at this rate, rad/s, and lies like this, body to frame.
    pub(super) fn take(&mut self, change: &VectorChange, rate_rad_s: f64, to_frame: &Matrix3<f64>) {
        let missed = change.seen - change.predicted;
        let expected = EXPLAINED + rate_rad_s * SCATTER_S;
        let unexplained = missed.norm() > expected.max(MOSTLY * change.larger);
        self.current = Doubt::default();
        if unexplained && !change.is_jump() {
            let beyond = missed * (1.0 - expected / missed.norm());
            if change.is_alone() {
                self.current.alone = to_frame * beyond;
            } else {
                self.current.otherwise = beyond.norm();
            }
            if change.ended {
                self.recent.add(&std::mem::take(&mut self.current));
            }
        } else if change.counts() {
            let keep = (-change.larger / FADES).exp();
            self.recent.alone *= keep;
            self.recent.otherwise *= keep;
        }
    }

    /// The current moment is lost.
    pub(super) fn lose_moment(&mut self) {
        self.current = Doubt::default();
    }

    /// How much of the field is unexplained, as a share of it.
    pub(super) fn share(&self) -> f64 {
        let mut all = self.recent;
        all.add(&self.current);
        all.alone.norm() + all.otherwise
    }
}

impl Doubt {
    /// Bounded, so that it fades in time: a heading is off by half a turn at most.
    fn add(&mut self, other: &Self) {
        self.alone = (self.alone + other.alone).cap_magnitude(PI);
        self.otherwise = (self.otherwise + other.otherwise).min(PI);
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Rotation3;

    use super::*;

    /// A moment in which the board sees the first of these changes, and the gyro predicts the other.
    fn moment(seen: Vector3<f64>, predicted: Vector3<f64>) -> VectorChange {
        VectorChange {
            seen,
            predicted,
            larger: seen.norm().max(predicted.norm()),
            ended: true,
        }
    }

    const QUARTER: f64 = 0.25;

    #[test]
    fn a_car_that_has_passed_leaves_no_doubt() {
        let mut field = Unexplained::default();
        let to_frame = Rotation3::new(Vector3::z()).into_inner();
        field.take(
            &moment(Vector3::x() * QUARTER, Vector3::zeros()),
            0.0,
            &to_frame,
        );
        assert_eq!(field.share(), QUARTER - EXPLAINED);
        // The road has turned by 60° meanwhile.
        let turned = Rotation3::new(Vector3::z() * 1.05);
        let back = turned.inverse() * Vector3::x() * -QUARTER;
        field.take(&moment(back, Vector3::zeros()), 0.0, &(to_frame * turned));
        assert!(field.share() < 1e-9, "{}", field.share());
    }

    #[test]
    fn a_gyro_that_turns_the_other_way_and_back_leaves_all_its_doubt() {
        let mut field = Unexplained::default();
        for way in [QUARTER, -QUARTER] {
            let seen = Vector3::x() * way;
            field.take(&moment(seen, -seen), 0.0, &Matrix3::identity());
        }
        assert_eq!(field.share(), 2.0 * (2.0 * QUARTER - EXPLAINED));
        // A turn that the gyro explains takes it away.
        let seen = Vector3::x() * 0.5;
        for _ in 0..3 {
            field.take(&moment(seen, seen), 0.0, &Matrix3::identity());
        }
        assert!(field.share() < 0.01, "{}", field.share());
    }
}
