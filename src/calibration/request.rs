//! The input of a calibration.

use std::ops::Range;

use nalgebra::Vector3;

use super::settings::Settings;
use super::verdict::Limits;
use crate::attitude::Pose;
use crate::frame::Mounting;
use crate::turn::Turn;

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

impl CompletedTurn {
    /// A turn whose samples are among these, which are in order of time.
    pub fn among(samples: &[FieldSample], turn: &Turn) -> Self {
        Self {
            samples: during(samples, turn.start_s, turn.end_s),
            axis_body: turn.axis_body,
        }
    }
}

impl Request {
    /// A calibration on all of these samples.
    pub fn new(
        samples: Vec<FieldSample>,
        turns: Vec<CompletedTurn>,
        mounting: Mounting,
        settings: Settings,
        limits: Limits,
    ) -> Self {
        Self {
            moving: 0..samples.len(),
            samples,
            turns,
            plane: None,
            mounting,
            settings,
            limits,
        }
    }
}

/// Those of these samples, in order of time, that were taken from one moment to another. Both moments belong to it: between
/// a sample at the beginning and one at the end the board has turned all the way.
pub fn during(samples: &[FieldSample], from_s: f64, to_s: f64) -> Range<usize> {
    let start = samples.partition_point(|sample| sample.t_s < from_s);
    let end = samples.partition_point(|sample| sample.t_s <= to_s);
    start..end
}
