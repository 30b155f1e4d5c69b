//! Equations 7 and 8, as a sum over samples and as a triangular factor of fixed size.
//!
//! With u = (B − m)/d for any centre m and length d, Equation 7 reads
//!
//! ΔH / Hm² = 1 − Σ ((uᵢ − βᵢ)/αᵢ)²,  β = (b − m)/d,  α = a·Hm/d,
//!
//! which is linear in φ = (1, u₁², u₁, u₂², u₂ …); a symmetric A adds the products u₁u₂, u₁u₃, u₂u₃. So Σ(ΔH)² = Hm⁴ · cᵀ(Σφφᵀ)c = Hm⁴ · ‖R·c‖², where R is
//! the triangular factor of Σφφᵀ: one pass over the samples builds it, and after that a particle costs
//! the same whatever the length of the log.

use nalgebra::{SMatrix, SVector, SymmetricEigen};

use super::curve::{self, PAIRS, ParameterVector};

/// Equation 8 by the direct sum over samples, under the diagonal model: the reference that the factor is held
/// to, and what profile `paper` evaluates.
pub fn direct<const D: usize, const P: usize>(
    points: &[[f64; D]],
    position: &ParameterVector<P>,
    reference_mgauss: f64,
) -> f64 {
    let mut sum = 0.0;
    for point in points {
        let mut squared = 0.0;
        for axis in 0..D {
            let h = (point[axis] - position[axis]) / position[D + axis];
            squared += h * h;
        }
        let delta = reference_mgauss * reference_mgauss - squared;
        sum += delta * delta;
    }
    sum.sqrt()
}

/// A square matrix of which only the upper triangle counts.
type Triangle<const F: usize> = [[f64; F]; F];

/// The triangular factor R of Σφφᵀ, RᵀR = Σφφᵀ (Cholesky). A column that depends on those before it, as
/// with a constant axis, gives a zero row: it adds nothing to any sum of squares.
fn factor<const F: usize>(moments: &Triangle<F>) -> Triangle<F> {
    let mut r = [[0.0; F]; F];
    for row in 0..F {
        let mut pivot = moments[row][row];
        for above in r.iter().take(row) {
            pivot -= above[row] * above[row];
        }
        if pivot <= moments[row][row] * 1e-14 {
            continue;
        }
        let root = pivot.sqrt();
        r[row][row] = root;
        for column in row + 1..F {
            let mut value = moments[row][column];
            for above in r.iter().take(row) {
                value -= above[row] * above[column];
            }
            r[row][column] = value / root;
        }
    }
    r
}

/// The least-squares solution θ of φ·θ = 1 over all features but the first, the constant: the linear
/// conic fit. `None` if the samples do not determine it.
fn solve_for_one<const F: usize>(moments: &Triangle<F>) -> Option<[f64; F]> {
    // With the constant moved last, the last column of the factor is the transformed right side.
    let mut moved = [[0.0; F]; F];
    let place = |feature: usize| if feature == 0 { F - 1 } else { feature - 1 };
    for row in 0..F {
        for column in row..F {
            let (i, j) = (place(row), place(column));
            moved[i.min(j)][i.max(j)] = moments[row][column];
        }
    }
    let r = factor(&moved);
    let mut theta = [0.0; F];
    for row in (0..F - 1).rev() {
        let mut value = r[row][F - 1];
        for column in row + 1..F - 1 {
            value -= r[row][column] * theta[column + 1];
        }
        theta[row + 1] = value / r[row][row];
    }
    finite(theta)
}

fn finite<const N: usize>(numbers: [f64; N]) -> Option<[f64; N]> {
    let all = numbers.iter().all(|number| number.is_finite());
    all.then_some(numbers)
}

/// The centre and length that bring samples near to 1, so that squares and fourth powers keep their
/// digits even where the bias is many times the field.
#[derive(Clone, Copy, Debug)]
pub struct Normalizer<const D: usize> {
    centre: [f64; D],
    length: f64,
}

impl<const D: usize> Normalizer<D> {
    /// From the ranges of the axes: the middle of each, and half of the longest.
    pub fn new(low: &[f64; D], high: &[f64; D]) -> Self {
        let mut centre = [0.0; D];
        let mut length = 0.0f64;
        for axis in 0..D {
            centre[axis] = 0.5 * (low[axis] + high[axis]);
            length = length.max(0.5 * (high[axis] - low[axis]));
        }
        Self {
            centre,
            length: if length > 0.0 { length } else { 1.0 },
        }
    }

    /// φ = (1, u₁², u₁, u₂², u₂ …), F = 2·D + 1; with the three products of a symmetric model F = 10.
    #[inline]
    fn features<const F: usize>(&self, point: &[f64; D]) -> [f64; F] {
        let mut features = [1.0; F];
        for axis in 0..D {
            let u = (point[axis] - self.centre[axis]) / self.length;
            features[1 + 2 * axis] = u * u;
            features[2 + 2 * axis] = u;
        }
        if F > 2 * D + 1 {
            for (k, (i, j)) in PAIRS.into_iter().enumerate() {
                features[2 * D + 1 + k] = features[2 + 2 * i] * features[2 + 2 * j];
            }
        }
        features
    }

