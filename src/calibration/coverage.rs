//! From how many sides the samples have seen the field.

use nalgebra::{Matrix3, SVector, SymmetricEigen};

/// How much of the circle directions cover: 360 degrees less what lies in gaps wider than 15 degrees.
pub fn coverage_deg<const D: usize>(directions: &[SVector<f64, D>]) -> f64 {
    const GAP_DEG: f64 = 15.0;
    let angle = |u: &SVector<f64, D>| u[1].atan2(u[0]).to_degrees();
    let mut angles: Vec<f64> = directions.iter().map(angle).collect();
    angles.sort_unstable_by(f64::total_cmp);
    let (Some(first), Some(last)) = (angles.first(), angles.last()) else {
        return 0.0;
    };
    let around = 360.0 - (last - first);
    let gaps = angles.windows(2).map(|two| two[1] - two[0]).chain([around]);
    360.0 - gaps.filter(|&gap| gap > GAP_DEG).sum::<f64>()
}

/// Smallest eigenvalue of the directions' covariance: 1/3 where all directions are alike frequent, 0
/// where they lie in a plane or on a cone.
pub fn direction_spread<const D: usize>(directions: &[SVector<f64, D>]) -> f64 {
    let n = directions.len().max(1) as f64;
    let mean = directions.iter().sum::<SVector<f64, D>>() / n;
    let mut covariance = Matrix3::<f64>::zeros();
    for u in directions {
        for row in 0..D {
            for column in 0..D {
                covariance[(row, column)] += (u[row] - mean[row]) * (u[column] - mean[column]) / n;
            }
        }
    }
    SymmetricEigen::new(covariance).eigenvalues.min()
}

/// From the lowest to the highest of these values.
pub fn span(values: impl Iterator<Item = f64> + Clone) -> f64 {
    values.clone().fold(f64::MIN, f64::max) - values.fold(f64::MAX, f64::min)
}

/// The largest span of the points on an axis.
pub fn swing<const D: usize>(points: &[[f64; D]]) -> f64 {
    let spans = (0..D).map(|axis| span(points.iter().map(|point| point[axis])));
    spans.fold(0.0, f64::max)
}

/// Whether the centre lies within the samples on every axis.
pub fn centre_inside<const D: usize>(points: &[[f64; D]], position: &[f64]) -> bool {
    (0..D).all(|axis| {
        points.iter().any(|point| point[axis] <= position[axis])
            && points.iter().any(|point| point[axis] >= position[axis])
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Vector2, Vector3};

    fn arc(from_deg: i32, to_deg: i32) -> Vec<Vector2<f64>> {
        (from_deg..=to_deg)
            .map(|angle| f64::from(angle).to_radians().sin_cos())
            .map(|(sin, cos)| Vector2::new(cos, sin))
            .collect()
    }

    #[test]
    fn gaps_count_against_the_coverage_wherever_they_lie() {
        assert!((coverage_deg(&arc(0, 359)) - 360.0).abs() < 1e-9);
        assert!((coverage_deg(&arc(0, 270)) - 270.0).abs() < 1e-9);
        assert!((coverage_deg(&arc(100, 370)) - 270.0).abs() < 1e-9);
        let parts = [arc(0, 100), arc(120, 300)].concat();
        assert!((coverage_deg(&parts) - 280.0).abs() < 1e-9);
        assert_eq!(coverage_deg::<2>(&[]), 0.0);
    }

    #[test]
    fn a_level_turn_has_no_spread_across_its_plane_and_a_sphere_a_third() {
        let level: Vec<Vector3<f64>> = arc(0, 359)
            .iter()
            .map(|u| u.push(1.0).normalize())
            .collect();
        assert!(direction_spread(&level).abs() < 1e-9);
        let sphere: Vec<Vector3<f64>> = (0..3)
            .flat_map(|axis| [Vector3::ith(axis, 1.0), Vector3::ith(axis, -1.0)])
            .collect();
        assert!((direction_spread(&sphere) - 1.0 / 3.0).abs() < 1e-9);
    }

    #[test]
    fn a_centre_beside_the_samples_is_outside() {
        let points = [[0.0, 0.0], [2.0, 0.0], [1.0, 1.0]];
        assert!(centre_inside(&points, &[1.0, 0.5]));
        assert!(!centre_inside(&points, &[3.0, 0.5]));
    }
}
