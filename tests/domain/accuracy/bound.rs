//! The Cramér–Rao bound of the field model: what no unbiased calibration can beat.
//!
//! Where on the curve a sample lies is unknown (the gyro's timing is not counted), so a sample tells of the
//! parameters only across the curve: along its normal n, with variance σ². The bound's matrix is the inverse of
//! Σ g gᵀ/σ², g the derivatives of the distance across by the parameters.

use std::f64::consts::TAU;

use nalgebra::{DMatrix, DVector, Vector3};

use super::cases::{Case, Log, Truth};

/// Headings of the held-out turn.
pub const HEADINGS: usize = 72;

/// Errors in the units that calibrations are compared in, or sums of their squares: bias, RMS over the axes, milligauss; scale
/// factor, RMS over the axes, as a share of the true one; heading over the held-out level turn, RMS, degrees.
pub type Errors = Vector3<f64>;

/// The bound for the log, as mean squares.
pub fn bound(case: &Case, log: &Log) -> Errors {
    let d = case.dimensions();
    let truth = &log.truth;
    let mut information = DMatrix::<f64>::zeros(2 * d, 2 * d);
    for field in &log.fields {
        // The normal in sensor space: A⁻¹h. g = n for a bias, nᵢhᵢ for a scale factor.
        let normal = DVector::from_fn(d, |k, _| field[k] / truth.scale[k]).normalize();
        let g = DVector::from_fn(2 * d, |k, _| {
            if k < d {
                normal[k]
            } else {
                normal[k - d] * field[k - d]
            }
        });
        information += &g * g.transpose();
    }
    let covariance = information.try_inverse().unwrap() * case.whole_sigma().powi(2);
    let (mut bias, mut scale, mut heading) = (0.0, 0.0, 0.0);
    for k in 0..d {
        bias += covariance[(k, k)] / d as f64;
        scale += covariance[(d + k, d + k)] / truth.scale[k].powi(2) / d as f64;
    }
    for (field, north) in level_turn(case) {
        // δψ = −(cos ψ δh_y + sin ψ δh_x)/H with δh = −δb/a − h·δa/a.
        let (sin, cos) = north.sin_cos();
        let horizontal = case.earth_field().x;
        let gradient = DVector::from_fn(2 * d, |k, _| {
            let axis = k % d;
            let across = [sin, cos, 0.0][axis] / horizontal / truth.scale[axis];
            if k < d { across } else { across * field[axis] }
        });
        heading += (gradient.transpose() * &covariance * &gradient)[0] / HEADINGS as f64;
    }
    Errors::new(bias, scale, heading * 1f64.to_degrees().powi(2))
}

/// A noise-free level turn: the field in body axes, and the heading, radians.
pub fn level_turn(case: &Case) -> impl Iterator<Item = (Vector3<f64>, f64)> {
    let earth = case.earth_field();
    (0..HEADINGS).map(move |k| {
        let heading = TAU * k as f64 / HEADINGS as f64;
        let (sin, cos) = heading.sin_cos();
        (
            Vector3::new(earth.x * cos, -earth.x * sin, -earth.z),
            heading,
        )
    })
}

/// What the sensor makes of a field, without noise.
pub fn raw(truth: &Truth, field: &Vector3<f64>) -> Vector3<f64> {
    field.component_mul(&truth.scale) + truth.bias
}
