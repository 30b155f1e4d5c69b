//! Calibration: from raw samples of a turn to parameters and a verdict.
//!
//! `plane` chooses samples, mode and plane; `rist` the window; `swarm` searches it with the
//! `objective` until `mpsot` stops it; `refine` brings the answer to maximum likelihood over all samples
//! of the turn; `agreement` holds it against the gyro; `verdict` accepts or rejects.
//! Everything here is a pure function of its arguments: the same request gives the same outcome.

pub mod agreement;
pub mod coverage;
pub mod curve;
pub mod fit;
pub mod jump;
pub mod model;
pub mod mpsot;
pub mod objective;
pub mod outcome;
pub mod plane;
pub mod policy;
pub mod refine;
pub mod rist;
pub mod settings;
pub mod swarm;
pub mod thinning;
pub mod verdict;

mod candidate;
mod clock;
mod folds;
mod medians;
mod soft_iron;
mod trial;
mod uncertainty;
mod windows;
mod wobble;

use std::ops::Range;
use std::time::Duration;

use nalgebra::Vector3;

use crate::attitude::Pose;
use crate::frame::Mounting;
use clock::Clock;
use outcome::{Outcome, Verdict};
use settings::Settings;
use verdict::Limits;

/// One magnetometer sample, as a calibration sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Seconds.
    pub t_s: f64,
    /// Raw field, chip axes, milligauss.
    pub field_mgauss: Vector3<f64>,
    /// The board's pose, where the gyro knew it.
    pub pose: Option<Pose>,
}

/// A full turn among the samples of a request.
#[derive(Clone, Debug, PartialEq)]
pub struct TurnMade {
    /// Its samples.
    pub samples: Range<usize>,
    /// Its axis, body frame, unit vector.
    pub axis_body: Vector3<f64>,
}

/// Everything that a calibration needs.
#[derive(Clone, Debug)]
pub struct Request {
    /// Samples in order of time.
    pub samples: Vec<Sample>,
    /// The samples from the start of the first rotation to the end of the last; those at rest before and
    /// after say the same thing over and over. A live request is all of this.
    pub moving: Range<usize>,
    /// The full turns among them, in order.
    pub turns: Vec<TurnMade>,
    /// Two perpendicular unit vectors, chip axes, if the plane is given and not to be taken from the gyro.
    pub plane: Option<[Vector3<f64>; 2]>,
    /// How the magnetometer is mounted.
    pub mounting: Mounting,
    /// How to calibrate.
    pub settings: Settings,
    /// What to ask of the result.
    pub limits: Limits,
}

/// Calibrates. `clock` tells the time since any origin, for the outcome's `elapsed_us`; a clock that knows
/// nothing leaves those unknown, as a replay must.
pub fn calibrate(request: &Request, clock: &dyn Fn() -> Option<Duration>) -> Outcome {
    let mut outcome = Outcome::begun(request);
    let started = Clock::start(clock);
    match candidate::calibrate(request, clock, &mut outcome) {
        Ok(message) => {
            outcome.verdict = Verdict::Accepted;
            (outcome.reason, outcome.message) = ("good", message);
        }
        Err(refusal) => outcome = outcome.refused(refusal),
    }
    outcome.elapsed_us.total = started.elapsed_us();
    outcome
}
