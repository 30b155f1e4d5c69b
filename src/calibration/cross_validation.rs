//! Cross-validation: the parameters of fits that leave out one part of the samples each.

use super::curve::{Curve, ParameterVector};
use super::refine::{Refined, refine};

/// For each part of `part` samples, the parameters without it: those of the best fit where the others do not determine any.
pub fn without_each_part<C: Curve<D, P>, const D: usize, const P: usize>(
    points: &[[f64; D]],
    best: &Refined<P>,
    part: usize,
) -> Vec<ParameterVector<P>> {
    (0..points.len())
        .step_by(part)
        .map(|first| {
            let last = (first + part).min(points.len());
            let others = [&points[..first], &points[last..]].concat();
            refine::<C, D, P>(&others, &best.position, best.reference_mgauss)
                .map_or(best.position, |refit| refit.position)
        })
        .collect()
}
