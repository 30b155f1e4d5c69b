//! What a filter starts from: nothing, or a calibration.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use crate::calibration::model::{Calibration, Model, Parameters};
use crate::frame::{Mounting, put, rows};

/// Strength of the earth's field where nothing else is known, that of northern mid-latitudes; anywhere it is 220 to 670 mG.
pub(super) const FIELD_MGAUSS: f64 = 500.0;
/// Hard iron to expect, on an axis, as a share of the field.
pub(super) const IRON: f64 = 3.0;
/// Deviation of D's entries on the diagonal: scale factors (data sheets: 5 %) and soft iron (15 % at most).
pub(super) const SCALE: f64 = 0.08;
/// Deviation of the other entries by soft iron.
const SKEW: f64 = 0.02;
/// Deviation of the rotation between the chips about each axis, radians: any angle up to 5°, in any direction.
pub(super) const ROTATION_RAD: f64 = 0.029;
/// White noise of a sample, milligauss, until it is measured: an HMC5843's resolution.
const NOISE_MGAUSS: f64 = 7.0;
/// Unevenness of usual places, as a share of the field: rooms have 1 to 2 % over half a metre. More than that while the board turns
/// means that iron has come onto the board to stay. The place of a turn may put its result off by as much as this.
pub(super) const USUAL_UNEVENNESS: f64 = 0.015;

/// Standard deviation of the entries beside the diagonal where a fit to a sphere took them for 0.
const GUESSED: f64 = 0.015;

/// Covariance of the bias and of the matrix, row by row.
pub(super) type ParameterCovariance = SMatrix<f64, 12, 12>;

/// Something that a turn has measured: a weighted sum of parameters.
#[derive(Clone, Debug)]
pub(super) struct Measured {
    /// Weights of the bias, body axes.
    pub(super) bias: Vector3<f64>,
    /// Weights of the entries of D − I; their trace is 0.
    pub(super) matrix: Matrix3<f64>,
    /// Weight of the field's upward part in the frame.
    pub(super) up: f64,
    /// Normal of the plane of a level turn, body axes. The field along it is constant during the turn, so D shifts the centre of the
    /// circle by a share of that field, and the fit measures this shift together with the bias.
    pub(super) across: Option<Vector3<f64>>,
    /// What the sum is, and its variance.
    pub(super) value: f64,
    pub(super) variance: f64,
    /// Variance that is added along these parameters before the turn's result is learnt, so that the result outweighs what the filter
    /// knew.
    pub(super) inflation: f64,
}

/// Bias, matrix and their covariance to start from.
#[derive(Clone, Debug)]
pub(super) struct Prior {
    /// b, body axes, milligauss.
    pub(super) bias_mgauss: Vector3<f64>,
    /// D, its trace 3.
    pub(super) matrix: Matrix3<f64>,
    pub(super) covariance: ParameterCovariance,
    /// That of a calibration which states a covariance.
    pub(super) strength_mgauss: Option<f64>,
    /// Strength of the field in which a spatial calibration was made.
    pub(super) made_in_mgauss: Option<f64>,
    /// White noise of a sample at first, milligauss.
    pub(super) noise_mgauss: f64,
    /// Told to the filter once it has a field.
    pub(super) measured: Vec<Measured>,
}

impl Prior {
    /// Nothing is known but what boards are like.
    pub(super) fn unknown() -> Self {
        let entries = SMatrix::<f64, 9, 9>::from_fn(|one, other| {
            // Soft iron adds the same to an entry and to the one across the diagonal, and rotation the opposite.
            let across = 3 * (one % 3) + one / 3;
            match (other == one, other == across) {
                (true, true) => SCALE.powi(2),
                (true, false) => SKEW.powi(2) + ROTATION_RAD.powi(2),
                (false, true) => SKEW.powi(2) - ROTATION_RAD.powi(2),
                (false, false) => 0.0,
            }
        });
        let held = without_trace();
        let mut covariance = ParameterCovariance::zeros();
        let iron = Matrix3::identity() * (IRON * FIELD_MGAUSS).powi(2);
        put(&mut covariance, (0, 0), &iron);
        put(&mut covariance, (3, 3), &(held * entries * held));
        Self {
            bias_mgauss: Vector3::zeros(),
            matrix: Matrix3::identity(),
            covariance,
            strength_mgauss: None,
            made_in_mgauss: None,
            noise_mgauss: NOISE_MGAUSS,
            measured: Vec::new(),
        }
    }

