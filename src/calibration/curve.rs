//! The curve on which noise-free samples lie, |A⁻¹(B − b)| = Hm, for both shapes of A: how far a sample is
//! from it, and how that distance and a heading change with the parameters.

use nalgebra::{Matrix3, SVector, Vector3};

use crate::frame::put;

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

/// A shape of A, at given parameters.
///
/// The distance is e = (|h| − Hm)/|A⁻ᵀu| with h = A⁻¹(B − b), u = h/|h|: first order, along the normal n.
/// Its derivatives are taken at the foot point |h| = Hm, not at the noisy sample: there they do not
/// correlate with the noise, which would bias the scale.
pub trait Curve<const D: usize, const P: usize>: Sized {
    /// The curve of these parameters; `None` if A is not positive definite.
    fn new(position: &ParameterVector<P>, reference_mgauss: f64) -> Option<Self>;

    /// The sample's distance.
    fn distance(&self, point: &[f64; D]) -> Distance<P>;

    /// Equation 3.
    fn correct(&self, point: &[f64; D]) -> [f64; D];

    /// How the azimuth of a corrected field changes with the parameters, radians: for the field's
    /// direction `u`, and `across`, the derivative of the azimuth by u.
    fn azimuth(&self, u: &[f64; D], across: &[f64; D]) -> SVector<f64, P>;
}

/// A scale factor an axis: D biases, then D scale factors.
pub struct Diagonal<const D: usize> {
    centre: [f64; D],
    inverse: [f64; D],
    inverse_squares: f64,
    reference_mgauss: f64,
    /// 1/Hm.
    per_reference: f64,
}

impl<const D: usize, const P: usize> Curve<D, P> for Diagonal<D> {
    fn new(position: &ParameterVector<P>, reference_mgauss: f64) -> Option<Self> {
        let inverse: [f64; D] = std::array::from_fn(|axis| 1.0 / position[D + axis]);
        inverse
            .iter()
            .all(|&i| i > 0.0 && i.is_finite())
            .then(|| Self {
                centre: std::array::from_fn(|axis| position[axis]),
                inverse,
                inverse_squares: inverse.iter().map(|i| i * i).sum(),
                reference_mgauss,
                per_reference: 1.0 / reference_mgauss,
            })
    }

    // Left to itself, the compiler may call it for each sample, and a fit takes up to a quarter longer.
    #[inline(always)]
    fn distance(&self, point: &[f64; D]) -> Distance<P> {
        let mut u = [0.0; D];
        let mut squared = 0.0;
        for axis in 0..D {
            u[axis] = (point[axis] - self.centre[axis]) * self.inverse[axis];
            squared += u[axis] * u[axis];
        }
        let strength = squared.sqrt();
        let per_strength = 1.0 / strength;
        let mut gradient_squared = 0.0;
        let mut derivatives = SVector::<f64, P>::zeros();
        for axis in 0..D {
            u[axis] *= per_strength;
            let m = u[axis] * self.inverse[axis];
            derivatives[axis] = -m;
            gradient_squared += m * m;
        }
        let per_gradient = 1.0 / gradient_squared.sqrt();
        for axis in 0..D {
            derivatives[axis] *= per_gradient;
            derivatives[D + axis] = self.reference_mgauss * u[axis] * derivatives[axis];
        }
        Distance {
            value_mgauss: (strength - self.reference_mgauss) * per_gradient,
            derivatives,
            curvature: (self.inverse_squares - gradient_squared)
                * (per_gradient * self.per_reference),
        }
    }

    fn correct(&self, point: &[f64; D]) -> [f64; D] {
        std::array::from_fn(|axis| (point[axis] - self.centre[axis]) * self.inverse[axis])
    }

    fn azimuth(&self, u: &[f64; D], across: &[f64; D]) -> SVector<f64, P> {
        let mut gradient = SVector::<f64, P>::zeros();
        for axis in 0..D {
            let m = across[axis] * self.inverse[axis];
            gradient[axis] = -m / self.reference_mgauss;
            gradient[D + axis] = -m * u[axis];
        }
        gradient
    }
}

/// A symmetric A in three dimensions: three biases, then xx, yy, zz, and xy, xz, yz.
pub struct Symmetric {
    centre: Vector3<f64>,
    inverse: Matrix3<f64>,
    reference_mgauss: f64,
}

/// The off-diagonal entries of A, in the order of the parameters.
pub const PAIRS: [(usize, usize); 3] = [(0, 1), (0, 2), (1, 2)];

/// A symmetric A of its six parameters.
pub fn symmetric(entries: &[f64]) -> Matrix3<f64> {
    let [xx, yy, zz, xy, xz, yz] = std::array::from_fn(|k| entries[k]);
    Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz)
}

