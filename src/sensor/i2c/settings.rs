//! Table `[i2c]`: which chips on which bus, and how they are read.

use std::path::PathBuf;

use crate::check::{Fault, settings, within, words};
use crate::sensor::board::{Board, Companions};
use crate::sensor::bus::LinuxBus;
use crate::sensor::chip::drivers;
use crate::sensor::chip::magnetometer::Magnetometer;

/// The paper's rate. No chip offers it: single measurements are triggered at this rate.
pub const STEADY_HZ: f64 = 40.0;

settings! {
    /// Chips on a bus of Linux.
    pub struct Settings {
        /// The number N of the bus /dev/i2c-N.
        bus: u8 = 1;
        /// The board.
        board: Board = Board::default();
        /// The magnetometer.
        magnetometer: MagnetometerChoice = MagnetometerChoice::default();
        /// Readings a second. 40 uses single measurements where the chip has them; any other value selects the
        /// chip's smallest rate that is not smaller, else its fastest.
        rate_hz: f64 = STEADY_HZ, 0.5..=220.0, "Hz";
        /// The gain's code, 0 (finest) to 7, or 1 with a QMC5883L; without it, the gain is chosen automatically.
        gain: Option<u8> = None;
        /// The chips beside it.
        companions: Companions = Companions::default();
        /// Address of the gyro, 0x68 or 0x69.
        gyro_address: u8 = 0x68 => |key, found| one_of(key, *found, drivers::GYRO_ADDRESSES);
        /// Address of the accelerometer, if that is a chip of its own, 0x53 or 0x1D.
        accel_address: u8 = 0x53 => |key, found| one_of(key, *found, drivers::ACCEL_ADDRESSES);
        /// Readings of gyro and accelerometer.
        gyro_rate_hz: f64 = 100.0, 100.0..=200.0, "Hz";
    }
    compares Settings::check_gain;
}

words! {
    /// The magnetometer: one of the driver table, by its word, or the one that answers.
    #[derive(Default)]
    pub enum MagnetometerChoice {
        /// The one that answers.
        #[default]
        Auto = "auto",
        Hmc5843 = "hmc5843",
        Hmc5883 = "hmc5883",
        Hmc5883l = "hmc5883l",
        Hmc5983 = "hmc5983",
        Qmc5883l = "qmc5883l",
    }
}

impl MagnetometerChoice {
    pub fn named(self) -> Option<&'static dyn Magnetometer> {
        drivers::magnetometer(self.word())
    }
}

impl Settings {
    pub fn path(&self) -> PathBuf {
        LinuxBus::path(self.bus)
    }

    /// The name under which a calibration is kept: that of the configured chip. Without one, the chip may not be known
    /// yet; all are read in the same unit and order. The name `hmc58xx` predates chips of other families.
    pub fn sensor(&self) -> &'static str {
        match self.magnetometer {
            MagnetometerChoice::Auto => "hmc58xx",
            named => named.word(),
        }
    }

    /// How many gains there are depends on the chip.
    fn check_gain(&self, faults: &mut Vec<Fault>) {
        if let Some(gain) = self.gain {
            let named = self.magnetometer.named();
            let gains = named.map_or(8, |chip| chip.sheet().gains.len());
            within(faults, "gain", gain, 0..=gains as u8 - 1, "");
        }
    }
}

fn one_of(key: &str, found: u8, right: [u8; 2]) -> Option<Fault> {
    let wrong = !right.contains(&found);
    let right = format!("0x{:02x} or 0x{:02x}", right[0], right[1]);
    wrong.then(|| Fault::new(key, format!("0x{found:02x}"), right))
}
