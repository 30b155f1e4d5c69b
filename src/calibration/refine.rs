//! Maximum likelihood: from the swarm's answer to the parameters with the least orthogonal distance.
//!
//! The algebraic objective of Equation 8 overestimates scale by about 3(σ/(sH))² in two dimensions and
//! has no defence against spikes. This step minimises what noise on the sensor really is: the
//! distance of each sample from the curve |A⁻¹(B − b)| = Hm, measured in raw milligauss, with
//! Tukey's biweight in place of the square.

use nalgebra::{SMatrix, SVector};

use super::objective::Position;

/// Samples further out than this many standard deviations have no weight. At 6 the biweight loses 1 %
/// of precision on pure Gaussian noise.
const BIWEIGHT: f64 = 6.0;

/// The least noise that is believed, milligauss: less than any magnetometer's quantisation leaves.
const NOISE_FLOOR_MGAUSS: f64 = 0.02;

/// Refined parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Refined<const P: usize> {
    /// Biases, then scale factors.
    pub position: Position<P>,
    /// RMS distance of the samples with weight, freed of the parameters' share, milligauss.
    pub residual_mgauss: f64,
    /// Covariance of the parameters: the inverse of the Fisher information.
    pub covariance: SMatrix<f64, P, P>,
    /// How many samples have weight.
    pub used: usize,
    /// A sample at this distance or further has none, milligauss.
    pub cutoff_mgauss: f64,
}

/// A sample's signed distance from the curve, and its derivatives by the parameters.
///
/// e = (|h| − Hm)/|A⁻¹u| with h = A⁻¹(B − b), u = h/|h|: first order in the distance, along the normal n.
/// The derivatives are taken at the foot point |h| = Hm, not at the noisy sample: there they do not
/// correlate with the noise, which would bias the scale.
#[inline]
pub fn distance<const D: usize, const P: usize>(
    point: &[f64; D],
    position: &Position<P>,
    reference_mgauss: f64,
) -> Distance<P> {
    let mut u = [0.0; D];
    let mut squared = 0.0;
    for axis in 0..D {
        u[axis] = (point[axis] - position[axis]) / position[D + axis];
        squared += u[axis] * u[axis];
    }
    let strength = squared.sqrt();
    let mut gradient_squared = 0.0;
    let mut inverse_squares = 0.0;
    let mut derivatives = SVector::<f64, P>::zeros();
    for axis in 0..D {
        u[axis] /= strength;
        let m = u[axis] / position[D + axis];
        derivatives[axis] = -m;
        gradient_squared += m * m;
        inverse_squares += 1.0 / (position[D + axis] * position[D + axis]);
    }
    let gradient = gradient_squared.sqrt();
    for axis in 0..D {
        derivatives[axis] /= gradient;
        derivatives[D + axis] = reference_mgauss * u[axis] * derivatives[axis];
    }
    Distance {
        value_mgauss: (strength - reference_mgauss) / gradient,
        derivatives,
        curvature: (inverse_squares - gradient_squared) / (gradient * reference_mgauss),
    }
}

/// What [`distance`] tells.
pub struct Distance<const P: usize> {
    /// The signed distance, outside positive, milligauss.
    pub value_mgauss: f64,
    /// Its derivatives by biases and scale factors.
    pub derivatives: SVector<f64, P>,
    /// Noise along the curve lifts a sample off it by half of this times the variance.
    curvature: f64,
}

/// Refines parameters over samples. `None` where the samples do not determine them, or where no
/// minimum is found near the start.
pub fn refine<const D: usize, const P: usize>(
    points: &[[f64; D]],
    start: &Position<P>,
    reference_mgauss: f64,
) -> Option<Refined<P>> {
    let mut position = *start;
    let mut distances = Vec::with_capacity(points.len());
    let mut sigma = f64::INFINITY;
    for iteration in 0..50 {
        // The scale of the residuals settles in a few rounds; held fixed after that, the rest is a
        // plain minimisation and converges.
        if iteration < 8 {
            distances.clear();
            distances.extend(
                points
                    .iter()
                    .map(|p| distance(p, &position, reference_mgauss).value_mgauss.abs()),
            );
            sigma = 1.4826 * median(&mut distances)?;
            sigma = sigma.max(NOISE_FLOOR_MGAUSS);
        }
        let sums = accumulate(points, &position, reference_mgauss, sigma);
        let mut step = sums.information.cholesky()?.solve(&sums.gradient);
        // Far from the minimum a whole step may overshoot: no scale is more than halved at once.
        let halved = (D..P).map(|k| 0.5 * position[k] / step[k].max(0.5 * position[k]));
        step *= halved.fold(1.0, f64::min);
        let mut largest = 0.0f64;
        for k in 0..P {
            position[k] -= step[k];
            let unit = if k < D { 1.0 } else { reference_mgauss };
            largest = largest.max((step[k] * unit).abs());
        }
        if !largest.is_finite() || position[D..].iter().any(|&scale| scale <= 0.0) {
            return None;
        }
        if iteration >= 3 && largest < 1e-4 * sigma {
            break;
        }
    }

    let sums = accumulate(points, &position, reference_mgauss, sigma);
    let variance = sums.squares / sums.used.checked_sub(P).filter(|&n| n > 0)? as f64;
    let covariance = sums.plain_information.cholesky()?.inverse() * variance;
    let sane = covariance
        .iter()
        .chain(&position)
        .all(|value| value.is_finite());
    sane.then_some(Refined {
        position,
        residual_mgauss: variance.sqrt(),
        covariance,
        used: sums.used,
        cutoff_mgauss: BIWEIGHT * sigma,
    })
}

