//! Axes, and the small rotation beside them, of one vector sensor.
//!
//! A vector that stands still in the world, seen in gyro axes, turns against the gyro: with M from chip to gyro axes and an
//! offset c = M b, the vector v = M y − c of one instant, carried along by the gyro, is that of a later one. That is linear in
//! M and c, so that one pass over a log gives normal equations in which each candidate for M costs nothing.
//!
//! Where it holds for M it holds for −M, so a motion does not tell whether a chip's axes are right-handed: that is assumed.
//! Only a gyro that is mirrored shows itself, since then nothing turns as it reads.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use super::carried::{KnotPair, SensedKnot};
use crate::frame::{put, rows, signed_axes};

/// Deviation of M from three signed axes, entry by entry: 6° of rotation, 10 % of scale and soft iron.
const ENTRY: f64 = 0.1;
/// Bias to expect of a gyro, rad/s (6° a second).
const BIAS_RAD_S: f64 = 0.1;
/// Lag to expect of a sensor behind the gyro, seconds.
const LAG_S: f64 = 0.02;
/// What is left of a vector where all is right, as a share of it: fields are uneven by 1 to 2 %, and hands shake.
const EXPECTED: f64 = 0.03;
const LEAST: f64 = 1e-4;
/// Least squares are weighted anew so often.
const ROUNDS: usize = 4;
/// A pair whose residual is so many times the median is left out: a disturbance, or a gyro at the end of its range.
const OUTLIER: f64 = 4.0;
/// Factor on standard deviations: the pairs are not independent, since fields are uneven and gyros have scale errors.
const DOUBT: f64 = 1.5;

/// M's entries beside its axes (9), c (3), the gyro's bias (3) and the lag (1).
const UNKNOWN: usize = 16;
const C: usize = 9;
const G: usize = 12;
const T: usize = 15;

/// What is known of one sensor.
pub(super) struct SensorData {
    pub(super) seen: Vec<SensedKnot>,
    pub(super) pairs: Vec<KnotPair>,
    /// Standard deviation of the offset to expect, in the sensor's unit.
    pub(super) offset_sd: f64,
}

/// All rotations that take each axis to one, or its opposite.
pub(super) fn axes() -> Vec<Matrix3<f64>> {
    let row = |(column, sign)| Vector3::ith(column, sign).transpose();
    let matrices = signed_axes().map(|rows| Matrix3::from_rows(&rows.map(row)));
    matrices
        .filter(|matrix| matrix.determinant() > 0.0)
        .collect()
}

/// How well these axes explain the pairs, with the best small rotation, scale, offset, gyro bias and lag beside them: what is
/// left of the vector, as a share of it.
pub(super) fn cost(data: &SensorData, axes: &Matrix3<f64>) -> f64 {
    let rows = PairEquations::all(data, axes, axes, &Vector3::zeros());
    // However much evidence there is, it must not turn these axes into others.
    let sd = EXPECTED * size(data) * (rows.len() as f64).sqrt();
    let Some(solution) = Solution::of(data, axes, sd, rows.iter()) else {
        return f64::INFINITY;
    };
    let (matrix, offset) = (solution.matrix(axes), solution.offset());
    let vectors = data.seen.iter().map(|(_, mean)| mean.at(&matrix, &offset));
    let square = mean(vectors.map(|vector| vector.norm_squared()));
    (solution.left.max(0.0) / rows.len().max(1) as f64 / square).sqrt()
}

/// A sensor's axes in the gyro's, and what is beside them.
pub(super) struct FoundAxes {
    /// Three signed axes.
    pub(super) axes: Matrix3<f64>,
    /// Chip to gyro axes: three signed axes with the small rotation.
    pub(super) rotation: Matrix3<f64>,
    /// That small rotation, gyro axes, radians, and its standard deviation.
    pub(super) turn_rad: Vector3<f64>,
    pub(super) turn_sd_rad: Vector3<f64>,
    /// With scale and soft iron in it, and the offset.
    pub(super) matrix: Matrix3<f64>,
    pub(super) offset: Vector3<f64>,
    /// What was left of the gyro's bias, rad/s.
    pub(super) bias_rad_s: Vector3<f64>,
}

impl FoundAxes {
    /// These axes, with nothing beside them yet.
    pub(super) fn new(axes: Matrix3<f64>) -> Self {
        Self {
            axes,
            rotation: axes,
            turn_rad: Vector3::zeros(),
            turn_sd_rad: Vector3::zeros(),
            matrix: axes,
            offset: Vector3::zeros(),
            bias_rad_s: Vector3::zeros(),
        }
    }
}

