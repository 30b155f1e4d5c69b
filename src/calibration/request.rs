//! The input of a calibration.

use std::ops::Range;

use nalgebra::Vector3;

use super::medians::median;
use super::settings::Settings;
use super::verdict::Limits;
use crate::attitude::Pose;
use crate::frame::Mounting;
use crate::turn::Turn;

/// A board rests if it turns by less than this, radians (0.6°), within `REST_S`: a turn of a minute makes 3° in that time.
const RESTING_RAD: f64 = 0.01;
/// Time over which rest is judged, seconds.
const REST_S: f64 = 0.5;
/// Rest is looked for in the last seconds before the turn: the gyro has hardly drifted since.
const REST_BEFORE_S: f64 = 5.0;
/// The two samples of a rest are not further apart, seconds: a gap tells nothing of rest.
const MOST_APART_S: f64 = 2.0;

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
/// The samples are in order of time and end where a turn begins. It begins gently, so that the last sample at rest may be one of the turn.
pub fn last_rest<'a>(
    samples: impl DoubleEndedIterator<Item = &'a FieldSample>,
) -> Option<FieldSample> {
    let mut backwards = samples.rev().peekable();
    let ends_s = backwards.peek()?.t_s;
    let within = |most_s: f64| move |sample: &&FieldSample| ends_s - sample.t_s < most_s;
    let recent: Vec<&FieldSample> = backwards
        .take_while(within(REST_BEFORE_S + MOST_APART_S))
        .collect();
    let begin_of_rest = |last: &FieldSample| {
        let first = (recent.iter()).find(|first| last.t_s - first.t_s >= REST_S)?;
        let near = last.t_s - first.t_s < MOST_APART_S;
        (near && rests_between(first, last)).then_some(**first)
    };
    let earliest_first = recent.iter().rev().copied();
    let mut rest = earliest_first
        .filter(within(REST_BEFORE_S))
        .find_map(begin_of_rest)?;
    let lasts = rest.t_s..=rest.t_s + REST_S;
    for axis in 0..3 {
        let resting = recent.iter().filter(|sample| lasts.contains(&sample.t_s));
        let mut values: Vec<f64> = resting.map(|sample| sample.field_mgauss[axis]).collect();
        rest.field_mgauss[axis] = median(&mut values)?;
    }
    Some(rest)
}

/// Whether the board hardly turns from one sample to the other.
fn rests_between(first: &FieldSample, last: &FieldSample) -> bool {
    let (Some(then), Some(now)) = (first.pose, last.pose) else {
        return false;
    };
    let turned_rad = now.orientation.angle_to(&then.orientation);
    now.frame_id == then.frame_id && turned_rad < RESTING_RAD
}

/// The samples, in order of time, from one moment to another. Both moments are included: only between the samples at both ends
/// has the board turned all the way.
pub fn during(samples: &[FieldSample], from_s: f64, to_s: f64) -> Range<usize> {
    let start = samples.partition_point(|sample| sample.t_s < from_s);
    let end = samples.partition_point(|sample| sample.t_s <= to_s);
    start..end
}
