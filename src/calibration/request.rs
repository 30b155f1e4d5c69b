//! The input of a calibration.

use std::ops::Range;

use nalgebra::Vector3;

use super::settings::Settings;
use super::verdict::Limits;
use crate::attitude::Pose;
use crate::frame::Mounting;

/// One magnetometer sample, as a calibration sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FieldSample {
    /// Seconds.
    pub t_s: f64,
    /// Raw field, chip axes, milligauss.
    pub field_mgauss: Vector3<f64>,
    /// The board's pose, where the gyro knew it.
    pub pose: Option<Pose>,
}

/// A full turn among the samples of a request.
#[derive(Clone, Debug, PartialEq)]
pub struct CompletedTurn {
    /// Its samples.
    pub samples: Range<usize>,
    /// Its axis, body frame, unit vector.
    pub axis_body: Vector3<f64>,
}

/// Everything that a calibration needs.
#[derive(Clone, Debug)]
pub struct Request {
    /// Samples in order of time.
    pub samples: Vec<FieldSample>,
    /// The samples from the start of the first rotation to the end of the last; those at rest before and
    /// after repeat each other. A live request is all of this.
    pub moving: Range<usize>,
    /// The full turns among them, in order.
    pub turns: Vec<CompletedTurn>,
    /// Two perpendicular unit vectors, chip axes, if the plane is given and not to be taken from the gyro.
    pub plane: Option<[Vector3<f64>; 2]>,
    /// How the magnetometer is mounted.
    pub mounting: Mounting,
    /// How to calibrate.
    pub settings: Settings,
    /// What to ask of the result.
    pub limits: Limits,
}
