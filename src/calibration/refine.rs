//! Maximum likelihood: from the swarm's answer to the parameters with the least orthogonal distance.
//!
//! The algebraic objective of Equation 8 overestimates scale by about 3(σ/(sH))² in two dimensions and
//! has no defence against spikes. This step minimises what noise on the sensor really is: the
//! distance of each sample from the curve |A⁻¹(B − b)| = Hm, measured in raw milligauss, with
//! Tukey's biweight in place of the square.

use nalgebra::{SMatrix, SVector};

use super::curve::{Curve, Distance, ParameterVector};
use super::medians::{MEDIAN_TO_SD, median};

/// Samples further out than this many standard deviations have no weight. At 6 the biweight loses 1 %
/// of precision on pure Gaussian noise.
pub const BIWEIGHT: f64 = 6.0;

/// The least noise that is believed, milligauss: less than any magnetometer's quantisation leaves.
const NOISE_FLOOR_MGAUSS: f64 = 0.02;

/// A scale of the residuals that changes by a smaller share from one round to the next has settled.
const SETTLED: f64 = 2e-4;

/// After this round the scale is held fixed, settled or not.
const LAST_SCALING: usize = 7;
/// A step shorter than this share of the noise is the last.
const CONVERGED: f64 = 3e-4;
/// A fit that has not converged after so many rounds stays where it is.
const MOST_ROUNDS: usize = 50;

/// JᵀWJ overstates how fast JᵀWe falls: by the mean of the biweight over that of its influence's slope, on
/// Gaussian noise (1 − 2/c² + 3/c⁴)/(1 − 6/c² + 15/c⁴) with c = [`BIWEIGHT`]. Steps lengthened by it converge in fewer rounds.
const LENGTHENED: f64 = 1.12;

/// Refined parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Refined<const P: usize> {
    /// Biases, scale factors and, of nine, the off-diagonal entries: see [`ParameterVector`].
    pub position: ParameterVector<P>,
    /// Hm that the scale factors refer to.
    pub reference_mgauss: f64,
    /// RMS distance of the samples with weight, freed of the parameters' share, milligauss.
    pub residual_mgauss: f64,
    /// Covariance of the parameters: the inverse of the Fisher information.
    pub covariance: SMatrix<f64, P, P>,
    /// How many samples have weight.
    pub used: usize,
    /// A sample at this distance or further has none, milligauss.
    pub cutoff_mgauss: f64,
}

/// Refines parameters over samples. `None` where the samples do not determine them, or where no
/// minimum is found near the start.
pub fn refine<const D: usize, const P: usize>(
    points: &[[f64; D]],
    start: &ParameterVector<P>,
    reference_mgauss: f64,
) -> Option<Refined<P>> {
    let mut position = *start;
    let mut distances: Vec<Distance<P>> = Vec::with_capacity(points.len());
    let mut sizes = Vec::with_capacity(points.len());
    let mut sigma = f64::INFINITY;
    let (mut settled, mut converged) = (false, false);
    for iteration in 0..MOST_ROUNDS {
        let curve = Curve::new(&position, reference_mgauss)?;
        distances.clear();
        distances.extend(points.iter().map(|point| curve.distance(point)));
        // The scale of the residuals settles in a few rounds; held fixed after that, the rest is a
        // plain minimisation and converges.
        if !settled {
            sizes.clear();
            sizes.extend(distances.iter().map(|distance| distance.value_mgauss.abs()));
            let before = sigma;
            let typical = median(&mut sizes)?;
            sigma = (MEDIAN_TO_SD * typical).max(NOISE_FLOOR_MGAUSS);
            settled = iteration == LAST_SCALING || (sigma - before).abs() < SETTLED * sigma;
        }
        if converged {
            break;
        }
        let sums = accumulate(&distances, sigma, biweight);
        let mut step = sums.information.cholesky()?.solve(&sums.gradient) * LENGTHENED;
        // Far from the minimum a whole step may overshoot: no scale is more than halved at once.
        let halved = (D..2 * D).map(|k| 0.5 * position[k] / step[k].max(0.5 * position[k]));
        step *= halved.fold(1.0, f64::min);
        let mut largest = 0.0f64;
        for k in 0..P {
            position[k] -= step[k];
            let unit = if k < D { 1.0 } else { reference_mgauss };
            largest = largest.max((step[k] * unit).abs());
        }
        if !largest.is_finite() {
            return None;
        }
        converged = settled && largest < CONVERGED * sigma;
    }

    let sums = accumulate(&distances, sigma, |_| 1.0);
    let variance = sums.squares / sums.used.checked_sub(P).filter(|&n| n > 0)? as f64;
    let covariance = sums.information.cholesky()?.inverse() * variance;
    let sane = covariance
        .iter()
        .chain(&position)
        .all(|value| value.is_finite());
    sane.then_some(Refined {
        position,
        reference_mgauss,
        residual_mgauss: variance.sqrt(),
        covariance,
        used: sums.used,
        cutoff_mgauss: BIWEIGHT * sigma,
    })
}

