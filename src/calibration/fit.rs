//! One fit in two or three dimensions: box, swarm, refinement.

use std::sync::atomic::AtomicBool;

use nalgebra::SMatrix;

use super::curve::ParameterVector;
use super::medians::{MEDIAN_TO_SD, median, median_of};
use super::objective::{Factored, Normalizer, direct};
use super::refine::{Refined, refine};
use super::settings::{Profile, Settings};
use super::swarm::{Bounds, SwarmResult, search};

/// Levelled points and the parameters that fit them best.
pub struct Fitted<const D: usize, const P: usize> {
    /// The points.
    pub points: Vec<[f64; D]>,
    /// Down along the axes of a plane, on average, as far as the tilt was known: 0 if it never was.
    pub level: [f64; D],
    /// The best fit.
    pub best: Refined<P>,
}

/// The share of samples at either end that may be spikes, and so do not count as an extreme.
const EXTREME_QUANTILE: f64 = 0.004;
/// A sample this many robust deviations from its neighbours is a spike. Noise makes one in 10¹⁵.
const SPIKE_SDS: f64 = 8.0;
/// Such a deviation is at least this, milligauss: a coarse axis repeats a number, and its neighbours then differ by nothing.
const LEAST_SD_MGAUSS: f64 = 1.0;

/// The box that an ellipse through these points must lie in, and Hm if none was given.
///
/// The extremes are quantiles, and are believed to within `margin`: four standard deviations of
/// the noise and 2 % of the range. The smallest scale factor is that of an axis seen from end to end, the
/// largest that of an axis of which the arc shows less than half.
pub fn bounds<const D: usize>(
    points: &[[f64; D]],
    reference_mgauss: Option<f64>,
) -> Option<Bounds<D>> {
    if points.len() < 2 * D + 1 {
        return None;
    }
    let (mut low, mut high) = ([0.0; D], [0.0; D]);
    let mut noise = 0.0f64;
    let mut column = Vec::with_capacity(points.len());
    for axis in 0..D {
        column.clear();
        column.extend(points.iter().map(|point| point[axis]));
        noise = noise.max(noise_of(&column)?);
        let last = column.len() - 1;
        let cut = (EXTREME_QUANTILE * last as f64).ceil() as usize;
        low[axis] = *column.select_nth_unstable_by(cut, f64::total_cmp).1;
        high[axis] = *column.select_nth_unstable_by(last - cut, f64::total_cmp).1;
    }
    let half: [f64; D] = std::array::from_fn(|axis| 0.5 * (high[axis] - low[axis]));
    let largest = half.iter().copied().fold(0.0, f64::max);
    let reference_mgauss = reference_mgauss.unwrap_or(largest);
    if !(largest > 0.0 && reference_mgauss > 0.0 && largest.is_finite()) {
        return None;
    }
    let margin_mgauss = 4.0 * noise + 0.02 * largest;
    Some(Bounds {
        low,
        high,
        scale_min: half.map(|half| ((half - margin_mgauss).max(0.05 * largest)) / reference_mgauss),
        scale_max: half.map(|half| (2.2 * half).max(1.6 * largest) / reference_mgauss),
        margin_mgauss,
        reference_mgauss,
    })
}

/// Noise on one axis from second differences, in which smooth motion cancels: robust, one standard
/// deviation.
fn noise_of(values: &[f64]) -> Option<f64> {
    let mut second: Vec<f64> = values
        .windows(3)
        .map(|w| (w[0] - 2.0 * w[1] + w[2]).abs())
        .collect();
    Some(MEDIAN_TO_SD * median(&mut second)? / 6f64.sqrt())
}

/// Points that are not spikes: each axis within `SPIKE_SDS` robust deviations of the median of its five
/// neighbours (Hampel's filter), as section 4.2 suggests. The swarm's objective squares a square, and one
/// spike would outweigh a hundred samples.
pub fn without_spikes<const D: usize>(points: &[[f64; D]]) -> Vec<[f64; D]> {
    if points.len() < 5 {
        return points.to_vec();
    }
    let mut keep = vec![true; points.len()];
    let mut deviations = Vec::with_capacity(points.len());
    for axis in 0..D {
        deviations.clear();
        deviations.extend(points.iter().enumerate().map(|(i, point)| {
            let first = i.saturating_sub(2).min(points.len() - 5);
            let around: [f64; 5] = std::array::from_fn(|k| points[first + k][axis]);
            (point[axis] - median_of(around)).abs()
        }));
        let Some(typical) = median(&mut deviations.clone()) else {
            continue;
        };
        let limit = SPIKE_SDS * (MEDIAN_TO_SD * typical).max(LEAST_SD_MGAUSS);
        for (keep, deviation) in keep.iter_mut().zip(&deviations) {
            *keep &= *deviation <= limit;
        }
    }
    let kept = points.iter().zip(keep).filter(|(_, keep)| *keep);
    kept.map(|(point, _)| *point).collect()
}

/// Runs the swarm over points in their box with these settings, until it is `cancelled`. `None` if nothing in it has a fit value. F = 2·D + 1.
pub fn swarm<const D: usize, const P: usize, const F: usize>(
    points: &[[f64; D]],
    bounds: &Bounds<D>,
    settings: &Settings,
    cancelled: &AtomicBool,
) -> Option<SwarmResult<P>> {
    let reference_mgauss = bounds.reference_mgauss;
    let found = match settings.profile {
        Profile::Standard => {
            let normal = Normalizer::new(&bounds.low, &bounds.high);
            let objective = Factored::<D, F>::new(normal, points, reference_mgauss);
            let fit_value = |position: &_| objective.fit_value(position);
            search(bounds, settings, objective.conic(), fit_value, cancelled)
        }
        Profile::Paper => {
            let fit_value = |position: &_| direct(points, position, reference_mgauss);
            search(bounds, settings, None, fit_value, cancelled)
        }
    };
    found.fit_value.is_finite().then_some(found)
}

/// The linear least-squares conic, with a symmetric A, through points that are not spikes: where a refinement may start.
pub fn conic(points: &[[f64; 3]], reference_mgauss: f64) -> Option<ParameterVector<9>> {
    let seen = without_spikes(points);
    let bounds = bounds(&seen, Some(reference_mgauss))?;
    let normal = Normalizer::new(&bounds.low, &bounds.high);
    Factored::<3, 10>::new(normal, &seen, reference_mgauss).conic()
}

/// Refines from `start` and, without a given reference, brings the scale factors to a mean of 1: only
/// their product with Hm can be seen.
pub fn refine_and_normalize<const D: usize, const P: usize>(
    points: &[[f64; D]],
    start: &ParameterVector<P>,
    reference_mgauss: f64,
    reference_given: bool,
) -> Option<Refined<P>> {
    let mut refined = refine(points, start, reference_mgauss)?;
    if !reference_given {
        let mean = refined.position[D..2 * D].iter().sum::<f64>() / D as f64;
        refined.reference_mgauss *= mean;
        for scale in &mut refined.position[D..] {
            *scale /= mean;
        }
        let unit = |k: usize| if k < D { 1.0 } else { 1.0 / mean };
        let before = refined.covariance;
        let after = |row: usize, column: usize| unit(row) * before[(row, column)] * unit(column);
        refined.covariance = SMatrix::from_fn(after);
    }
    Some(refined)
}
