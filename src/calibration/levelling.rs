//! Levels the samples of a turn that was not quite level: a tilt mixes the vertical field into the plane of a planar
//! calibration.
//!
//! At a dip of 70° a tilt of 5° moves a sample by a quarter of the horizontal field. Gyro and
//! accelerometer know the tilt; the strength of the vertical field is a fifth parameter, estimated from
//! the same samples. Tilts are taken from their mean, so a turn that was level, or evenly tilted, is
//! left as it is. The fit still uses raw samples only: no earlier calibration enters.

use super::curve::{Curve, Distance, ParameterVector};
use super::refine::Refined;

/// Tilts that vary by less than this are noise of the accelerometer, radians RMS.
const LEAST_TILT_RAD: f64 = 0.005;

/// The mean of `down` (unit vectors, along the calibrated axes) where it is known; 0 if it never is.
pub fn mean<const D: usize>(down: &[Option<[f64; D]>]) -> [f64; D] {
    let n = down.iter().flatten().count().max(1) as f64;
    std::array::from_fn(|axis| down.iter().flatten().map(|d| d[axis]).sum::<f64>() / n)
}

/// The part of `down` that differs from its mean, 0 where it is unknown; `None` if it hardly differs.
pub fn uneven_tilt<const D: usize>(
    down: &[Option<[f64; D]>],
    mean: [f64; D],
) -> Option<Vec<[f64; D]>> {
    let off = |d: [f64; D]| std::array::from_fn(|axis| d[axis] - mean[axis]);
    let tilt: Vec<[f64; D]> = down.iter().map(|d| d.map_or([0.0; D], off)).collect();
    let squares: f64 = tilt.iter().flatten().map(|d| d * d).sum();
    let n = down.iter().flatten().count().max(1) as f64;
    ((squares / n).sqrt() > LEAST_TILT_RAD).then_some(tilt)
}

/// Correction to the assumed vertical field that explains the residuals best, milligauss.
pub fn vertical_mgauss<const D: usize, const P: usize>(
    points: &[[f64; D]],
    tilt: &[[f64; D]],
    fitted: &Refined<P>,
) -> f64 {
    let curve = Curve::<D, P>::new(&fitted.position, fitted.reference_mgauss);
    let Some(curve) = curve else {
        return 0.0;
    };
    let (mut xx, mut xe) = (1e-12, 0.0);
    for (point, tilt) in points.iter().zip(tilt) {
        let off: Distance<P> = curve.distance(point);
        if off.value_mgauss.abs() >= fitted.cutoff_mgauss {
            continue;
        }
        let mut x = 0.0;
        for axis in 0..D {
            x -= off.derivatives[axis] * fitted.position[D + axis] * tilt[axis];
        }
        xx += x * x;
        xe += x * off.value_mgauss;
    }
    xe / xx
}

/// Samples as a level board would have seen them.
pub fn levelled<const D: usize, const P: usize>(
    points: &[[f64; D]],
    tilt: &[[f64; D]],
    position: &ParameterVector<P>,
    vertical_mgauss: f64,
) -> Vec<[f64; D]> {
    let level = |(point, tilt): (&[f64; D], &[f64; D])| {
        std::array::from_fn(|axis| point[axis] - position[D + axis] * vertical_mgauss * tilt[axis])
    };
    points.iter().zip(tilt).map(level).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::refine::refine;

    fn refine2(points: &[[f64; 2]], start: &[f64; 4]) -> Refined<4> {
        refine(points, start, 163.0).unwrap()
    }

    #[test]
    fn an_even_tilt_is_no_tilt() {
        for down in [&[Some([0.1, -0.05]); 50][..], &[], &[None; 9]] {
            assert_eq!(uneven_tilt(down, mean(down)), None);
        }
    }

    #[test]
    fn the_vertical_field_is_found_and_taken_out() {
        let truth = [20.0, -30.0, 0.95, 1.05];
        let (horizontal, vertical) = (163.0, 527.0);
        let down: Vec<[f64; 2]> = (0..600)
            .map(|i| {
                let t = f64::from(i) * 0.05;
                [0.05 * (1.3 * t).sin(), 0.08 * (0.7 * t).cos()]
            })
            .collect();
        let points: Vec<[f64; 2]> = down
            .iter()
            .enumerate()
            .map(|(i, down)| {
                let (sin, cos) = (i as f64 * 0.021).sin_cos();
                let h = [
                    horizontal * cos + vertical * down[0],
                    horizontal * sin + vertical * down[1],
                ];
                std::array::from_fn(|k| truth[2 + k] * h[k] + truth[k])
            })
            .collect();
        let down: Vec<_> = down.into_iter().map(Some).collect();
        let tilt = uneven_tilt(&down, mean(&down)).unwrap();
        let mut fitted = refine2(&points, &truth);
        let before = fitted.residual_mgauss;
        let mut found = 0.0;
        let mut level = points.clone();
        for _ in 0..10 {
            found += vertical_mgauss(&level, &tilt, &fitted);
            level = levelled(&points, &tilt, &fitted.position, found);
            fitted = refine2(&level, &fitted.position);
        }
        assert!((found - vertical).abs() < 5.0, "{found}");
        assert!(
            fitted.residual_mgauss < 0.1 * before,
            "{before} {}",
            fitted.residual_mgauss
        );
    }
}