/// What a Gauss–Newton step is made of.
pub struct NormalEquations<const P: usize> {
    /// JᵀWJ.
    pub information: SMatrix<f64, P, P>,
    /// JᵀWe.
    pub gradient: SVector<f64, P>,
    squares: f64,
    used: usize,
}

/// Tukey's biweight of a distance in cutoffs, −1 to 1.
pub fn biweight(z: f64) -> f64 {
    (1.0 - z * z).powi(2)
}

/// The normal equations over the samples nearer than the cutoff; `weight` is that of a distance in cutoffs.
pub fn accumulate<const P: usize>(
    distances: &[Distance<P>],
    sigma: f64,
    weight: impl Fn(f64) -> f64,
) -> NormalEquations<P> {
    let mut sums = NormalEquations::<P> {
        information: SMatrix::<f64, P, P>::zeros(),
        gradient: SVector::<f64, P>::zeros(),
        squares: 0.0,
        used: 0,
    };
    let per_cutoff = 1.0 / (BIWEIGHT * sigma);
    let lift = 0.5 * sigma * sigma;
    for Distance {
        value_mgauss,
        derivatives,
        curvature,
    } in distances
    {
        let value = value_mgauss - curvature * lift;
        let z = value * per_cutoff;
        if z.abs() >= 1.0 || z.is_nan() {
            continue;
        }
        let weight = weight(z);
        sums.gradient += derivatives * (weight * value);
        // The whole square, not its half: a column at a time goes faster.
        for column in 0..P {
            let weighted = derivatives * (weight * derivatives[column]);
            for row in 0..P {
                sums.information[(row, column)] += weighted[row];
            }
        }
        sums.squares += value * value;
        sums.used += 1;
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refine2(points: &[[f64; 2]], start: &[f64; 4], reference: f64) -> Option<Refined<4>> {
        refine(points, start, reference)
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
        let refined = refine2(&points, &[70.0, 70.0, 1.0, 0.9], 170.0).unwrap();
        for (found, true_value) in refined.position.iter().zip(truth) {
            assert!((found - true_value).abs() < 1e-5, "{:?}", refined.position);
        }
        assert_eq!(refined.used, 200);
    }

    #[test]
    fn samples_that_do_not_determine_the_parameters_give_none() {
        let line: Vec<[f64; 2]> = (0..50).map(|i| [f64::from(i), 0.0]).collect();
        assert!(refine2(&line, &[25.0, 0.0, 1.0, 1.0], 25.0).is_none());
        assert!(refine2(&[], &[0.0, 0.0, 1.0, 1.0], 25.0).is_none());
        assert!(refine2(&[[f64::NAN, 1.0]; 9], &[0.0, 0.0, 1.0, 1.0], 25.0).is_none());
    }
}
