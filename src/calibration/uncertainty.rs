//! How certain headings are, predicted from how certain the parameters are.

use nalgebra::{SMatrix, SVector, Vector3};

use super::curve::Curve;
use super::model::Mode;
use crate::frame::{Mounting, variance_along};

/// Headings that the prediction is averaged over.
const HEADINGS: usize = 36;

/// One standard deviation of a level board's heading, RMS over all headings, degrees, from the
/// parameters' covariance. `mounting` and `dip_rad` matter in space only: a plane has its own axes.
pub fn heading_sd_deg<const D: usize, const P: usize>(
    mode: Mode,
    mounting: &Mounting,
    curve: &Curve<D, P>,
    covariance: &SMatrix<f64, P, P>,
    dip_rad: f64,
) -> f64 {
    let mut variance = 0.0;
    for k in 0..HEADINGS {
        let (sin, cos) = (std::f64::consts::TAU * k as f64 / HEADINGS as f64).sin_cos();
        // The field of strength 1 along the calibrated axes, and how its azimuth changes with them.
        let (h, azimuth): (SVector<f64, D>, SVector<f64, D>) = match mode {
            Mode::Planar => (
                SVector::from_column_slice(&[cos, sin]),
                SVector::from_column_slice(&[-sin, cos]),
            ),
            Mode::Spatial => {
                let level = Vector3::new(cos, -sin, dip_rad.tan()) * dip_rad.cos();
                let across = Vector3::new(sin, cos, 0.0) / dip_rad.cos();
                let (h, across) = (mounting.to_chip(level), mounting.to_chip(across));
                (
                    SVector::from_column_slice(h.as_slice()),
                    SVector::from_column_slice(across.as_slice()),
                )
            }
        };
        let gradient = curve.azimuth(&h, &azimuth);
        variance += variance_along(covariance, &gradient) / HEADINGS as f64;
    }
    variance.max(0.0).sqrt().to_degrees()
}

/// How many samples one independent sample takes: 1 for white noise, more where the residuals are those
/// of a model that does not quite fit. Their autocorrelation, summed up to where it is lost in noise
/// (Geyer's initial sequence, Statistical Science 7, 1992).
pub fn correlation_length(residuals: &[f64]) -> f64 {
    let variance: f64 = residuals.iter().map(|e| e * e).sum();
    let noise = 2.0 / (residuals.len() as f64).sqrt();
    let mut sum = 1.0;
    for lag in 1..residuals.len() / 4 {
        let products = residuals.iter().zip(&residuals[lag..]).map(|(a, b)| a * b);
        let correlation = products.sum::<f64>() / variance;
        if correlation < noise || correlation.is_nan() {
            break;
        }
        sum += 2.0 * correlation;
    }
    sum
}
