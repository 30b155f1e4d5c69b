//! Cross-validation: the parameters of fits that leave out one part of the samples each.

use std::ops::Range;

use nalgebra::{SMatrix, SVector};

use super::curve::{Distance, ParameterVector};
use super::refine::{BIWEIGHT, Refined, accumulate, biweight, refine};

/// Parts in a cross-validation: each is judged by a fit to the other three.
const PARTS: usize = 4;

/// Longest step of a refit that is used without iterating, in standard deviations of the noise. White noise makes shorter steps;
/// a longer one means that this part differs from the others, so that noise and weights change too.
const SHORT: f64 = 0.15;

/// The samples of a cross-validation, cut into parts.
pub struct Parts {
    /// In order and without a gap: one of each part, then one of each part again.
    ranges: Vec<Range<usize>>,
}

impl Parts {
    /// Cuts the samples at `cuts`, in order, and each piece into quarters: a part is the same quarter of all pieces. With cuts where turns
    /// begin and end, no part holds a whole turn, without which the others may not determine a fit.
    pub fn new(samples: usize, cuts: impl IntoIterator<Item = usize>) -> Self {
        let mut ranges = Vec::with_capacity(PARTS);
        let mut start = 0;
        for end in cuts.into_iter().chain([samples]) {
            let quarter = end.saturating_sub(start).div_ceil(PARTS);
            for _ in 0..PARTS {
                let next = (start + quarter).min(end.max(start));
                ranges.push(start..next);
                start = next;
            }
        }
        Self { ranges }
    }

    /// The part of each sample.
    pub fn of_each_sample(&self) -> Vec<usize> {
        let numbered = self.ranges.iter().zip((0..PARTS).cycle());
        numbered
            .flat_map(|(range, part)| std::iter::repeat_n(part, range.len()))
            .collect()
    }

    /// The items that are not in this part.
    fn without<T: Copy>(&self, part: usize, items: &[T]) -> Vec<T> {
        let numbered = items.iter().zip(self.of_each_sample());
        numbered
            .filter_map(|(item, of)| (of != part).then_some(*item))
            .collect()
    }
}

/// For each part, the parameters without it. `distances` are those of the points from the best fit.
///
/// At the best fit the whole gradient is 0, so that the others' gradient and information are the whole's
/// less the part's: one pass over the samples gives the step of all refits. A part whose loss moves the fit
/// far gets a refit of its own.
pub fn without_each_part<const D: usize, const P: usize>(
    points: &[[f64; D]],
    distances: &[Distance<P>],
    best: &Refined<P>,
    parts: &Parts,
) -> Vec<ParameterVector<P>> {
    let sigma = best.cutoff_mgauss / BIWEIGHT;
    let sums: [_; PARTS] = std::array::from_fn(|part| {
        let mut information = SMatrix::<f64, P, P>::zeros();
        let mut gradient = SVector::<f64, P>::zeros();
        for range in parts.ranges.iter().skip(part).step_by(PARTS) {
            let sums = accumulate(&distances[range.clone()], sigma, biweight);
            information += sums.information;
            gradient += sums.gradient;
        }
        (information, gradient)
    });
    let information: SMatrix<f64, P, P> = sums.iter().map(|(information, _)| information).sum();
    let gradient: SVector<f64, P> = sums.iter().map(|(_, gradient)| gradient).sum();
    let unit = |k: usize| if k < D { 1.0 } else { best.reference_mgauss };
    sums.iter()
        .enumerate()
        .map(|(part, (its_information, its_gradient))| {
            let step = (information - its_information)
                .cholesky()
                .map(|others| others.solve(&(gradient - its_gradient)))
                .filter(|step| (0..P).all(|k| (step[k] * unit(k)).abs() <= SHORT * sigma));
            if let Some(step) = step {
                return std::array::from_fn(|k| best.position[k] - step[k]);
            }
            let others = parts.without(part, points);
            refine(&others, &best.position, best.reference_mgauss)
                .map_or(best.position, |refit| refit.position)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::curve::Curve;

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

    fn compare(points: &[[f64; 2]], cuts: &[usize]) -> f64 {
        let start = [87.0, 54.0, 0.87, 1.0];
        let best = refine(points, &start, 170.0).unwrap();
        let curve = Curve::<2, 4>::new(&best.position, 170.0).unwrap();
        let distances: Vec<Distance<4>> = points.iter().map(|p| curve.distance(p)).collect();
        let parts = Parts::new(points.len(), cuts.iter().copied());
        let found = without_each_part(points, &distances, &best, &parts);
        assert_eq!(parts.of_each_sample().len(), points.len());
        let mut largest = 0.0f64;
        for (part, found) in found.iter().enumerate() {
            let others = parts.without(part, points);
            let refit = refine(&others, &best.position, 170.0).unwrap();
            for k in 0..4 {
                let unit = if k < 2 { 1.0 } else { 170.0 };
                largest = largest.max(unit * (found[k] - refit.position[k]).abs());
            }
        }
        largest
    }

    #[test]
    fn a_step_comes_to_where_a_refit_comes() {
        for (cuts, most) in [(&[][..], 0.02), (&[280], 0.05), (&[20, 300, 300], 0.05)] {
            let off = compare(&circle(7.0), cuts);
            assert!(off < most, "{off} milligauss");
        }
    }

    #[test]
    fn a_part_that_matters_is_refitted() {
        // A magnet comes in the last quarter: without it the fit is another one.
        let mut points = circle(7.0);
        points[420..].iter_mut().for_each(|point| point[0] += 8.0);
        let off = compare(&points, &[]);
        assert!(off < 0.02, "{off} milligauss");
    }
}
