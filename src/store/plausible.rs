//! Whether a calibration's numbers can be a calibration's: what finds damage in a file.

use std::ops::RangeInclusive;

use nalgebra::{Matrix3, Vector3};
use serde_json::Value;

use crate::calibration::model::{
    Calibration, Mode, Model, PackedCovariance, Parameters, Planar, Spatial,
};
use crate::check::{Fault, within};

/// How far from exact a basis or a matrix may be.
const TOLERANCE: f64 = 1e-6;

/// For a file that the deserialiser has refused: names the first value of a calibration that should be a number and is none. `path` is
/// that of `value`.
pub(super) fn no_number(path: &str, value: &Value) -> Option<String> {
    match value {
        Value::Object(values) => values
            .iter()
            .find_map(|(key, value)| no_number(&format!("{path}.{key}"), value)),
        Value::Array(values) => (0..)
            .zip(values)
            .find_map(|(index, value)| no_number(&format!("{path}[{index}]"), value)),
        Value::Number(_) => None,
        _ if !path.contains(".calibration.") => None,
        // These are words, and the last need not be known.
        Value::String(_) if path.ends_with(".mode") || path.ends_with(".model") => None,
        Value::Null if path.ends_with(".reference_mgauss") => None,
        other => {
            let path = path.trim_start_matches('.');
            Some(format!("{path} is {other}, but must be a number"))
        }
    }
}

/// What no calibration can have. The ranges are far wider than any sensor's: they are there to find
/// damage, not to judge.
pub(super) fn faults(calibration: &Calibration) -> Vec<Fault> {
    const STRENGTH: RangeInclusive<f64> = 0.1..=1e5;
    const BIAS: RangeInclusive<f64> = -1e5..=1e5;
    let mut faults = Vec::new();
    let mut check = |key: &str, values: &[f64], range: RangeInclusive<f64>| {
        for (index, value) in values.iter().enumerate() {
            let key = match values.len() {
                1 => format!("calibration.{key}"),
                _ => format!("calibration.{key}[{index}]"),
            };
            within(&mut faults, &key, *value, range.clone(), "");
        }
    };
    let of = calibration;
    check("reference_mgauss", of.reference_mgauss.as_slice(), STRENGTH);
    check("strength_mgauss", &[of.strength_mgauss], STRENGTH);
    check("residual_mgauss", &[of.residual_mgauss], 0.0..=1e5);
    check("heading_sd_deg", &[of.heading_sd_deg], 0.0..=180.0);
    if let Some(bias) = &of.gyro_bias_deg_s {
        check("gyro_bias_deg_s", bias.as_slice(), -60.0..=60.0);
    }
    if let Some(bias) = &of.accel_bias_m_s2 {
        check("accel_bias_m_s2", bias.as_slice(), -5.0..=5.0);
    }
    match &of.parameters {
        Parameters::Planar(planar) => {
            check("bias_mgauss", planar.bias_mgauss.as_slice(), BIAS);
            check("scale", planar.scale.as_slice(), 0.01..=100.0);
            faults.extend(planar_fault(planar));
        }
        Parameters::Spatial(spatial) => {
            check("bias_mgauss", spatial.bias_mgauss.as_slice(), BIAS);
            faults.extend(matrix_fault(spatial));
        }
    }
    let possible = |covariance: &PackedCovariance| {
        of.parameters.mode() == Mode::Spatial && covariance.is_plausible()
    };
    if !of.covariance.as_ref().is_none_or(possible) {
        let right = "left out, or one of a spatial calibration: finite, with no variance below 0 and no correlation beyond 1";
        faults.push(Fault::new("calibration.covariance", "no covariance", right));
    }
    faults
}

fn planar_fault(planar: &Planar) -> Option<Fault> {
    let [x, y] = &planar.basis;
    let off = [x.norm_squared() - 1.0, y.norm_squared() - 1.0, x.dot(y)];
    // NaN is off too.
    if !off.iter().all(|off| off.abs() <= TOLERANCE) {
        let found = format!("{:?}", [x.as_slice(), y.as_slice()]);
        let right = "two perpendicular unit vectors";
        return Some(Fault::new("calibration.basis", found, right));
    }
    // The part of a unit vector's mean that lies in the plane.
    let fits = (0.0..=1.0 + TOLERANCE).contains(&planar.level.norm());
    let found = format!("{:?}", planar.level.as_slice());
    (!fits).then(|| Fault::new("calibration.level", found, "a vector no longer than 1"))
}

fn matrix_fault(spatial: &Spatial) -> Option<Fault> {
    let matrix = spatial.matrix;
    let possible = |gains: Vector3<f64>| gains.iter().all(|gain| (0.01..=100.0).contains(gain));
    let (fits, right) = match spatial.model {
        // The eigenvalues of infinities would be sought for ever.
        _ if !matrix.iter().all(|number| number.is_finite()) => (false, "of finite numbers"),
        Model::Diagonal if matrix != Matrix3::from_diagonal(&matrix.diagonal()) => {
            (false, "diagonal, as its model is")
        }
        Model::Symmetric if (matrix - matrix.transpose()).amax() > TOLERANCE => {
            (false, "symmetric")
        }
        Model::Diagonal | Model::Symmetric => (
            possible(matrix.symmetric_eigenvalues()),
            "one with eigenvalues from 0.01 to 100",
        ),
        Model::General => (
            possible(matrix.singular_values()) && matrix.determinant() > 0.0,
            "one with singular values from 0.01 to 100 that mirrors nothing",
        ),
    };
    let found = format!("{:?}", matrix.as_slice());
    (!fits).then(|| Fault::new("calibration.matrix", found, right))
}
