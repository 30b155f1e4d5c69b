//! The input of a calibration.

use std::ops::Range;

use nalgebra::Vector3;

use super::medians::median;
use super::settings::Settings;
use super::verdict::Limits;
use crate::attitude::Pose;
use crate::frame::Mounting;
use crate::turn::Turn;

/// A board that turns by less than this, 0.6°, …
const RESTING_RAD: f64 = 0.01;
/// … in this time, seconds, rests: a turn of a minute makes 3°.
const REST_S: f64 = 0.5;
/// Rest is looked for in the last seconds before the turn: the gyro has hardly drifted since.
const REST_BEFORE_S: f64 = 5.0;

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
    /// after repeat each other. In a live request these are all.
    pub moving: Range<usize>,
    /// The sample at rest shortly before the first rotation: its difference from the turn shows a motor that runs only in the turn.
    pub rest: Option<FieldSample>,
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

/// The earliest sample at rest within the last seconds of these, with the median field of that rest: a single sample may be a spike.
/// The samples are in order of time and end where a turn begins.
pub fn last_rest<'a>(
    samples: impl DoubleEndedIterator<Item = &'a FieldSample> + Clone,
) -> Option<FieldSample> {
    let mut rest = begin_of_last_rest(samples.clone())?;
    let lasts = rest.t_s..=rest.t_s + REST_S;
    let resting = samples.filter(|sample| lasts.contains(&sample.t_s));
    let fields: Vec<Vector3<f64>> = resting.map(|sample| sample.field_mgauss).collect();
    for axis in 0..3 {
        let mut values: Vec<f64> = fields.iter().map(|field| field[axis]).collect();
        rest.field_mgauss[axis] = median(&mut values)?;
    }
    Some(rest)
}

/// The sample that rest began with. A turn begins gently, so that the last sample at rest may be one of the turn.
fn begin_of_last_rest<'a>(
    samples: impl DoubleEndedIterator<Item = &'a FieldSample> + Clone,
) -> Option<FieldSample> {
    let ends_s = samples.clone().next_back()?.t_s;
    let mut earlier = samples.clone().rev();
    let lasts = samples
        .rev()
        .take_while(|sample| ends_s - sample.t_s < REST_BEFORE_S);
    // Both go back in time, one ahead of the other.
    let mut first = earlier.next()?;
    let mut rest = None;
    for last in lasts {
        while last.t_s - first.t_s < REST_S {
            match earlier.next() {
                Some(sample) => first = sample,
                None => return rest,
            }
        }
        let (Some(now), Some(then)) = (last.pose, first.pose) else {
            continue;
        };
        let turned_rad = now.orientation.angle_to(&then.orientation);
        if now.frame_id == then.frame_id && turned_rad < RESTING_RAD {
            rest = Some(*first);
        }
    }
    rest
}

/// The samples, in order of time, from one moment to another. Both moments are included: only between the samples at both ends
/// has the board turned all the way.
pub fn during(samples: &[FieldSample], from_s: f64, to_s: f64) -> Range<usize> {
    let start = samples.partition_point(|sample| sample.t_s < from_s);
    let end = samples.partition_point(|sample| sample.t_s <= to_s);
    start..end
}
