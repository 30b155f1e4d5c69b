//! Table `[i2c]`: which chips on which bus, and how they are read.

use std::path::PathBuf;

use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize};

use crate::check::{Check, Fault, within};
use crate::frame::Mountings;
use crate::sensor::board::{Board, Companions};
use crate::sensor::bus::LinuxBus;
use crate::sensor::chip::drivers;
use crate::sensor::chip::magnetometer::Magnetometer;

/// The rate that is kept by single measurements: the paper's, which no chip has of its own.
pub const STEADY_HZ: f64 = 40.0;

/// Chips on a bus of Linux.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// The number N of the bus /dev/i2c-N, 0 to 255.
    pub bus: u8,
    /// The board.
    pub board: Board,
    /// The magnetometer.
    pub magnetometer: MagnetometerChoice,
    /// Its readings, 0.5 to 220 a second: 40 by single measurements where the chip has those, others by the smallest
    /// rate of the chip that is not smaller, or else by its largest.
    pub rate_hz: f64,
    /// The gain's code, 0 (finest) to 7, or 1 with a QMC5883L; without it, the gain is chosen automatically.
    pub gain: Option<u8>,
    /// The chips beside it.
    pub companions: Companions,
    /// Address of the gyro, 0x68 or 0x69.
    pub gyro_address: u8,
    /// Address of the accelerometer, if that is a chip of its own, 0x53 or 0x1D.
    pub accel_address: u8,
    /// Readings of gyro and accelerometer, 100 to 200 a second.
    pub gyro_rate_hz: f64,
}

/// Which magnetometer there is: one of the driver table by its word, or the one that answers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(transparent)]
pub struct MagnetometerChoice(&'static str);

impl MagnetometerChoice {
    /// The choice with this word, if there is one.
    pub fn new(word: &str) -> Option<Self> {
        let known = drivers::words().iter().find(|known| **known == word);
        known.copied().map(Self)
    }

    /// The chip, if it is named.
    pub fn named(self) -> Option<&'static dyn Magnetometer> {
        drivers::magnetometer(self.0)
    }
}

impl Default for MagnetometerChoice {
    fn default() -> Self {
        Self(drivers::AUTO)
    }
}

impl<'de> Deserialize<'de> for MagnetometerChoice {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let word = String::deserialize(deserializer)?;
        Self::new(&word).ok_or_else(|| D::Error::unknown_variant(&word, drivers::words()))
    }
}

impl Settings {
    /// The path of the bus.
    pub fn path(&self) -> PathBuf {
        LinuxBus::path(self.bus)
    }

    /// The name under which a calibration is kept: that of the chip that the configuration names. An unnamed one may
    /// not be known yet; all are read in the same unit and order. The name is older than chips of another family.
    pub fn sensor(&self) -> &'static str {
        let named = self.magnetometer.named();
        named.map_or("hmc58xx", |chip| chip.sheet().word)
    }

    /// How the chips are mounted: as the board says, and otherwise as the table `[mounting]` does.
    pub fn mountings(&self, custom: &Mountings) -> Mountings {
        self.board.mountings(custom)
    }
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            bus: 1,
            board: Board::default(),
            magnetometer: MagnetometerChoice::default(),
            rate_hz: STEADY_HZ,
            gain: None,
            companions: Companions::default(),
            gyro_address: 0x68,
            accel_address: 0x53,
            gyro_rate_hz: 100.0,
        }
    }
}

impl Check for Settings {
    fn check(&self) -> Vec<Fault> {
        let mut faults = Vec::new();
        within(&mut faults, "rate_hz", self.rate_hz, 0.5..=220.0, "Hz");
        if let Some(gain) = self.gain {
            let named = self.magnetometer.named();
            let gains = named.map_or(8, |chip| chip.sheet().gains.len());
            within(&mut faults, "gain", gain, 0..=gains as u8 - 1, "");
        }
        let rate_hz = self.gyro_rate_hz;
        within(&mut faults, "gyro_rate_hz", rate_hz, 100.0..=200.0, "Hz");
        let mut one_of = |key: &str, found: u8, right: [u8; 2]| {
            if !right.contains(&found) {
                faults.push(Fault {
                    key: key.to_owned(),
                    found: format!("0x{found:02x}"),
                    right: format!("0x{:02x} or 0x{:02x}", right[0], right[1]),
                });
            }
        };
        one_of("gyro_address", self.gyro_address, drivers::GYRO_ADDRESSES);
        one_of(
            "accel_address",
            self.accel_address,
            drivers::ACCEL_ADDRESSES,
        );
        faults
    }
}
