//! The sensor model of Equation 1, B = A·H + b, and its inverse, Equation 3.

use nalgebra::{Matrix3, Rotation3, SMatrix, SVector, Vector2, Vector3};
use serde::{Deserialize, Serialize};

use crate::check::words;

words! {
    /// What a calibration corrects.
    pub enum Mode {
        /// The plane of one turn: two biases, two scale factors.
        Planar = "planar",
        /// All three axes.
        Spatial = "spatial",
    }
}

/// The shape of the scale factor matrix A.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Model {
    /// A scale factor an axis: the paper's model.
    Diagonal,
    /// A symmetric A: soft iron and cross-coupling too.
    Symmetric,
    /// A full A: the rotation between the chips as well. Only motion shows it.
    General,
}

/// The parameters of Equation 1.
///
/// Everything is in magnetometer chip axes and milligauss. Scale factors have a mean of 1 where no
/// reference field was given: then only the ratio of the axes is known, which is all that a heading needs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "mode", rename_all = "lowercase")]
pub enum Parameters {
    /// Parameters in the plane of one turn.
    Planar(Planar),
    /// Parameters of all three axes.
    Spatial(Spatial),
}

/// The plane of a turn and the parameters in it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Planar {
    /// Two perpendicular unit vectors in chip axes that span the plane.
    pub basis: [Vector3<f64>; 2],
    /// b, along the basis.
    pub bias_mgauss: Vector2<f64>,
    /// The diagonal of A, along the basis.
    pub scale: Vector2<f64>,
    /// Mean of the unit vector that pointed down during the turn, along the basis; 0 if it was not known. A
    /// board tilted like this is level to this calibration.
    #[serde(default)]
    pub level: Vector2<f64>,
}

/// The parameters of all three axes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Spatial {
    /// The shape of A.
    pub model: Model,
    /// b.
    pub bias_mgauss: Vector3<f64>,
    /// A. A calibration file has it column by column.
    pub matrix: Matrix3<f64>,
}

impl Planar {
    /// The sample's components along the basis, uncorrected.
    pub fn project(&self, raw_mgauss: &Vector3<f64>) -> Vector2<f64> {
        Vector2::new(self.basis[0].dot(raw_mgauss), self.basis[1].dot(raw_mgauss))
    }

    /// Equation 3 in the plane: components along the basis.
    pub fn correct(&self, raw_mgauss: &Vector3<f64>) -> Vector2<f64> {
        (self.project(raw_mgauss) - self.bias_mgauss).component_div(&self.scale)
    }

    /// The plane's normal, chip axes: the first basis vector × the second.
    pub fn normal(&self) -> Vector3<f64> {
        self.basis[0].cross(&self.basis[1])
    }
}

impl Spatial {
    /// A diagonal A.
    pub fn diagonal(bias_mgauss: Vector3<f64>, scale: Vector3<f64>) -> Self {
        Self {
            model: Model::Diagonal,
            bias_mgauss,
            matrix: Matrix3::from_diagonal(&scale),
        }
    }

    /// The rotation in A, a rotation vector in radians: A = P·Q with a symmetric P, from the gyro's axes to the
    /// magnetometer's. `None` for models without one.
    pub fn alignment_rad(&self) -> Option<Vector3<f64>> {
        if self.model != Model::General {
            return None;
        }
        let svd = self.matrix.svd(true, true);
        let rotation = svd.u? * svd.v_t?;
        Some(Rotation3::from_matrix_unchecked(rotation).scaled_axis())
    }

    /// Equation 3; `None` if A cannot be inverted.
    pub fn correct(&self, raw_mgauss: &Vector3<f64>) -> Option<Vector3<f64>> {
        Some(self.matrix.try_inverse()? * (raw_mgauss - self.bias_mgauss))
    }
}

