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
        board_axes: Mounting = Mounting::default();
        /// Added to every heading after that.
        heading_offset_deg: f64 = 0.0, -180.0..=180.0, "degrees";
    }
    also Settings::check_board;
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

    fn check_board(&self, faults: &mut Vec<Fault>) {
        if self.board_axes.is_mirrored() {
            let found = format!("{:?}, which is mirrored", self.board_axes.to_string());
            let right = "a rotation: turn one sign round, or exchange two axes";
            faults.push(Fault::new("board_axes", found, right));
        }
    }
}
