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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::model::Planar;
    use nalgebra::Vector3;

    #[test]
    fn what_no_turn_here_would_have_given_is_refused() {
        let good = Calibration {
            parameters: Parameters::Planar(Planar {
                basis: [Vector3::x(), Vector3::y()],
                bias_mgauss: Vector2::new(50.0, 60.0),
                scale: Vector2::new(0.9, 1.1),
                level: Vector2::zeros(),
            }),
            reference_mgauss: None,
            strength_mgauss: 163.0,
            residual_mgauss: 2.0,
            heading_sd_deg: 0.1,
            covariance: None,
            gyro_bias_deg_s: None,
            accel_bias_m_s2: None,
        };
        let limits = Limits::default();
        assert_eq!(check(&good, &limits), Ok(()));
        let mut squashed = good;
        if let Parameters::Planar(planar) = &mut squashed.parameters {
            planar.scale.x = 0.4;
        }
        for (calibration, reason) in [
            (squashed, "axis_ratio"),
            (
                Calibration {
                    residual_mgauss: 20.0,
                    ..good
                },
                "residual",
            ),
            (
                Calibration {
                    heading_sd_deg: 2.0,
                    ..good
                },
                "heading_uncertainty",
            ),
        ] {
            assert_eq!(check(&calibration, &limits).unwrap_err().reason, reason);
        }
    }
}