impl Symmetric {
    /// δ by the entries of A of −mᵀ·δA·u.
    #[inline(always)]
    fn by_entries(m: &Vector3<f64>, u: &Vector3<f64>) -> [f64; 6] {
        let pair = |(j, k): (usize, usize)| -(m[j] * u[k] + m[k] * u[j]);
        let [xy, xz, yz] = PAIRS.map(pair);
        [-m.x * u.x, -m.y * u.y, -m.z * u.z, xy, xz, yz]
    }
}

impl Curve<3, 9> for Symmetric {
    fn new(position: &ParameterVector<9>, reference_mgauss: f64) -> Option<Self> {
        let matrix = symmetric(&position[3..]);
        Some(Self {
            centre: Vector3::from_column_slice(&position[..3]),
            inverse: matrix.cholesky()?.inverse(),
            reference_mgauss,
        })
    }

    #[inline(always)]
    fn distance(&self, point: &[f64; 3]) -> Distance<9> {
        let h = self.inverse * (Vector3::from(*point) - self.centre);
        let strength = h.norm();
        let u = h / strength;
        let m = self.inverse * u;
        let gradient = m.norm();
        let n = m / gradient;
        let entries = Self::by_entries(&n, &u);
        let mut derivatives = SVector::<f64, 9>::zeros();
        for axis in 0..3 {
            derivatives[axis] = -n[axis];
        }
        for (k, entry) in entries.into_iter().enumerate() {
            derivatives[3 + k] = entry * self.reference_mgauss;
        }
        Distance {
            value_mgauss: (strength - self.reference_mgauss) / gradient,
            derivatives,
            curvature: (self.inverse.norm_squared() - m.norm_squared())
                / (gradient * self.reference_mgauss),
        }
    }

    fn correct(&self, point: &[f64; 3]) -> [f64; 3] {
        (self.inverse * (Vector3::from(*point) - self.centre)).into()
    }

    fn azimuth(&self, u: &[f64; 3], across: &[f64; 3]) -> SVector<f64, 9> {
        let m = self.inverse * Vector3::from(*across);
        let mut gradient = SVector::<f64, 9>::zeros();
        let entries = Self::by_entries(&m, &Vector3::from(*u));
        put(&mut gradient, (0, 0), &(-m / self.reference_mgauss));
        put(&mut gradient, (3, 0), &SVector::from(entries));
        gradient
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_distance_is_the_distance_along_the_normal() {
        // A circle of radius 100·2 about (10, 20).
        let curve = <Diagonal<2> as Curve<2, 4>>::new(&[10.0, 20.0, 2.0, 2.0], 100.0).unwrap();
        let found: Distance<4> = curve.distance(&[10.0, 230.0]);
        assert!((found.value_mgauss - 10.0).abs() < 1e-12);
        // Moving the centre up by 1 brings the curve 1 nearer; a larger scale by Hm times as much.
        assert!((found.derivatives[1] + 1.0).abs() < 1e-12);
        assert!((found.derivatives[3] + 100.0).abs() < 1e-12);
        // On a circle the lift is σ²/(2·radius).
        assert!((found.curvature - 1.0 / 200.0).abs() < 1e-12);
    }

    #[test]
    fn a_symmetric_a_without_cross_terms_is_a_diagonal_one() {
        let diagonal =
            <Diagonal<3> as Curve<3, 6>>::new(&[1.0, 2.0, 3.0, 0.9, 1.0, 1.1], 500.0).unwrap();
        let symmetric =
            Symmetric::new(&[1.0, 2.0, 3.0, 0.9, 1.0, 1.1, 0.0, 0.0, 0.0], 500.0).unwrap();
        let point = [300.0, -250.0, 310.0];
        let (a, b): (Distance<6>, _) = (diagonal.distance(&point), symmetric.distance(&point));
        assert!((a.value_mgauss - b.value_mgauss).abs() < 1e-9);
        assert!((a.curvature - b.curvature).abs() < 1e-12);
        for k in 0..6 {
            assert!((a.derivatives[k] - b.derivatives[k]).abs() < 1e-9);
        }
    }

    /// The derivatives at a sample on the curve, against small differences.
    #[test]
    fn the_derivatives_are_those_of_the_distance() {
        let position = [10.0, -20.0, 30.0, 0.9, 1.0, 1.1, 0.05, -0.03, 0.08];
        let matrix = symmetric(&position[3..]);
        let u = Vector3::new(0.4, -0.7, 0.5).normalize();
        let point: [f64; 3] = (matrix * u * 500.0 + Vector3::new(10.0, -20.0, 30.0)).into();
        let found = Symmetric::new(&position, 500.0).unwrap().distance(&point);
        for k in 0..9 {
            let step = if k < 3 { 1e-4 } else { 1e-7 };
            let value = |sign: f64| {
                let mut moved = position;
                moved[k] += sign * step;
                Symmetric::new(&moved, 500.0)
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
        assert!(<Diagonal<2> as Curve<2, 4>>::new(&[0.0, 0.0, 1.0, 0.0], 1.0).is_none());
        assert!(Symmetric::new(&[0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 2.0, 0.0, 0.0], 1.0).is_none());
    }
}