/// A calibration as it is kept and used: parameters, and how good they were found to be.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Calibration {
    /// What corrects a sample.
    #[serde(flatten)]
    pub parameters: Parameters,
    /// The reference field that the scales refer to, if one was given.
    pub reference_mgauss: Option<f64>,
    /// Strength that the corrected field has in an undisturbed place, milligauss (planar: in its plane).
    pub strength_mgauss: f64,
    /// Spread of the samples about the fit, one standard deviation, milligauss.
    pub residual_mgauss: f64,
    /// One standard deviation of a heading, from the parameters' uncertainty and one sample's noise, degrees.
    pub heading_sd_deg: f64,
    /// Covariance of b and of A, where the estimate that learnt them knows it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub covariance: Option<PackedCovariance>,
    /// Bias of the gyro when this was learnt, gyro chip axes, degrees per second: a start expects about the same.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gyro_bias_deg_s: Option<Vector3<f64>>,
    /// Bias that was taken out of the accelerometer's readings when this was learnt, accelerometer chip axes, m/s²: the parameters are
    /// right only with the tilt that results.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub accel_bias_m_s2: Option<Vector3<f64>>,
}

/// Covariance of b (milligauss) and of the entries of A, row by row: the upper triangle of a 12×12 matrix, column by
/// column.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct PackedCovariance(SVector<f64, 78>);

impl PackedCovariance {
    /// Keeps the upper triangle.
    pub fn packed(full: &SMatrix<f64, 12, 12>) -> Self {
        let upper = (0..12).flat_map(|column| (0..=column).map(move |row| (row, column)));
        Self(SVector::from_iterator(upper.map(|at| full[at])))
    }

    /// The whole matrix.
    pub fn unpacked(&self) -> SMatrix<f64, 12, 12> {
        SMatrix::from_fn(|row, column| {
            let (low, high) = (row.min(column), row.max(column));
            self.0[high * (high + 1) / 2 + low]
        })
    }

    /// Whether it can be one: finite, no variance negative, and no correlation beyond 1.
    pub fn is_plausible(&self) -> bool {
        // Rounding may take a correlation that is 1 a little further.
        const ROUNDING: f64 = 1.001;
        let full = self.unpacked();
        let variances = full.diagonal();
        let related = |row: usize, column: usize| {
            full[(row, column)].powi(2) <= ROUNDING * variances[row] * variances[column]
        };
        self.0.iter().all(|value| value.is_finite())
            && variances.min() >= 0.0
            && (0..12).all(|row| (0..row).all(|column| related(row, column)))
    }
}

impl Calibration {
    /// A calibration of which no more is known.
    pub fn of(
        parameters: Parameters,
        strength_mgauss: f64,
        residual_mgauss: f64,
        heading_sd_deg: f64,
    ) -> Self {
        Self {
            parameters,
            reference_mgauss: None,
            strength_mgauss,
            residual_mgauss,
            heading_sd_deg,
            covariance: None,
            gyro_bias_deg_s: None,
            accel_bias_m_s2: None,
        }
    }

    /// How it was made: `turn`, from a full turn, or `motion`, by the running estimate, which alone knows a covariance.
    pub fn method(&self) -> &'static str {
        match self.covariance {
            Some(_) => "motion",
            None => "turn",
        }
    }
}

impl Parameters {
    /// Planar or spatial.
    pub fn mode(&self) -> Mode {
        match self {
            Self::Planar(_) => Mode::Planar,
            Self::Spatial(_) => Mode::Spatial,
        }
    }

    /// The corrected field in chip axes. Under a planar calibration it lies in the plane: the part
    /// across it was never measured. `None` if A cannot be inverted.
    pub fn correct(&self, raw_mgauss: &Vector3<f64>) -> Option<Vector3<f64>> {
        match self {
            Self::Planar(planar) => {
                let h = planar.correct(raw_mgauss);
                Some(planar.basis[0] * h.x + planar.basis[1] * h.y)
            }
            Self::Spatial(spatial) => spatial.correct(raw_mgauss),
        }
    }
}
