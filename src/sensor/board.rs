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

    /// On the printed side, which is up, chip Z of every chip points up.
    #[test]
    fn a_level_board_reads_minus_9_8_down_and_a_clockwise_turn_is_positive() {
        for board in [Board::Sparkfun9dofStick, Board::Gy85, Board::Gy86] {
            let mountings = board.mountings(&Mountings::default());
            // Specific force points up: ADXL345 and MPU-6050 read +1 g on chip Z.
            let force = mountings.accel.to_body(Vector3::new(0.0, 0.0, 9.8));
            assert_eq!(force, Vector3::new(0.0, 0.0, -9.8));
            // Clockwise from above is negative about an axis that points up.
            let rate = mountings.gyro.to_body(Vector3::new(0.0, 0.0, -1.0));
            assert_eq!(rate, Vector3::new(0.0, 0.0, 1.0));
            // In the north the field points down.
            let field = mountings.mag.to_body(Vector3::new(0.0, 0.0, -400.0));
            assert_eq!(field.z, 400.0);
        }
    }

    /// Nose up, the front of the board points up, and so a part of the force of the table is along it; and
    /// nose up is a positive rotation about the axis to the right.
    #[test]
    fn the_chips_of_a_board_agree_on_where_its_front_is() {
        // The stick's front is at its chips' −Y, the GY boards' at their +Y.
        for (board, front, right) in [
            (Board::Sparkfun9dofStick, -Vector3::y(), -Vector3::x()),
            (Board::Gy85, Vector3::y(), Vector3::x()),
            (Board::Gy86, Vector3::y(), Vector3::x()),
        ] {
            let m = board.mountings(&Mountings::default());
            assert_eq!(m.accel.to_body(front), Vector3::x());
            assert_eq!(m.gyro.to_body(right), Vector3::y());
        }
        // The magnetometer of the stick has its X to the front; that of the GY boards lies as the others.
        let stick = Board::Sparkfun9dofStick.mountings(&Mountings::default());
        assert_eq!(stick.mag.to_body(Vector3::x()), Vector3::x());
        let gy = Board::Gy85.mountings(&Mountings::default());
        assert_eq!(gy.mag, gy.accel);
    }

    /// A level board at heading ψ sees (H cos ψ, −H sin ψ, Z): facing east, north is to its left.
    #[test]
    fn facing_east_north_is_to_the_left() {
        // The stick's magnetometer: X forward, so Y is to the left (Z is up), and reads north.
        let stick = Board::Sparkfun9dofStick.mountings(&Mountings::default());
        let field = stick.mag.to_body(Vector3::new(0.0, 170.0, -500.0));
        assert_eq!(field, Vector3::new(0.0, -170.0, 500.0));
        // The GY boards' X is to the right, and reads south.
        let gy = Board::Gy85.mountings(&Mountings::default());
        let field = gy.mag.to_body(Vector3::new(-170.0, 0.0, -500.0));
        assert_eq!(field, Vector3::new(0.0, -170.0, 500.0));
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