    /// What a calibration says of a magnetometer mounted like this.
    pub(super) fn of(calibration: &Calibration, mounting: &Mounting) -> Self {
        let unknown = Self {
            noise_mgauss: calibration.residual_mgauss,
            made_in_mgauss: matches!(calibration.parameters, Parameters::Spatial(_))
                .then_some(calibration.strength_mgauss),
            ..Self::unknown()
        };
        // Only the estimate states a covariance, and its calibrations are spatial.
        let (Parameters::Spatial(spatial), Some(covariance)) =
            (&calibration.parameters, &calibration.covariance)
        else {
            return Self {
                measured: Measured::by(calibration, mounting),
                ..unknown
            };
        };
        let to_body = mounting.rotation();
        let turn = parameter_rotation(&to_body);
        let matrix = to_body * spatial.matrix * to_body.transpose();
        Self {
            bias_mgauss: mounting.to_body(spatial.bias_mgauss),
            matrix,
            covariance: turn * covariance.unpacked() * turn.transpose(),
            strength_mgauss: Some(calibration.strength_mgauss),
            ..unknown
        }
    }
}

impl Measured {
    /// Weights of the bias and of D, row by row.
    pub(super) fn weights(&self) -> SVector<f64, 12> {
        let mut weights = SVector::<f64, 12>::zeros();
        put(&mut weights, (0, 0), &self.bias);
        put(&mut weights, (3, 0), &rows(&self.matrix));
        weights
    }

    /// What the fit to a turn has measured, and nothing beyond it.
    pub(super) fn by(calibration: &Calibration, mounting: &Mounting) -> Vec<Self> {
        let strength = calibration.strength_mgauss;
        // A heading's uncertainty is the bias's over the field, in two directions.
        let fitted = calibration.heading_sd_deg.to_radians() * strength;
        let place = USUAL_UNEVENNESS * FIELD_MGAUSS.max(strength);
        let bias_variance = 0.5 * fitted * fitted + place * place;
        let matrix_variance = bias_variance / (strength * strength);
        let mut all = Vec::new();
        let mut bias = |axis: Vector3<f64>, up: f64, across: Option<Vector3<f64>>, value: f64| {
            all.push(Self {
                bias: axis,
                matrix: Matrix3::zeros(),
                up,
                across,
                value,
                variance: bias_variance,
                inflation: (IRON * FIELD_MGAUSS).powi(2),
            });
        };
        let mut entries = Vec::new();
        match &calibration.parameters {
            Parameters::Planar(planar) => {
                let axes = planar.basis.map(|axis| mounting.to_body(axis));
                let across = axes[0].cross(&axes[1]);
                for (index, axis) in axes.iter().enumerate() {
                    // The circle's centre has the vertical field in it, as far as the plane was tilted.
                    bias(
                        *axis,
                        -planar.level[index],
                        Some(across),
                        planar.bias_mgauss[index],
                    );
                }
                let mean = 0.5 * planar.scale.sum();
                let difference = axes[0] * axes[0].transpose() - axes[1] * axes[1].transpose();
                entries.push((difference, (planar.scale[0] - planar.scale[1]) / mean, 0.0));
            }
            Parameters::Spatial(spatial) => {
                let to_body = mounting.rotation();
                let centre = mounting.to_body(spatial.bias_mgauss);
                let matrix = to_body * spatial.matrix * to_body.transpose();
                let matrix = matrix * (3.0 / matrix.trace());
                for axis in 0..3 {
                    bias(Vector3::ith(axis, 1.0), 0.0, None, centre[axis]);
                }
                for row in 0..3 {
                    for column in row..3 {
                        let guessed = row != column && spatial.model == Model::Diagonal;
                        // A fit to a sphere does not see a rotation: the mean of both entries is all that it says.
                        let mut weights = Matrix3::zeros();
                        weights[(row, column)] += 0.5;
                        weights[(column, row)] += 0.5;
                        let value = 0.5 * (matrix[(row, column)] + matrix[(column, row)]);
                        entries.push((weights, value, if guessed { GUESSED } else { 0.0 }));
                    }
                }
            }
        }
        all.extend(entries.into_iter().map(|(matrix, value, guess)| Self {
            bias: Vector3::zeros(),
            // D's trace is held, and the state has D − I.
            matrix: matrix - Matrix3::identity() * (matrix.trace() / 3.0),
            up: 0.0,
            across: None,
            value: value - matrix.trace(),
            variance: matrix_variance + guess * guess,
            inflation: SCALE * SCALE,
        }));
        all
    }
}

/// Takes the trace out of D's entries, row by row: I − d dᵀ / 3, where d has the entries of the identity.
fn without_trace() -> SMatrix<f64, 9, 9> {
    let diagonal = rows(&Matrix3::identity());
    SMatrix::identity() - diagonal * diagonal.transpose() / 3.0
}

/// Turns bias and matrix, row by row, from one frame into another: b into Q b, D into Q D Qᵀ.
pub(super) fn parameter_rotation(rotation: &Matrix3<f64>) -> ParameterCovariance {
    let mut turn = ParameterCovariance::zeros();
    put(&mut turn, (0, 0), rotation);
    put(&mut turn, (3, 3), &rotation.kronecker(rotation));
    turn
}