/// A sample's distance from the curve of these parameters, milligauss.
pub fn residual<const D: usize, const P: usize>(
    point: &[f64; D],
    position: &Position<P>,
    reference_mgauss: f64,
) -> f64 {
    distance(point, position, reference_mgauss).value_mgauss
}

struct Sums<const P: usize> {
    information: SMatrix<f64, P, P>,
    plain_information: SMatrix<f64, P, P>,
    gradient: SVector<f64, P>,
    squares: f64,
    used: usize,
}

fn accumulate<const D: usize, const P: usize>(
    points: &[[f64; D]],
    position: &Position<P>,
    reference_mgauss: f64,
    sigma: f64,
) -> Sums<P> {
    let mut sums = Sums::<P> {
        information: SMatrix::<f64, P, P>::zeros(),
        plain_information: SMatrix::<f64, P, P>::zeros(),
        gradient: SVector::<f64, P>::zeros(),
        squares: 0.0,
        used: 0,
    };
    for point in points {
        let Distance {
            value_mgauss,
            derivatives,
            curvature,
        } = distance(point, position, reference_mgauss);
        let lifted = 0.5 * curvature * sigma * sigma;
        let value = value_mgauss - lifted;
        let z = value / (BIWEIGHT * sigma);
        if z.abs() >= 1.0 || z.is_nan() {
            continue;
        }
        let weight = (1.0 - z * z).powi(2);
        for row in 0..P {
            sums.gradient[row] += weight * derivatives[row] * value;
            for column in 0..=row {
                let product = derivatives[row] * derivatives[column];
                sums.information[(row, column)] += weight * product;
                sums.plain_information[(row, column)] += product;
            }
        }
        sums.squares += value * value;
        sums.used += 1;
    }
    sums.information.fill_upper_triangle_with_lower_triangle();
    sums.plain_information
        .fill_upper_triangle_with_lower_triangle();
    sums
}

/// The median of numbers whose order does not matter; `None` of nothing, or where one is NaN.
pub fn median(values: &mut [f64]) -> Option<f64> {
    if values.is_empty() || values.iter().any(|value| value.is_nan()) {
        return None;
    }
    let middle = values.len() / 2;
    Some(*values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_distance_is_the_distance_along_the_normal() {
        // A circle of radius 100·2 about (10, 20).
        let position = [10.0, 20.0, 2.0, 2.0];
        let found = distance(&[10.0, 230.0], &position, 100.0);
        assert!((found.value_mgauss - 10.0).abs() < 1e-12);
        // Moving the centre up by 1 brings the curve 1 nearer; a larger scale by Hm times as much.
        assert!((found.derivatives[1] + 1.0).abs() < 1e-12);
        assert!((found.derivatives[3] + 100.0).abs() < 1e-12);
        // On a circle the lift is σ²/(2·radius).
        assert!((found.curvature - 1.0 / 200.0).abs() < 1e-12);
    }

    #[test]
    fn exact_samples_give_exact_parameters_from_a_rough_start() {
        let truth = [87.28, 54.19, 0.873, 0.998];
        let points: Vec<[f64; 2]> = (0..200)
            .map(|i| {
                let t = f64::from(i) * 0.05;
                [
                    truth[0] + 170.0 * truth[2] * t.cos(),
                    truth[1] + 170.0 * truth[3] * t.sin(),
                ]
            })
            .collect();
        let refined = refine(&points, &[70.0, 70.0, 1.0, 0.9], 170.0).unwrap();
        for (found, true_value) in refined.position.iter().zip(truth) {
            assert!((found - true_value).abs() < 1e-5, "{:?}", refined.position);
        }
        assert_eq!(refined.used, 200);
    }

    #[test]
    fn samples_that_do_not_determine_the_parameters_give_none() {
        let line: Vec<[f64; 2]> = (0..50).map(|i| [f64::from(i), 0.0]).collect();
        assert!(refine(&line, &[25.0, 0.0, 1.0, 1.0], 25.0).is_none());
        assert!(refine::<2, 4>(&[], &[0.0, 0.0, 1.0, 1.0], 25.0).is_none());
        assert!(refine(&[[f64::NAN, 1.0]; 9], &[0.0, 0.0, 1.0, 1.0], 25.0).is_none());
    }
}
