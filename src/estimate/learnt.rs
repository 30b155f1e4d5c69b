//! What the estimate has learnt, as a calibration to keep, and what it has yet to learn.

use nalgebra::Vector3;

use super::{Estimate, prior};
use crate::calibration::model::{Calibration, Model, PackedCovariance, Parameters, Spatial};

impl Estimate {
    /// The rotation that would reduce the iron's uncertainty most.
    pub fn motion_wanted(&self) -> &'static str {
        // Turning about an axis shows the iron across it.
        let unknown = self.active.least_known().map(f64::abs);
        match unknown.imax() {
            2 => "roll or pitch it",
            _ => "turn it about the vertical",
        }
    }

    /// The gyro's bias as attitude and estimate have found it, body axes, rad/s, and its variance on each axis; `None` before the estimate has
    /// begun, and while the gyro is wrong.
    pub fn gyro_bias(&self) -> Option<(Vector3<f64>, Vector3<f64>)> {
        let (left, variance) = self.active.gyro_bias();
        let known = self.active.begun && self.gyro.fault().is_none();
        let removed = self.gyro_bias.filter(|_| known)?.rad_s;
        Some((removed + left, variance))
    }

    /// What is known now, as a calibration to keep; `None` before the estimate has begun.
    pub fn calibration(&self) -> Option<Calibration> {
        if !self.active.begun {
            return None;
        }
        let to_chip = self.mounting.rotation().transpose();
        let turn = prior::parameter_rotation(&to_chip);
        let covariance = turn * self.active.parameter_covariance() * turn.transpose();
        Some(Calibration {
            parameters: Parameters::Spatial(Spatial {
                model: Model::General,
                bias_mgauss: self.mounting.to_chip(self.active.bias_mgauss()),
                matrix: to_chip * self.active.matrix() * to_chip.transpose(),
            }),
            reference_mgauss: None,
            strength_mgauss: self.active.strength_mgauss(),
            residual_mgauss: self.active.noise_mgauss(),
            heading_sd_deg: self.north_sd_deg(),
            covariance: Some(PackedCovariance::packed(&covariance)),
            gyro_bias_deg_s: None,
            accel_bias_m_s2: None,
        })
    }
}
