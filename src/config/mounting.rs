//! Table `[mounting]`: how the chips are mounted on the board, and the board on what it steers.

use serde::{Deserialize, Serialize};

use crate::check::{Check, Fault, within};
use crate::frame::{Mounting, Mountings};

/// How chips and board are mounted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// Magnetometer chip axes along the board's X, Y, Z.
    pub mag_axes: Mounting,
    /// Gyro chip axes along the board's X, Y, Z.
    pub gyro_axes: Mounting,
    /// Accelerometer chip axes along the board's X, Y, Z.
    pub accel_axes: Mounting,
    /// Board axes along body X, Y, Z.
    pub board_axes: Mounting,
    /// Added to every heading after that: -180 to 180 degrees.
    pub heading_offset_deg: f64,
}

impl Settings {
    /// The chips on a board that says nothing of them itself.
    pub fn chips(&self) -> Mountings {
        Mountings {
            mag: self.mag_axes,
            gyro: self.gyro_axes,
            accel: self.accel_axes,
        }
    }

    /// The board, whatever the source is.
    pub fn board(&self) -> Mounting {
        Mounting::adding_to_heading(self.heading_offset_deg).after(&self.board_axes)
    }
}

impl Check for Settings {
    fn check(&self) -> Vec<Fault> {
        let mut faults = Vec::new();
        if self.board_axes.is_mirrored() {
            faults.push(Fault {
                key: "board_axes".to_owned(),
                found: format!("{:?}, which is mirrored", self.board_axes.to_string()),
                right: "a rotation: turn one sign round, or exchange two axes".to_owned(),
            });
        }
        let offset_deg = self.heading_offset_deg;
        within(
            &mut faults,
            "heading_offset_deg",
            offset_deg,
            -180.0..=180.0,
            "degrees",
        );
        faults
    }
}
