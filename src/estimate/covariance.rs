//! The large products of the filter, on its symmetric covariance. They are most of its cost. So each touches
//! only the entries that it changes, a column at a time, and computes one half of what is symmetric.

use std::ops::Range;

use nalgebra::{Matrix2x3, Matrix3, SMatrix, Vector3};

// Where each part of the state begins; its table is in `filter`.
pub(super) const H: usize = 0;
pub(super) const E: usize = 3;
pub(super) const B: usize = 5;
pub(super) const D: usize = 8;
pub(super) const M: usize = 17;
pub(super) const T: usize = 20;
pub(super) const G: usize = 21;
pub(super) const S: usize = 24;
pub(super) const Q: usize = 27;
/// Length of the state.
pub(super) const N: usize = 30;

pub(super) type Covariance = SMatrix<f64, N, N>;

/// The states whose rows of F are not the identity's: the field, the tilt error, the unevenness and the offset of the place.
const MOVING: [usize; 11] = [H, H + 1, H + 2, E, E + 1, M, M + 1, M + 2, Q, Q + 1, Q + 2];
/// The others: b and D, and T, G and S.
const LASTING: [Range<usize>; 2] = [B..M, T..Q];

/// Blocks of the transition matrix F; all others are the identity's.
pub(super) struct Transition {
    /// ∂h/∂h.
    pub(super) field: Matrix3<f64>,
    /// ∂h/∂G and ∂h/∂S.
    pub(super) by_gyro: SMatrix<f64, 3, 6>,
    /// ∂ε/∂ε.
    pub(super) tilt: f64,
    /// ∂ε/∂G.
    pub(super) tilt_by_bias: Matrix2x3<f64>,
    /// ∂m/∂m.
    pub(super) unevenness: f64,
    /// ∂q/∂q.
    pub(super) place: f64,
}

impl Transition {
    /// P ← F P Fᵀ.
    pub(super) fn propagate(&self, p: &mut Covariance) {
        // P Fᵀ first: only the columns of moving states change.
        let columns = &mut p.data.0;
        for row in 0..N {
            let before = [columns[H][row], columns[H + 1][row], columns[H + 2][row]];
            for axis in 0..3 {
                let mut sum = 0.0;
                for from in 0..3 {
                    sum += self.field[(axis, from)] * before[from];
                }
                for from in 0..6 {
                    sum += self.by_gyro[(axis, from)] * columns[G + from][row];
                }
                columns[H + axis][row] = sum;
            }
        }
        let fading = [
            (E, 2, self.tilt),
            (M, 3, self.unevenness),
            (Q, 3, self.place),
        ];
        for (at, count, kept) in fading {
            for value in columns[at..at + count].as_flattened_mut() {
                *value *= kept;
            }
        }
        let (before_g, from_g) = columns.split_at_mut(G);
        for (axis, column) in before_g[E..E + 2].iter_mut().enumerate() {
            for (from, errors) in from_g[..3].iter().enumerate() {
                let by_bias = self.tilt_by_bias[(axis, from)];
                for (value, error) in column.iter_mut().zip(errors) {
                    *value += by_bias * error;
                }
            }
        }
        // Then F from the left. F leaves the lasting states alone, so that their rows follow by symmetry.
        for moving in MOVING {
            let mut column = p.column_mut(moving);
            let errors = column.fixed_rows::<6>(G).into_owned();
            let tilt = self.tilt_by_bias * errors.fixed_rows::<3>(0);
            let field = self.field * column.fixed_rows::<3>(H) + self.by_gyro * errors;
            column.fixed_rows_mut::<3>(H).copy_from(&field);
            for (at, count, kept) in fading {
                column.rows_mut(at, count).scale_mut(kept);
            }
            let mut moved = column.fixed_rows_mut::<2>(E);
            moved += tilt;
        }
        for lasting in LASTING.into_iter().flatten() {
            for moving in MOVING {
                p[(moving, lasting)] = p[(lasting, moving)];
            }
        }
    }
}

/// J, how a sample depends on the states, without its zeros.
pub(super) struct SampleJacobian {
    /// To the field, the unevenness and the offset of the place alike.
    pub(super) field: Matrix3<f64>,
    /// To the tilt error.
    pub(super) tilt: [Vector3<f64>; 2],
    /// To the lag.
    pub(super) lag: Vector3<f64>,
    /// The predicted field in body axes: the slope by each row of D. The slope by the hard iron is 1.
    pub(super) body_field: Vector3<f64>,
}

impl SampleJacobian {
    /// P Jᵀ.
    pub(super) fn cross(&self, p: &Covariance) -> SMatrix<f64, N, 3> {
        let columns = &p.data.0;
        let mut here = [[0.0; N]; 3];
        for (from, sums) in here.iter_mut().enumerate() {
            let [h, m, q] = [H, M, Q].map(|at| &columns[at + from]);
            for (state, sum) in sums.iter_mut().enumerate() {
                *sum = h[state] + m[state] + q[state];
            }
        }
        let mut cross = SMatrix::<f64, N, 3>::zeros();
        for axis in 0..3 {
            let field: [f64; 3] = std::array::from_fn(|from| self.field[(axis, from)]);
            let tilt = [self.tilt[0][axis], self.tilt[1][axis]];
            let (lag, row_of_d) = (self.lag[axis], &columns[D + 3 * axis..D + 3 * axis + 3]);
            let sums = &mut cross.data.0[axis];
            for (state, sum) in sums.iter_mut().enumerate() {
                let mut all = columns[B + axis][state] + lag * columns[T][state];
                for from in 0..3 {
                    all += field[from] * here[from][state];
                    all += self.body_field[from] * row_of_d[from][state];
                }
                *sum = all + tilt[0] * columns[E][state] + tilt[1] * columns[E + 1][state];
            }
        }
        cross
    }

