//! placeholder
use nalgebra::Vector3;

/// A full turn that the board has made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turn {
    /// When it began, seconds.
    pub start_s: f64,
    /// When it was complete, seconds.
    pub end_s: f64,
    /// Unit vector in the body frame about which the board turned, right-handed: the board turned by
    /// `+angle_rad` about it.
    pub axis_body: Vector3<f64>,
    /// Net rotation, radians, above 0.
    pub angle_rad: f64,
    /// Angle between the axis and the vertical, 0 to 90 degrees, if the vertical is known.
    pub from_vertical_deg: Option<f64>,
}
