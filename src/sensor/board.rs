//! Boards by name: which chips they carry, and how those are mounted.

use crate::check::words;
use crate::frame::Mountings;

words! {
    /// The boards that are known, and the one that the configuration describes itself.
    #[derive(Default)]
    pub enum Board {
        /// SparkFun's 9DOF Sensor Stick, SEN-10183, SEN-10321 and SEN-10724.
        Sparkfun9dofStick = "sparkfun-9dof-stick",
        /// GY-85.
        Gy85 = "gy-85",
        /// GY-86.
        Gy86 = "gy-86",
        /// GY-271: a magnetometer alone. The keys of `custom` are for a gyro beside it.
        Gy271 = "gy-271",
        /// Any other: table `[mounting]` has the mounting of its chips.
        #[default]
        Custom = "custom",
    }
}

words! {
    /// The chips beside the magnetometer.
    #[derive(Default)]
    pub enum Companions {
        /// Those of the board; where it does not say, those that answer.
        #[default]
        Auto = "auto",
        /// None: no turn can be seen.
        None = "none",
        /// A gyro ITG-3200 or ITG-3205 alone.
        Itg3200 = "itg3200",
        /// The same and an accelerometer ADXL345.
        Itg3200Adxl345 = "itg3200+adxl345",
        /// An MPU-6050.
        Mpu6050 = "mpu6050",
    }
}

impl Board {
    /// How its chips are mounted: body X forward, Y right, Z down; what the board does not say is as in `custom`.
    ///
    /// Sources: the firmware Razor AHRS (`Sensors.ino`) for the stick, MultiWii (`def.h`) for the GY boards with a
    /// gyro, PX4 (`QMC5883L.cpp`) for the GY-271, whose arrow X points forward. The first two store an
    /// accelerometer's reading as gravity or with signs of their own; what is here maps specific force, as the chip has
    /// it. On the stick the magnetometer is turned against the other two; on the GY boards with a gyro all are
    /// parallel, with chip Y forward, chip X to the right and chip Z up.
    pub fn mountings(self, custom: &Mountings) -> Mountings {
        let parsed = |text: &str| text.parse().expect("a mounting of three axes");
        let (mag, others) = match self {
            Self::Sparkfun9dofStick => (parsed("+x -y -z"), parsed("-y -x -z")),
            Self::Gy85 | Self::Gy86 => (parsed("+y +x -z"), parsed("+y +x -z")),
            Self::Gy271 => {
                let mag = parsed("+x -y -z");
                return Mountings { mag, ..*custom };
            }
            Self::Custom => return *custom,
        };
        Mountings {
            mag,
            gyro: others,
            accel: others,
        }
    }

    /// The chips beside the magnetometer, as far as the board says.
    pub fn companions(self) -> Companions {
        match self {
            Self::Sparkfun9dofStick | Self::Gy85 => Companions::Itg3200Adxl345,
            Self::Gy86 => Companions::Mpu6050,
            Self::Gy271 | Self::Custom => Companions::Auto,
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;

    /// Two axes fix a rotation: the one to the board's front, and Z, which points up on the printed side. Body Z points down.
    #[test]
    fn the_chips_of_a_board_have_its_front_and_their_z_upwards() {
        let [x, y, z] = [Vector3::x(), Vector3::y(), Vector3::z()];
        for (board, mag_front, other_front) in [
            // The stick's magnetometer is turned against its gyro and its accelerometer.
            (Board::Sparkfun9dofStick, x, -y),
            (Board::Gy85, y, y),
            (Board::Gy86, y, y),
        ] {
            let m = board.mountings(&Mountings::default());
            for (chip, front) in [
                (m.mag, mag_front),
                (m.gyro, other_front),
                (m.accel, other_front),
            ] {
                assert_eq!((chip.to_body(front), chip.to_body(z)), (x, -z), "{board:?}");
                assert!(!chip.is_mirrored());
            }
        }
    }

    #[test]
    fn beside_a_gy_271_the_gyro_is_mounted_as_configured() {
        let custom = Mountings {
            mag: "+y +x -z".parse().unwrap(),
            gyro: "-x -y +z".parse().unwrap(),
            ..Mountings::default()
        };
        let found = Board::Gy271.mountings(&custom);
        assert_eq!((found.gyro, found.accel), (custom.gyro, custom.accel));
        // Facing north on the printed side: the field is along chip X, and down.
        let field = found.mag.to_body(Vector3::new(170.0, 0.0, -500.0));
        assert_eq!(field, Vector3::new(170.0, 0.0, 500.0));
    }
}
