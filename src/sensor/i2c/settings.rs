//! Table `[i2c]`: which chips on which bus, and how they are read.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::check::{Check, Fault, within};
use crate::frame::Mountings;
use crate::sensor::board::{Board, Companions};
use crate::sensor::bus::LinuxBus;
use crate::sensor::chip::hmc5843::Kind;

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
    /// The magnetometer, at 0x1E.
    pub magnetometer: Magnetometer,
    /// Its readings, 0.5 to 220 a second: 40 by single measurements, others at the slowest of the chip's own
    /// rates that is no slower.
    pub rate_hz: f64,
    /// The gain's code (CRB, bits 7:5), 0 to 7; without it, the gain is chosen automatically.
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

/// Which magnetometer there is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Magnetometer {
    /// Find out.
    #[default]
    Auto,
    /// HMC5843.
    Hmc5843,
    /// HMC5883.
    Hmc5883,
    /// HMC5883L.
    Hmc5883l,
    /// HMC5983.
    Hmc5983,
}

impl Magnetometer {
    /// The kind, if it is named.
    pub fn kind(self) -> Option<Kind> {
        match self {
            Self::Auto => None,
            Self::Hmc5843 => Some(Kind::Hmc5843),
            Self::Hmc5883 => Some(Kind::Hmc5883),
            Self::Hmc5883l => Some(Kind::Hmc5883l),
            Self::Hmc5983 => Some(Kind::Hmc5983),
        }
    }
}

impl Settings {
    /// The path of the bus.
    pub fn path(&self) -> PathBuf {
        LinuxBus::path(self.bus)
    }

    /// The name under which a calibration is kept: it is of the kind that the configuration names. Which of the
    /// kin an unnamed one is may not be known yet, and they all read in the same unit and order.
    pub fn sensor(&self) -> &'static str {
        self.magnetometer.kind().map_or("hmc58xx", Kind::word)
    }

    /// How the chips are mounted: as the board says, or else as the table `[mounting]` does.
    pub fn mountings(&self, custom: &Mountings) -> Mountings {
        self.board.mountings().unwrap_or(*custom)
    }
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            bus: 1,
            board: Board::default(),
            magnetometer: Magnetometer::default(),
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
            within(&mut faults, "gain", gain, 0..=7, "");
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
        one_of("gyro_address", self.gyro_address, [0x68, 0x69]);
        one_of("accel_address", self.accel_address, [0x53, 0x1D]);
        faults
    }
}
