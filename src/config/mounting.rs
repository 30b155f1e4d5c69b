//! Table `[mounting]`: how the chips are mounted on the board, and the board on what it steers.

use crate::check::{Fault, settings};
use crate::frame::{Mounting, Mountings};

settings! {
    /// How chips and board are mounted.
    #[derive(Copy)]
    pub struct Settings {
        /// Magnetometer chip axes along the board's X, Y, Z.
        mag_axes: Mounting = Mounting::default();
        /// Gyro chip axes along the board's X, Y, Z.
        gyro_axes: Mounting = Mounting::default();
        /// Accelerometer chip axes along the board's X, Y, Z.
        accel_axes: Mounting = Mounting::default();
        /// Board axes along body X, Y, Z.
        board_axes: Mounting = Mounting::default() => |key, axes| {
            let right = "a rotation: turn one sign round, or exchange two axes";
            axes.is_mirrored().then(|| Fault::new(key, format!("\"{axes}\", which is mirrored"), right))
        };
        /// Added to every heading after that.
        heading_offset_deg: f64 = 0.0, -180.0..=180.0, "degrees";
    }
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
