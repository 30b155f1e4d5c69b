//! Headings by a kept calibration alone: without a gyro the estimate never begins.

use nalgebra::Vector3;

use super::level;
use super::prior::{FIELD_MGAUSS, ROTATION_RAD};
use crate::calibration::model::{Calibration, Model, Parameters};
use crate::frame::{Mounting, heading_deg, hypot};

/// Deviation of a place's field from that of the calibration, as a share of the field: rooms are uneven by 1 to 2 %.
const PLACE: f64 = 0.02;
/// A body axis with more of the normal of a planar calibration than this (sine of 30°) was not measured.
const ACROSS: f64 = 0.5;

/// The heading from one corrected sample, degrees, and its deviation, radians. `down` has its own, radians.
pub(super) fn heading(
    calibration: &Calibration,
    mounting: &Mounting,
    corrected: &Vector3<f64>,
    (axis, tilt_sd): (Vector3<f64>, f64),
) -> Option<(f64, f64)> {
    let heading = heading_deg(corrected, &axis)?;
    let (along, horizontal) = level::split(corrected, &axis);
    // A fit to a sphere does not see the rotation between the chips. Of a circle only the rotation about its axis is unseen.
    let (vertical, unseen) = match &calibration.parameters {
        Parameters::Spatial(spatial) if spatial.model == Model::General => (along, 0.0),
        Parameters::Spatial(_) => (along, ROTATION_RAD * hypot(along, horizontal)),
        // The field across the plane is not known, and comes into the heading as far as the plane is not level.
        Parameters::Planar(planar) => {
            let down = planar.basis.map(|basis| mounting.to_body(basis).dot(&axis));
            let off = hypot(down[0] - planar.level.x, down[1] - planar.level.y);
            let unseen = hypot(off * FIELD_MGAUSS, ROTATION_RAD * horizontal);
            (FIELD_MGAUSS, unseen)
        }
    };
    let own = calibration.heading_sd_deg.to_radians() * horizontal;
    let place = PLACE * FIELD_MGAUSS.max(calibration.strength_mgauss);
    let squares = own.powi(2) + place.powi(2) + unseen.powi(2) + (tilt_sd * vertical).powi(2);
    Some((heading, squares.sqrt() / horizontal))
}

/// Which body axes it has measured.
pub(super) fn measured_axes(calibration: &Calibration, mounting: &Mounting) -> [bool; 3] {
    match &calibration.parameters {
        Parameters::Spatial(_) => [true; 3],
        Parameters::Planar(planar) => {
            let across = mounting.to_body(planar.normal());
            std::array::from_fn(|axis| across[axis].abs() < ACROSS)
        }
    }
}