/// The small rotation beside the axes, by least squares, from what was found before.
pub(super) fn refine(data: &SensorData, found: &FoundAxes) -> Option<FoundAxes> {
    let (axes, mut matrix, mut offset) = (&found.axes, found.matrix, found.offset);
    let mut sd = EXPECTED * size(data);
    let mut kept: Option<(Solution, f64)> = None;
    for _ in 0..ROUNDS {
        let rows = PairEquations::all(data, axes, &matrix, &offset);
        let near = |row: &&PairEquations| match &kept {
            Some((solution, limit)) => row.left(&solution.found) <= *limit,
            None => true,
        };
        let solution = Solution::of(data, axes, sd, rows.iter().filter(near))?;
        (matrix, offset) = (solution.matrix(axes), solution.offset());
        let mut left: Vec<f64> = rows.iter().map(|row| row.left(&solution.found)).collect();
        left.sort_by(f64::total_cmp);
        let median = *left.get(left.len() / 2)?;
        // The median length of three components is 1.54 deviations of one.
        sd = (median / 1.54).max(LEAST * size(data));
        kept = Some((solution, OUTLIER * median));
    }
    let (solution, _) = kept?;
    let svd = matrix.svd(true, true);
    let rotation = svd.u? * svd.v_t?;
    let turn = |m: &Matrix3<f64>| {
        0.5 * Vector3::new(
            m[(2, 1)] - m[(1, 2)],
            m[(0, 2)] - m[(2, 0)],
            m[(1, 0)] - m[(0, 1)],
        )
    };
    // How each of M's entries turns it: M times the axes' inverse is near the identity.
    let mut by_entries = SMatrix::<f64, 3, 9>::zeros();
    for entry in 0..9 {
        let mut one = Matrix3::zeros();
        one[(entry / 3, entry % 3)] = 1.0;
        by_entries.set_column(entry, &turn(&(one * axes.transpose())));
    }
    let own = solution.inverse.fixed_view::<9, 9>(0, 0) * (sd * DOUBT).powi(2);
    let variance = (by_entries * own * by_entries.transpose()).diagonal();
    Some(FoundAxes {
        axes: *axes,
        rotation,
        turn_rad: turn(&(rotation * axes.transpose())),
        turn_sd_rad: variance.map(|v| v.max(0.0).sqrt()),
        matrix,
        offset,
        bias_rad_s: solution.found.fixed_rows::<3>(G).into(),
    })
}

/// What the second knot's vector differs by from the first's, carried there: `by · unknown − told`.
struct PairEquations {
    by: SMatrix<f64, 3, UNKNOWN>,
    told: Vector3<f64>,
}

impl PairEquations {
    /// The equations of all pairs, linearised at this matrix and offset. M is the axes plus the unknown entries.
    fn all(
        data: &SensorData,
        axes: &Matrix3<f64>,
        matrix: &Matrix3<f64>,
        offset: &Vector3<f64>,
    ) -> Vec<Self> {
        let of = |pair: &KnotPair| {
            let ((from, first), (to, second)) = (&data.seen[pair.first], &data.seen[pair.second]);
            let (vector, later) = (first.at(matrix, offset), second.at(matrix, offset));
            let carried = pair.carry * vector;
            let by_matrix = second.by_matrix - pair.carry * first.by_matrix;
            // A vector that stands still in the world turns against the board.
            let by_lag = pair.carry * from.rate_rad_s.cross(&vector) - to.rate_rad_s.cross(&later);
            let mut by = SMatrix::<f64, 3, UNKNOWN>::zeros();
            let by_offset = pair.carry * first.by_offset - second.by_offset;
            put(&mut by, (0, 0), &by_matrix);
            put(&mut by, (0, C), &by_offset);
            put(&mut by, (0, G), &(carried.cross_matrix() * pair.by_bias));
            put(&mut by, (0, T), &by_lag);
            Self {
                by,
                told: -by_matrix * rows(axes),
            }
        };
        data.pairs.iter().map(of).collect()
    }

    fn left(&self, found: &SVector<f64, UNKNOWN>) -> f64 {
        (self.by * found - self.told).norm()
    }
}

/// The least-squares solution, with a prior for each unknown.
struct Solution {
    found: SVector<f64, UNKNOWN>,
    inverse: SMatrix<f64, UNKNOWN, UNKNOWN>,
    /// The sum of squares that is left.
    left: f64,
}

impl Solution {
    fn of<'a>(
        data: &SensorData,
        axes: &Matrix3<f64>,
        sd: f64,
        all: impl Iterator<Item = &'a PairEquations>,
    ) -> Option<Self> {
        let mut normal = SMatrix::<f64, UNKNOWN, UNKNOWN>::zeros();
        let mut right = SVector::<f64, UNKNOWN>::zeros();
        let mut square = 0.0;
        for row in all {
            normal += row.by.transpose() * row.by;
            right += row.by.transpose() * row.told;
            square += row.told.norm_squared();
        }
        // Only directions can be compared: the scale as a whole is held.
        let scale = rows(axes);
        let held = scale * scale.transpose() * (1e6 * normal.diagonal().max());
        let mut entries = normal.fixed_view_mut::<9, 9>(0, 0);
        entries += held;
        for index in 0..UNKNOWN {
            let expected = match index {
                0..C => ENTRY,
                C..G => data.offset_sd,
                G..T => BIAS_RAD_S,
                _ => LAG_S,
            };
            normal[(index, index)] += (sd / expected).powi(2);
        }
        let inverse = normal.cholesky()?.inverse();
        let found = inverse * right;
        Some(Self {
            left: square - found.dot(&right),
            found,
            inverse,
        })
    }

    fn matrix(&self, axes: &Matrix3<f64>) -> Matrix3<f64> {
        axes + Matrix3::from_row_iterator(self.found.iter().copied().take(9))
    }

    fn offset(&self) -> Vector3<f64> {
        self.found.fixed_rows::<3>(C).into()
    }
}

/// How long the vector is, about, with its offset in it.
fn size(data: &SensorData) -> f64 {
    let (matrix, offset) = (Matrix3::identity(), Vector3::zeros());
    let vectors = data.seen.iter().map(|(_, mean)| mean.at(&matrix, &offset));
    mean(vectors.map(|vector| vector.norm()))
}

fn mean(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len().max(1) as f64;
    values.sum::<f64>() / count
}