    /// J P Jᵀ, from P Jᵀ: the innovation's covariance but for the sample's noise.
    pub(super) fn innovation_covariance(&self, cross: &SMatrix<f64, N, 3>) -> Matrix3<f64> {
        let mut s: Matrix3<f64> = self.field
            * (cross.fixed_rows::<3>(H) + cross.fixed_rows::<3>(M) + cross.fixed_rows::<3>(Q))
            + cross.fixed_rows::<3>(B)
            + self.lag * cross.row(T)
            + self.tilt[0] * cross.row(E)
            + self.tilt[1] * cross.row(E + 1);
        for axis in 0..3 {
            let row = self.body_field.transpose() * cross.fixed_rows::<3>(D + 3 * axis);
            for column in 0..3 {
                s[(axis, column)] += row[column];
            }
        }
        0.5 * (s + s.transpose())
    }
}

/// P ← P − K Cᵀ for a symmetric K Cᵀ: computes the lower half and mirrors it, so that rounding cannot make P asymmetric.
pub(super) fn subtract<const K: usize>(
    p: &mut Covariance,
    gain: &SMatrix<f64, N, K>,
    cross: &SMatrix<f64, N, K>,
) {
    for (index, column) in p.data.0.iter_mut().enumerate() {
        let lower = &mut column[index..];
        let factors: [f64; K] = std::array::from_fn(|k| cross[(index, k)]);
        // As long as `lower`, so that the compiler needs no check of bounds, and vectorises the loop.
        let gains: [&[f64]; K] = std::array::from_fn(|k| &gain.data.0[k][index..][..lower.len()]);
        for (row, value) in lower.iter_mut().enumerate() {
            for k in 0..K {
                *value -= gains[k][row] * factors[k];
            }
        }
    }
    p.fill_upper_triangle_with_lower_triangle();
}

#[cfg(test)]
mod tests {
    use nalgebra::RowVector3;
    use rand::{RngExt, SeedableRng};
    use rand_xoshiro::Xoshiro256PlusPlus;

    use super::*;

    fn random<const R: usize, const C: usize>(rng: &mut Xoshiro256PlusPlus) -> SMatrix<f64, R, C> {
        SMatrix::from_fn(|_, _| rng.random_range(-1.0..1.0))
    }

    fn covariance(rng: &mut Xoshiro256PlusPlus) -> Covariance {
        let root: Covariance = random(rng);
        root * root.transpose()
    }

    #[test]
    fn a_transition_is_the_full_product() {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(1);
        let transition = Transition {
            field: random(&mut rng),
            by_gyro: random(&mut rng),
            tilt: 0.9,
            tilt_by_bias: random(&mut rng),
            unevenness: 0.7,
            place: 0.8,
        };
        let mut full = Covariance::identity();
        full.fixed_view_mut::<3, 3>(H, H)
            .copy_from(&transition.field);
        full.fixed_view_mut::<3, 6>(H, G)
            .copy_from(&transition.by_gyro);
        full.fixed_view_mut::<2, 3>(E, G)
            .copy_from(&transition.tilt_by_bias);
        for (at, count, kept) in [(E, 2, 0.9), (M, 3, 0.7), (Q, 3, 0.8)] {
            for state in at..at + count {
                full[(state, state)] = kept;
            }
        }
        let before = covariance(&mut rng);
        let mut after = before;
        transition.propagate(&mut after);
        assert!((after - full * before * full.transpose()).amax() < 1e-12);
    }

    #[test]
    fn a_correction_is_the_full_product() {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(2);
        let jacobian = SampleJacobian {
            field: random(&mut rng),
            tilt: [random(&mut rng), random(&mut rng)],
            lag: random(&mut rng),
            body_field: random(&mut rng),
        };
        let mut full = SMatrix::<f64, 3, N>::zeros();
        for at in [H, M, Q] {
            full.fixed_columns_mut::<3>(at).copy_from(&jacobian.field);
        }
        full.fixed_columns_mut::<3>(B)
            .copy_from(&Matrix3::identity());
        full.set_column(E, &jacobian.tilt[0]);
        full.set_column(E + 1, &jacobian.tilt[1]);
        full.set_column(T, &jacobian.lag);
        let row: RowVector3<f64> = jacobian.body_field.transpose();
        for axis in 0..3 {
            full.fixed_view_mut::<1, 3>(axis, D + 3 * axis)
                .copy_from(&row);
        }
        let before = covariance(&mut rng);
        let cross = jacobian.cross(&before);
        assert!((cross - before * full.transpose()).amax() < 1e-12);
        let squared = jacobian.innovation_covariance(&cross);
        assert!((squared - full * before * full.transpose()).amax() < 1e-11);

        let gain = cross * squared.try_inverse().unwrap();
        let mut after = before;
        subtract(&mut after, &gain, &cross);
        assert!((after - (before - gain * cross.transpose())).amax() < 1e-9);
        assert_eq!(after, after.transpose());
    }
}
