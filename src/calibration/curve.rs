//! The curve on which noise-free samples lie, |A⁻¹(B − b)| = Hm, for a diagonal A and a symmetric one: how far a sample is
//! from it, and how that distance and a heading change with the parameters.

use nalgebra::{SMatrix, SVector};

/// The parameters of Equation 1: D biases in milligauss, then D scale factors; with a symmetric A, in three
/// dimensions, its xy, xz and yz too. So P is 4, 6 or 9. A particle has one of the first two.
pub type ParameterVector<const P: usize> = [f64; P];

/// A sample against the curve.
#[derive(Clone, Copy, Debug)]
pub struct Distance<const P: usize> {
    /// The signed distance, outside positive, milligauss.
    pub value_mgauss: f64,
    /// Its derivatives by the parameters.
    pub derivatives: SVector<f64, P>,
    /// Noise along the curve lifts a sample off it by half of this times the variance, 1/milligauss.
    pub curvature: f64,
}

/// The off-diagonal entries of A, in the order of the parameters.
pub const PAIRS: [(usize, usize); 3] = [(0, 1), (0, 2), (1, 2)];

/// A of its parameters: the diagonal, and then, of a symmetric one, the entries of [`PAIRS`].
pub fn matrix<const D: usize>(entries: &[f64]) -> SMatrix<f64, D, D> {
    let (diagonal, others) = entries.split_at(D);
    let mut matrix = SMatrix::from_diagonal(&SVector::from_column_slice(diagonal));
    for (&entry, (row, column)) in others.iter().zip(PAIRS) {
        (matrix[(row, column)], matrix[(column, row)]) = (entry, entry);
    }
    matrix
}

/// The curve of some parameters.
///
/// The distance is e = (|h| − Hm)/|A⁻ᵀu| with h = A⁻¹(B − b), u = h/|h|: first order, along the normal n.
/// Its derivatives are taken at the foot point |h| = Hm, not at the noisy sample: there they do not
/// correlate with the noise, which would bias the scale.
pub struct Curve<const D: usize, const P: usize> {
    centre: SVector<f64, D>,
    /// A⁻¹.
    inverse: SMatrix<f64, D, D>,
    /// The sum of the squares of its entries.
    inverse_squares: f64,
    reference_mgauss: f64,
}

impl<const D: usize, const P: usize> Curve<D, P> {
    /// The curve of these parameters; `None` if A is not positive definite.
    pub fn new(position: &ParameterVector<P>, reference_mgauss: f64) -> Option<Self> {
        let (bias, entries) = position.split_at(D);
        let inverse = matrix::<D>(entries).cholesky()?.inverse();
        Some(Self {
            centre: SVector::from_column_slice(bias),
            inverse,
            inverse_squares: inverse.norm_squared(),
            reference_mgauss,
        })
    }

    /// The sample's distance.
    // Left to itself, the compiler may call it for each sample, and a fit takes up to a quarter longer.
    #[inline(always)]
    pub fn distance(&self, point: &[f64; D]) -> Distance<P> {
        let h = self.correct(point);
        let strength = h.norm();
        let u = h / strength;
        let m = self.inverse * u;
        let per_gradient = 1.0 / m.norm();
        Distance {
            value_mgauss: (strength - self.reference_mgauss) * per_gradient,
            derivatives: Self::slopes(&(m * per_gradient), &u, self.reference_mgauss),
            curvature: (self.inverse_squares - m.norm_squared()) * per_gradient
                / self.reference_mgauss,
        }
    }

    /// Equation 3.
    pub fn correct(&self, point: &[f64; D]) -> SVector<f64, D> {
        self.inverse * (SVector::from(*point) - self.centre)
    }

    /// How the azimuth of a corrected field changes with the parameters, radians: for the field's
    /// direction `u`, and `across`, the derivative of the azimuth by u.
    pub fn azimuth(&self, u: &SVector<f64, D>, across: &SVector<f64, D>) -> SVector<f64, P> {
        let m = self.inverse * across / self.reference_mgauss;
        Self::slopes(&m, u, self.reference_mgauss)
    }

    /// −mᵀ(δb + δA·u·Hm) by the parameters.
    #[inline(always)]
    fn slopes(m: &SVector<f64, D>, u: &SVector<f64, D>, reference_mgauss: f64) -> SVector<f64, P> {
        let mut slopes = SVector::zeros();
        for axis in 0..D {
            slopes[axis] = -m[axis];
            slopes[D + axis] = -reference_mgauss * m[axis] * u[axis];
        }
        for (k, (row, column)) in (2 * D..P).zip(PAIRS) {
            slopes[k] = -reference_mgauss * (m[row] * u[column] + m[column] * u[row]);
        }
        slopes
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;

    #[test]
    fn the_distance_is_the_distance_along_the_normal() {
        // A circle of radius 100·2 about (10, 20).
        let curve = Curve::<2, 4>::new(&[10.0, 20.0, 2.0, 2.0], 100.0).unwrap();
        let found: Distance<4> = curve.distance(&[10.0, 230.0]);
        assert!((found.value_mgauss - 10.0).abs() < 1e-12);
        // Moving the centre up by 1 brings the curve 1 nearer; a larger scale by Hm times as much.
        assert!((found.derivatives[1] + 1.0).abs() < 1e-12);
        assert!((found.derivatives[3] + 100.0).abs() < 1e-12);
        // On a circle the lift is σ²/(2·radius).
        assert!((found.curvature - 1.0 / 200.0).abs() < 1e-12);
    }

    #[test]
    fn the_derivatives_are_those_of_the_distance() {
        let position = [10.0, -20.0, 30.0, 0.9, 1.0, 1.1, 0.05, -0.03, 0.08];
        let matrix = matrix::<3>(&position[3..]);
        let u = Vector3::new(0.4, -0.7, 0.5).normalize();
        let point: [f64; 3] = (matrix * u * 500.0 + Vector3::new(10.0, -20.0, 30.0)).into();
        let found = Curve::<3, 9>::new(&position, 500.0)
            .unwrap()
            .distance(&point);
        for k in 0..9 {
            let step = if k < 3 { 1e-4 } else { 1e-7 };
            let value = |sign: f64| {
                let mut moved = position;
                moved[k] += sign * step;
                Curve::<3, 9>::new(&moved, 500.0)
                    .unwrap()
                    .distance(&point)
                    .value_mgauss
            };
            let slope = (value(1.0) - value(-1.0)) / (2.0 * step);
            assert!(
                (slope - found.derivatives[k]).abs() < 1e-4 * slope.abs().max(1.0),
                "{k}"
            );
        }
    }

    #[test]
    fn a_scale_of_nothing_or_less_is_no_curve() {
        assert!(Curve::<2, 4>::new(&[0.0, 0.0, 1.0, 0.0], 1.0).is_none());
        assert!(Curve::<3, 9>::new(&[0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 2.0, 0.0, 0.0], 1.0).is_none());
    }
}
