//! Whether the mountings of gyro and accelerometer agree, by gravity.
//!
//! Gravity stands still in the world, so it turns against the board. Over a moment the specific force f, as a share of gravity,
//! changes by the integral of f × P ω, where ω is what the gyro reads. P is 1 if the axes of both chips are configured correctly, and one of
//! 47 other matrices where axes are exchanged or signs are wrong. Sums over moments give the squares of the change that each P leaves.
//! Accelerations of a hand change f too, but no P explains those.

use nalgebra::{SMatrix, SVector, Vector3};

use super::GyroVerdict;
use crate::frame::signed_axes;

/// How many moments are remembered, most of them of 9°.
const MEMORY: f64 = 30.0;
/// Fewer moments give no verdict: by chance, accelerations fit one of the 48 orders and signs.
const LEAST_MOMENTS: f64 = 12.0;
/// The configured axes are right if their residual is below this share of the best other's, and wrong if the best other's is below this
/// share of theirs and of their opposite's. In a million simulated moments, most of them handheld, wrong axes never left less than 1/3.6 of
/// what the right ones left.
const TELLS: f64 = 0.25;
/// Axes are believed only if they leave less than this share of the squared change. A drone's force stays upright: wrong axes that predict
/// little fit it best.
const MOST_RESIDUAL: f64 = 0.8;

/// Compares how gravity turns with what each order and signs of the gyro's axes predict.
#[derive(Clone, Debug, Default)]
pub(super) struct GyroAxes {
    /// f when the moment began.
    start: Vector3<f64>,
    /// The change since then that each entry of P predicts: one column for each, P column by column.
    predicted: SMatrix<f64, 3, 9>,
    /// Sums over moments, of shares of the larger change: of 1, of the squared change, of its products with the columns, and of those with each other.
    moments: f64,
    squares: f64,
    seen: SVector<f64, 9>,
    information: SMatrix<f64, 9, 9>,
    /// What the moments have said last: `Wrong` if gravity turns as if the gyro's axes, or the accelerometer's, had other names or signs.
    pub(super) verdict: GyroVerdict,
}

impl GyroAxes {
    /// Begins a moment.
    pub(super) fn begin(&mut self, force: Vector3<f64>) {
        self.start = force;
        self.predicted.fill(0.0);
    }

    /// The board has turned by what the gyro reads.
    pub(super) fn turn(&mut self, force: &Vector3<f64>, turned_rad: &Vector3<f64>) {
        let cross = force.cross_matrix();
        for axis in 0..3 {
            let mut columns = self.predicted.fixed_columns_mut::<3>(3 * axis);
            columns += cross * turned_rad[axis];
        }
    }

    /// Ends a moment, with the change of f, seen or predicted, whichever is larger. All moments count the same: a few large accelerations
    /// must not count for most.
    pub(super) fn end(&mut self, force: Vector3<f64>, larger: f64) {
        let change = (force - self.start) / larger;
        let predicted = self.predicted / larger;
        let keep = 1.0 - 1.0 / MEMORY;
        self.moments = self.moments * keep + 1.0;
        self.squares = self.squares * keep + change.norm_squared();
        self.seen = self.seen * keep + predicted.tr_mul(&change);
        self.information = self.information * keep + predicted.tr_mul(&predicted);
        if self.moments > LEAST_MOMENTS {
            self.judge();
        }
    }

    fn judge(&mut self) {
        let same = |sign| [0, 1, 2].map(|axis| (axis, sign));
        let own = self.residual(&same(1.0));
        // All signs are wrong: gravity shows this on an arm that swings faster than a pendulum of its length.
        let opposite = self.residual(&same(-1.0));
        let others = signed_axes()
            .skip(1)
            .map(|axes| self.residual(&axes))
            .fold(f64::MAX, f64::min);
        let most = MOST_RESIDUAL * self.squares;
        if own < most && own < TELLS * others {
            self.verdict = GyroVerdict::Right;
        } else if others < most && others < TELLS * own.min(opposite) {
            self.verdict = GyroVerdict::Wrong;
        }
    }

    /// The squares of the change that are left if P has these axes, as [`signed_axes`] gives them.
    fn residual(&self, axes: &[(usize, f64); 3]) -> f64 {
        let entries = [0, 1, 2].map(|row| (3 * axes[row].0 + row, axes[row].1));
        let mut residual = self.squares;
        for (row, of_row) in entries {
            residual -= 2.0 * of_row * self.seen[row];
            for (column, of_column) in entries {
                residual += of_row * of_column * self.information[(row, column)];
            }
        }
        residual
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, Rotation3};

    use super::*;

    /// What gravity says of a gyro whose readings are those of a right one times a matrix. The board tumbles, and a hand moves it with
    /// accelerations of this share of gravity.
    fn judged(gyro: Matrix3<f64>, accelerations: f64) -> GyroVerdict {
        let mut axes = GyroAxes::default();
        axes.begin(Vector3::z());
        let mut attitude = Rotation3::identity();
        let dt = 0.02;
        for step in 0..1000 {
            let t_s = f64::from(step) * dt;
            let rate = Vector3::new((0.7 * t_s).sin(), (0.45 * t_s).cos(), 0.5);
            attitude *= Rotation3::new(rate * dt);
            let hand = Vector3::new((5.0 * t_s).sin(), (7.0 * t_s).cos(), (6.0 * t_s).sin());
            let force = attitude.inverse() * (Vector3::z() + hand * accelerations);
            if step % 10 == 0 {
                axes.end(force, 0.2);
                axes.begin(force);
            } else {
                axes.turn(&force, &(gyro * rate * dt));
            }
        }
        axes.verdict
    }

    #[test]
    fn gravity_tells_right_axes_from_wrong_ones() {
        let exchanged = Matrix3::new(0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, -1.0);
        let mounted_upside_down = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0));
        for accelerations in [0.0, 0.05] {
            assert_eq!(
                judged(Matrix3::identity(), accelerations),
                GyroVerdict::Right
            );
            for wrong in [exchanged, mounted_upside_down] {
                assert_eq!(judged(wrong, accelerations), GyroVerdict::Wrong, "{wrong}");
            }
        }
        assert_eq!(judged(Matrix3::identity(), 2.0), GyroVerdict::Unknown);
        assert_eq!(judged(-Matrix3::identity(), 0.0), GyroVerdict::Unknown);
    }
}
