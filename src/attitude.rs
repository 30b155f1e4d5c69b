//! placeholder
use nalgebra::{UnitQuaternion, Vector3};

/// Where the board points at one instant, by gyro and accelerometer alone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Turns body vectors into an earth frame whose Z points up and whose X is arbitrary; without an
    /// accelerometer the whole frame is arbitrary.
    pub orientation: UnitQuaternion<f64>,
    /// Whether the earth frame's Z is known to be up.
    pub vertical_known: bool,
    /// Changes whenever the gyro's account has a hole: poses of different stretches cannot be compared.
    pub stretch: u32,
}

/// One tick of the even clock.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tick {
    /// When, seconds.
    pub t_s: f64,
    /// Length of the tick, seconds.
    pub period_s: f64,
    /// The pose at its end.
    pub pose: Pose,
    /// Angular rate in the body frame, freed of its bias, rad/s.
    pub rate_rad_s: Vector3<f64>,
    /// The board is at rest: what the gyro says now is bias and noise.
    pub at_rest: bool,
}
