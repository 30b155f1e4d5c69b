//! Equations 7 and 8, as a sum over samples and as a triangular factor of fixed size.
//!
//! With u = (B − m)/d for any centre m and length d, Equation 7 reads
//!
//! ΔH / Hm² = 1 − Σ ((uᵢ − βᵢ)/αᵢ)²,  β = (b − m)/d,  α = a·Hm/d,
//!
//! which is linear in φ = (1, u₁², u₁, u₂², u₂ …). So Σ(ΔH)² = Hm⁴ · cᵀ(Σφφᵀ)c = Hm⁴ · ‖R·c‖², where R is
//! the triangular factor of Σφφᵀ: one pass over the samples builds it, and after that a particle costs
//! the same whatever the length of the log.

/// A particle's position: D biases in milligauss, then D scale factors; P = 2·D.
pub type Position<const P: usize> = [f64; P];

/// Equation 8 by the direct sum over samples: the reference that the factor is held to, and what
/// profile `paper` evaluates.
pub fn direct<const D: usize, const P: usize>(
    points: &[[f64; D]],
    position: &Position<P>,
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

/// Σφφᵀ of any number of samples; sums over parts of a log merge by addition.
#[derive(Clone, Debug)]
pub struct Moments<const F: usize> {
    /// Upper triangle.
    sum: [[f64; F]; F],
}

impl<const F: usize> Default for Moments<F> {
    fn default() -> Self {
        Self { sum: [[0.0; F]; F] }
    }
}

impl<const F: usize> Moments<F> {
    /// Adds one sample's features.
    pub fn add(&mut self, features: &[f64; F]) {
        for row in 0..F {
            for column in row..F {
                self.sum[row][column] += features[row] * features[column];
            }
        }
    }

    /// Adds another part's sums; both must share centre and length.
    pub fn merge(&mut self, other: &Self) {
        for (mine, theirs) in self
            .sum
            .iter_mut()
            .flatten()
            .zip(other.sum.iter().flatten())
        {
            *mine += theirs;
        }
    }

    /// The triangular factor R, RᵀR = Σφφᵀ (Cholesky). A column that depends on those before it, as
    /// with a constant axis, gives a zero row: it adds nothing to any sum of squares.
    pub fn factor(&self) -> Factor<F> {
        let mut r = [[0.0; F]; F];
        for row in 0..F {
            let mut pivot = self.sum[row][row];
            for above in r.iter().take(row) {
                pivot -= above[row] * above[row];
            }
            if pivot <= self.sum[row][row] * 1e-14 {
                continue;
            }
            let root = pivot.sqrt();
            r[row][row] = root;
            for column in row + 1..F {
                let mut value = self.sum[row][column];
                for above in r.iter().take(row) {
                    value -= above[row] * above[column];
                }
                r[row][column] = value / root;
            }
        }
        Factor { r }
    }

    /// The features' least-squares answer to φ·θ = 1, θ for every feature but the first, which is the
    /// constant: the linear conic fit. `None` if the samples do not determine it.
    fn solve_for_one(&self) -> Option<[f64; F]> {
        // With the constant moved last, the last column of the factor is the transformed right side.
        let mut moved = Self::default();
        let place = |feature: usize| if feature == 0 { F - 1 } else { feature - 1 };
        for row in 0..F {
            for column in row..F {
                let (i, j) = (place(row), place(column));
                moved.sum[i.min(j)][i.max(j)] = self.sum[row][column];
            }
        }
        let r = moved.factor().r;
        let mut theta = [0.0; F];
        for row in (0..F - 1).rev() {
            let mut value = r[row][F - 1];
            for column in row + 1..F - 1 {
                value -= r[row][column] * theta[column + 1];
            }
            theta[row + 1] = value / r[row][row];
        }
        theta.iter().all(|value| value.is_finite()).then_some(theta)
    }
}

/// The triangular factor of Σφφᵀ.
#[derive(Clone, Debug)]
pub struct Factor<const F: usize> {
    r: [[f64; F]; F],
}

impl<const F: usize> Factor<F> {
    /// ‖R·c‖.
    #[inline]
    pub fn norm(&self, coefficients: &[f64; F]) -> f64 {
        let mut sum = 0.0;
        for row in 0..F {
            let mut value = 0.0;
            for column in row..F {
                value += self.r[row][column] * coefficients[column];
            }
            sum += value * value;
        }
        sum.sqrt()
    }
}

/// The centre and length that bring samples near to 1, so that squares and fourth powers keep their
/// digits even where the bias is many times the field.
#[derive(Clone, Copy, Debug)]
pub struct Normal<const D: usize> {
    centre: [f64; D],
    length: f64,
}

impl<const D: usize> Normal<D> {
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

    /// φ = (1, u₁², u₁, u₂², u₂ …); F = 2·D + 1.
    #[inline]
    pub fn features<const F: usize>(&self, point: &[f64; D]) -> [f64; F] {
        let mut features = [1.0; F];
        for axis in 0..D {
            let u = (point[axis] - self.centre[axis]) / self.length;
            features[1 + 2 * axis] = u * u;
            features[2 + 2 * axis] = u;
        }
        features
    }

    #[inline]
    fn coefficients<const P: usize, const F: usize>(
        &self,
        position: &Position<P>,
        reference_mgauss: f64,
    ) -> [f64; F] {
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
    normal: Normal<D>,
    moments: Moments<F>,
    factor: Factor<F>,
    reference_mgauss: f64,
}

impl<const D: usize, const F: usize> Factored<D, F> {
    /// One pass over the samples.
    pub fn new<'a>(
        normal: Normal<D>,
        points: impl IntoIterator<Item = &'a [f64; D]>,
        reference_mgauss: f64,
    ) -> Self {
        let mut moments = Moments::default();
        for point in points {
            moments.add(&normal.features(point));
        }
        let factor = moments.factor();
        Self {
            normal,
            moments,
            factor,
            reference_mgauss,
        }
    }

    /// Equation 8 at this position, milligauss².
    #[inline]
    pub fn fit_value<const P: usize>(&self, position: &Position<P>) -> f64 {
        let coefficients = self
            .normal
            .coefficients::<P, F>(position, self.reference_mgauss);
        self.reference_mgauss * self.reference_mgauss * self.factor.norm(&coefficients)
    }

    /// The linear least-squares conic through the samples, as a position: exact without noise, and a
    /// start that is never far away. `None` if it is no ellipse.
    pub fn conic<const P: usize>(&self) -> Option<Position<P>> {
        let theta = self.moments.solve_for_one()?;
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
        position
            .iter()
            .all(|value| value.is_finite())
            .then_some(position)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_direct_sum_is_equation_8() {
        // Hm = 5; at (7, 8) with b = (1, 0), a = (2, 2): H = (3, 4), ΔH = 0.
        // At (1, 2): H = (0, 1), ΔH = 24. At (3, 0): H = (1, 0), ΔH = 24.
        let position = [1.0, 0.0, 2.0, 2.0];
        let points = [[7.0, 8.0], [1.0, 2.0], [3.0, 0.0]];
        assert!((direct(&points, &position, 5.0) - (2.0f64 * 24.0 * 24.0).sqrt()).abs() < 1e-12);
    }

    fn ellipse(
        count: usize,
        position: &[f64; 6],
        noise: impl Fn(usize, usize) -> f64,
    ) -> Vec<[f64; 3]> {
        (0..count)
            .map(|i| {
                let (t, s) = (i as f64 * 0.37, i as f64 * 0.011);
                let h = [t.cos() * s.cos(), t.sin() * s.cos(), s.sin()];
                std::array::from_fn(|k| h[k] * 500.0 * position[3 + k] + position[k] + noise(i, k))
            })
            .collect()
    }

    proptest! {
        #[test]
        fn factor_and_direct_sum_agree(
            bias in prop::array::uniform3(-10_000.0..10_000.0f64),
            scale in prop::array::uniform3(0.3..3.0f64),
            off in prop::array::uniform6(0.9..1.1f64),
            seed in 0u64..1000,
        ) {
            let truth = [bias[0], bias[1], bias[2], scale[0], scale[1], scale[2]];
            let hash = |i: usize, k: usize| {
                let x = (seed as usize + 1).wrapping_mul(i * 3 + k + 1).wrapping_mul(2_654_435_761);
                (x >> 7 & 0xffff) as f64 / 65536.0 - 0.5
            };
            let points = ellipse(400, &truth, |i, k| 6.0 * hash(i, k));
            let low = std::array::from_fn(|k| points.iter().map(|p| p[k]).fold(f64::MAX, f64::min));
            let high = std::array::from_fn(|k| points.iter().map(|p| p[k]).fold(f64::MIN, f64::max));
            let factored = Factored::<3, 7>::new(Normal::new(&low, &high), &points, 500.0);
            let near: [f64; 6] = std::array::from_fn(|k| if k < 3 { truth[k] + 300.0 * (off[k] - 1.0) } else { truth[k] * off[k] });
            for position in [truth, near] {
                let (a, b) = (direct(&points, &position, 500.0), factored.fit_value(&position));
                prop_assert!((a - b).abs() <= 1e-9 * a, "{a} {b}");
            }
        }
    }

    #[test]
    fn parts_of_a_log_merge() {
        let points = ellipse(100, &[10.0, 20.0, 30.0, 1.0, 1.1, 0.9], |_, _| 0.0);
        let normal = Normal::new(&[-500.0; 3], &[500.0; 3]);
        let sum = |points: &[[f64; 3]]| {
            let mut moments = Moments::<7>::default();
            points
                .iter()
                .for_each(|point| moments.add(&normal.features(point)));
            moments
        };
        let mut merged = sum(&points[..37]);
        merged.merge(&sum(&points[37..]));
        let (merged, whole) = (merged.factor(), sum(&points).factor());
        let probe = [1.0, -0.9, 0.1, -1.1, 0.2, -0.8, 0.3];
        assert!((merged.norm(&probe) - whole.norm(&probe)).abs() < 1e-12);
    }

    #[test]
    fn the_conic_is_exact_without_noise() {
        let truth = [87.28, 54.19, 135.0, 0.873, 0.998, 0.94];
        let points = ellipse(300, &truth, |_, _| 0.0);
        let normal = Normal::new(&[-400.0; 3], &[600.0; 3]);
        let conic: [f64; 6] = Factored::<3, 7>::new(normal, &points, 500.0)
            .conic()
            .unwrap();
        for (found, true_value) in conic.iter().zip(truth) {
            assert!((found - true_value).abs() < 1e-6, "{conic:?}");
        }
    }

    #[test]
    fn a_constant_axis_gives_no_conic_and_no_nan() {
        let points: Vec<[f64; 2]> = (0..50).map(|i| [f64::from(i), 3.0]).collect();
        let factored =
            Factored::<2, 5>::new(Normal::new(&[0.0, 3.0], &[49.0, 3.0]), &points, 100.0);
        assert_eq!(factored.conic::<4>(), None);
        assert!(factored.fit_value(&[25.0, 3.0, 1.0, 1.0]).is_finite());
    }
}