    #[inline]
    fn coefficients<const P: usize, const F: usize>(
        &self,
        position: &ParameterVector<P>,
        reference_mgauss: f64,
    ) -> [f64; F] {
        const { assert!(P == 2 * D && F == 2 * D + 1, "a bias and a scale per axis") };
        let mut coefficients = [1.0; F];
        for axis in 0..D {
            let beta = (position[axis] - self.centre[axis]) / self.length;
            let alpha = position[D + axis] * reference_mgauss / self.length;
            let inverse = 1.0 / (alpha * alpha);
            coefficients[0] -= beta * beta * inverse;
            coefficients[1 + 2 * axis] = -inverse;
            coefficients[2 + 2 * axis] = 2.0 * beta * inverse;
        }
        coefficients
    }
}

/// Equation 8 through the triangular factor.
#[derive(Clone, Debug)]
pub struct Factored<const D: usize, const F: usize> {
    normal: Normalizer<D>,
    /// Σφφᵀ.
    moments: Triangle<F>,
    factor: Triangle<F>,
    reference_mgauss: f64,
}

impl<const D: usize, const F: usize> Factored<D, F> {
    /// One pass over the samples.
    pub fn new<'a>(
        normal: Normalizer<D>,
        points: impl IntoIterator<Item = &'a [f64; D]>,
        reference_mgauss: f64,
    ) -> Self {
        let mut moments = [[0.0; F]; F];
        for point in points {
            let features = normal.features::<F>(point);
            for row in 0..F {
                for column in row..F {
                    moments[row][column] += features[row] * features[column];
                }
            }
        }
        Self {
            normal,
            factor: factor(&moments),
            moments,
            reference_mgauss,
        }
    }

    /// Equation 8 at this position, milligauss²: Hm²·‖R·c‖.
    #[inline]
    pub fn fit_value<const P: usize>(&self, position: &ParameterVector<P>) -> f64 {
        let c = self
            .normal
            .coefficients::<P, F>(position, self.reference_mgauss);
        let mut squares = 0.0;
        for row in 0..F {
            let mut value = 0.0;
            for column in row..F {
                value += self.factor[row][column] * c[column];
            }
            squares += value * value;
        }
        self.reference_mgauss * self.reference_mgauss * squares.sqrt()
    }

    /// The linear least-squares conic through the samples, as a position: exact without noise, and a
    /// start that is never far away. `None` if it is no ellipse.
    pub fn conic<const P: usize>(&self) -> Option<ParameterVector<P>> {
        let theta = solve_for_one(&self.moments)?;
        if P > 2 * D {
            return self.symmetric_conic(&theta);
        }
        let mut level = 1.0;
        let mut position = [0.0; P];
        for axis in 0..D {
            let (square, linear) = (theta[1 + 2 * axis], theta[2 + 2 * axis]);
            let centre = -0.5 * linear / square;
            level += square * centre * centre;
            position[axis] = self.normal.centre[axis] + self.normal.length * centre;
        }
        for axis in 0..D {
            let radius = (level / theta[1 + 2 * axis]).sqrt() * self.normal.length;
            position[D + axis] = radius / self.reference_mgauss;
        }
        finite(position)
    }

    /// uᵀQu + lᵀu = 1 as a position: the centre is c = −Q⁻¹l/2, and A is the inverse square root of
    /// Q/(1 + cᵀQc).
    fn symmetric_conic<const P: usize>(&self, theta: &[f64; F]) -> Option<ParameterVector<P>> {
        let squares = (0..3).map(|axis| theta[1 + 2 * axis]);
        let products = (0..3).map(|pair| 0.5 * theta[7 + pair]);
        let form = curve::matrix::<3>(&squares.chain(products).collect::<Vec<f64>>());
        let linear = SVector::<f64, 3>::from_fn(|axis, _| theta[2 + 2 * axis]);
        let centre = form.try_inverse()? * linear * -0.5;
        let level = 1.0 + centre.dot(&(form * centre));
        let eigen = SymmetricEigen::new(form / level);
        if !eigen.eigenvalues.iter().all(|&value| value > 0.0) {
            return None;
        }
        let radii = SMatrix::from_diagonal(&eigen.eigenvalues.map(|value| 1.0 / value.sqrt()));
        let a = eigen.eigenvectors
            * radii
            * eigen.eigenvectors.transpose()
            * (self.normal.length / self.reference_mgauss);
        let mut position = [0.0; P];
        for axis in 0..D {
            position[axis] = self.normal.centre[axis] + self.normal.length * centre[axis];
            position[D + axis] = a[(axis, axis)];
        }
        for (k, pair) in PAIRS.into_iter().enumerate() {
            position[2 * D + k] = a[pair];
        }
        finite(position)
    }
}

#[cfg(test)]
mod tests;
