//! Judges an imported calibration by its numbers: could it have been accepted here?

use nalgebra::Vector2;

use super::super::model::{Calibration, Parameters};
use super::{Limits, Refusal};

/// The first objection to it. Its samples are not known, so that only its own numbers can be held against the limits.
///
/// # Errors
///
/// The first objection.
pub fn check(calibration: &Calibration, limits: &Limits) -> Result<(), Refusal> {
    let scale = match &calibration.parameters {
        Parameters::Planar(planar) => planar.scale,
        Parameters::Spatial(spatial) => {
            let values = spatial.matrix.singular_values();
            Vector2::new(values.min(), values.max())
        }
    };
    let ratio = scale.max() / scale.min();
    if ratio > limits.axis_ratio {
        return Err(Refusal::new(
            "axis_ratio",
            format!(
                "the scale factors differ by a factor of {ratio:.2} (at most {:.2}): is it of another chip?",
                limits.axis_ratio
            ),
        ));
    }
    let residual_share =
        calibration.residual_mgauss / (calibration.strength_mgauss * 0.5 * scale.sum());
    if residual_share > limits.residual_share {
        return Err(Refusal::new(
            "residual",
            format!(
                "its samples were spread about its fit by {:.1} % of the field (at most {:.1} %)",
                100.0 * residual_share,
                100.0 * limits.residual_share
            ),
        ));
    }
    // A covariance states how far to trust it, and the estimate starts from it.
    if calibration.covariance.is_none() && calibration.heading_sd_deg > limits.heading_sd_deg {
        return Err(Refusal::new(
            "heading_uncertainty",
            format!(
                "its headings are uncertain by {:.2} degrees (at most {:.2})",
                calibration.heading_sd_deg, limits.heading_sd_deg
            ),
        ));
    }
    Ok(())
}
