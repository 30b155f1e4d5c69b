//! Cross-validation: the parameters of fits that leave out one part of the samples each.

use nalgebra::{SMatrix, SVector};

use super::curve::{Curve, Distance, ParameterVector};
use super::refine::{BIWEIGHT, Refined, accumulate, biweight, refine};

/// A step up to this long, in standard deviations of the noise, is taken as it is. White noise asks for
/// less; more means that this part differs from the others, and then their noise and weights do too.
const SHORT: f64 = 0.15;

/// For each part of `part` samples, the parameters without it. `distances` are those of the points from the
/// best fit.
///
/// At the best fit the whole gradient is 0, so that the others' gradient and information are the whole's
/// less the part's: one pass over the samples gives the step of all refits. A part whose loss moves the fit
/// far gets a refit of its own.
pub fn without_each_part<C: Curve<D, P>, const D: usize, const P: usize>(
    points: &[[f64; D]],
    distances: &[Distance<P>],
    best: &Refined<P>,
    part: usize,
) -> Vec<ParameterVector<P>> {
    let sigma = best.cutoff_mgauss / BIWEIGHT;
    let parts: Vec<_> = distances
        .chunks(part)
        .map(|part| accumulate(part, sigma, biweight))
        .collect();
    let information: SMatrix<f64, P, P> = parts.iter().map(|part| part.information).sum();
    let gradient: SVector<f64, P> = parts.iter().map(|part| part.gradient).sum();
    let unit = |k: usize| if k < D { 1.0 } else { best.reference_mgauss };
    parts
        .iter()
        .enumerate()
        .map(|(index, sums)| {
            let step = (information - sums.information)
                .cholesky()
                .map(|others| others.solve(&(gradient - sums.gradient)))
                .filter(|step| (0..P).all(|k| (step[k] * unit(k)).abs() <= SHORT * sigma));
            if let Some(step) = step {
                return std::array::from_fn(|k| best.position[k] - step[k]);
            }
            let (first, last) = (index * part, ((index + 1) * part).min(points.len()));
            let others = [&points[..first], &points[last..]].concat();
            refine::<C, D, P>(&others, &best.position, best.reference_mgauss)
                .map_or(best.position, |refit| refit.position)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::curve::Diagonal;

    /// Two turns of 280 samples; `noise` of a hash, some milligauss.
    fn circle(noise: f64) -> Vec<[f64; 2]> {
        let hash = |i: usize, k: usize| {
            let x = (i * 2 + k + 1).wrapping_mul(2_654_435_761);
            (x >> 9 & 0xffff) as f64 / 65536.0 - 0.5
        };
        (0..560)
            .map(|i| {
                let (sin, cos) = (i as f64 * 0.02244).sin_cos();
                [
                    87.0 + 148.0 * cos + noise * hash(i, 0),
                    54.0 + 170.0 * sin + noise * hash(i, 1),
                ]
            })
            .collect()
    }

    fn compare(points: &[[f64; 2]], part: usize) -> f64 {
        let start = [87.0, 54.0, 0.87, 1.0];
        let best = refine::<Diagonal<2>, 2, 4>(points, &start, 170.0).unwrap();
        let curve = <Diagonal<2> as Curve<2, 4>>::new(&best.position, 170.0).unwrap();
        let distances: Vec<Distance<4>> = points.iter().map(|p| curve.distance(p)).collect();
        let found = without_each_part::<Diagonal<2>, 2, 4>(points, &distances, &best, part);
        assert_eq!(found.len(), points.len().div_ceil(part));
        let mut largest = 0.0f64;
        for (index, found) in found.iter().enumerate() {
            let last = ((index + 1) * part).min(points.len());
            let others = [&points[..index * part], &points[last..]].concat();
            let refit = refine::<Diagonal<2>, 2, 4>(&others, &best.position, 170.0).unwrap();
            for k in 0..4 {
                let unit = if k < 2 { 1.0 } else { 170.0 };
                largest = largest.max(unit * (found[k] - refit.position[k]).abs());
            }
        }
        largest
    }

    #[test]
    fn a_step_comes_to_where_a_refit_comes() {
        let off = compare(&circle(7.0), 140);
        assert!(off < 0.02, "{off} milligauss");
    }

    #[test]
    fn a_part_that_matters_is_refitted() {
        // A magnet comes in the last quarter: without it the fit is another one.
        let mut points = circle(7.0);
        points[420..].iter_mut().for_each(|point| point[0] += 8.0);
        let off = compare(&points, 140);
        assert!(off < 0.02, "{off} milligauss");
    }
}
