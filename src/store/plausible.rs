//! Whether a calibration's numbers can be a calibration's: what finds damage in a file.

use nalgebra::Vector3;
use serde_json::Value;

use crate::calibration::model::{
    Calibration, Mode, Model, PackedCovariance, Parameters, Planar, Spatial,
};
use crate::check::{Fault, within};

/// Returns the path of the first non-numeric field, which the deserialiser would not name.
pub(super) fn no_number(calibration: &Value) -> Option<String> {
    fn search(value: &Value, key: &str) -> Option<String> {
        match value {
            Value::Number(_) => None,
            Value::Array(values) => values
                .iter()
                .enumerate()
                .find_map(|(index, value)| search(value, &format!("{key}[{index}]"))),
            other => Some(format!("{key} is {other}, but must be a number")),
        }
    }
    [
        "basis",
        "level",
        "bias_mgauss",
        "scale",
        "matrix",
        "reference_mgauss",
        "strength_mgauss",
        "residual_mgauss",
        "heading_sd_deg",
        "covariance",
        "gyro_bias_deg_s",
        "accel_bias_m_s2",
    ]
    .iter()
    .filter_map(|key| calibration.get(key).map(|value| (key, value)))
    .filter(|(key, value)| !(**key == "reference_mgauss" && value.is_null()))
    .find_map(|(key, value)| search(value, &format!("calibration.{key}")))
}

/// What no calibration can have. The ranges are far wider than any sensor's: they are there to find
/// damage, not to judge.
pub(super) fn faults(calibration: &Calibration) -> Vec<Fault> {
    let mut faults = Vec::new();
    match &calibration.parameters {
        Parameters::Planar(planar) => planar_faults(&mut faults, planar),
        Parameters::Spatial(spatial) => spatial_faults(&mut faults, spatial),
    }
    let mut check = |key, value, range| within(&mut faults, key, value, range, "milligauss");
    if let Some(reference) = calibration.reference_mgauss {
        check("calibration.reference_mgauss", reference, 0.1..=1e5);
    }
    let (strength, residual) = (calibration.strength_mgauss, calibration.residual_mgauss);
    check("calibration.strength_mgauss", strength, 0.1..=1e5);
    check("calibration.residual_mgauss", residual, 0.0..=1e5);
    let (key, sd_deg) = ("calibration.heading_sd_deg", calibration.heading_sd_deg);
    within(&mut faults, key, sd_deg, 0.0..=180.0, "degrees");
    let biases = [
        (
            "calibration.gyro_bias_deg_s",
            calibration.gyro_bias_deg_s,
            60.0,
            "degrees per second",
        ),
        (
            "calibration.accel_bias_m_s2",
            calibration.accel_bias_m_s2,
            5.0,
            "m/s²",
        ),
    ];
    for (key, bias, most, unit) in biases {
        for value in bias.iter().flatten() {
            within(&mut faults, key, *value, -most..=most, unit);
        }
    }
    if let Some(covariance) = &calibration.covariance {
        covariance_faults(&mut faults, calibration, covariance);
    }
    faults
}

fn covariance_faults(
    faults: &mut Vec<Fault>,
    calibration: &Calibration,
    covariance: &PackedCovariance,
) {
    let (found, right) = match calibration.parameters.mode() {
        Mode::Planar => (
            "given",
            "left out: a planar calibration says nothing of three of its axes",
        ),
        Mode::Spatial if covariance.is_plausible() => return,
        Mode::Spatial => (
            "no covariance",
            "of finite numbers, with no variance below 0 and no correlation beyond 1",
        ),
    };
    faults.push(Fault::new("calibration.covariance", found, right));
}

fn planar_faults(faults: &mut Vec<Fault>, planar: &Planar) {
    const TOLERANCE: f64 = 1e-6;
    let [first, second] = &planar.basis;
    let (lengths, cosine) = (
        [first, second].map(Vector3::norm_squared),
        first.dot(second),
    );
    let off = [lengths[0] - 1.0, lengths[1] - 1.0, cosine];
    // NaN is off too.
    if !off.iter().all(|off| off.abs() <= TOLERANCE) {
        let text = |v: &Vector3<f64>| format!("[{}, {}, {}]", v.x, v.y, v.z);
        let found = format!("[{}, {}]", text(first), text(second));
        let right = "two perpendicular unit vectors";
        faults.push(Fault::new("calibration.basis", found, right));
    }
    bias_faults(faults, planar.bias_mgauss.as_slice());
    for (index, scale) in planar.scale.iter().enumerate() {
        let key = format!("calibration.scale[{index}]");
        within(faults, &key, *scale, 0.01..=100.0, "");
    }
    // The part of a unit vector's mean that lies in the plane.
    if !(0.0..=1.0 + TOLERANCE).contains(&planar.level.norm()) {
        let found = format!("[{}, {}]", planar.level.x, planar.level.y);
        let right = "a vector no longer than 1";
        faults.push(Fault::new("calibration.level", found, right));
    }
}

fn spatial_faults(faults: &mut Vec<Fault>, spatial: &Spatial) {
    bias_faults(faults, spatial.bias_mgauss.as_slice());
    let matrix = spatial.matrix;
    let right = match spatial.model {
        // Also keeps infinities from the eigenvalues, which would be sought for ever.
        _ if !matrix.iter().all(|number| number.is_finite()) => "of finite numbers",
        Model::Diagonal if (0..9).any(|i| i % 4 != 0 && matrix[i] != 0.0) => {
            "diagonal, as its model is"
        }
        Model::Symmetric if (matrix - matrix.transpose()).amax() > 1e-6 => "symmetric",
        Model::General => {
            let gains = matrix.singular_values();
            if gains.iter().all(|gain| (0.01..=100.0).contains(gain)) && matrix.determinant() > 0.0
            {
                return;
            }
            "one with singular values from 0.01 to 100 that mirrors nothing"
        }
        Model::Diagonal | Model::Symmetric => {
            let eigenvalues = matrix.symmetric_eigenvalues();
            if eigenvalues.iter().all(|e| (0.01..=100.0).contains(e)) {
                return;
            }
            "one with eigenvalues from 0.01 to 100"
        }
    };
    let numbers: Vec<String> = matrix.iter().map(f64::to_string).collect();
    let found = format!("[{}]", numbers.join(", "));
    faults.push(Fault::new("calibration.matrix", found, right));
}

fn bias_faults(faults: &mut Vec<Fault>, bias_mgauss: &[f64]) {
    for (index, bias) in bias_mgauss.iter().enumerate() {
        let key = format!("calibration.bias_mgauss[{index}]");
        within(faults, &key, *bias, -1e5..=1e5, "milligauss");
    }
}
