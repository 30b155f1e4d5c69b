//! Table `[serial]`: a sensor board behind a serial line.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::check::{absolute_or_empty, settings, words};
use crate::sensor::chip::drivers;

settings! {
    /// The port, and the protocol of the device behind it.
    pub struct Settings {
        /// The port's path, absolute: best one in `/dev/serial/by-id`, which stays the same. Empty: none.
        port: PathBuf = PathBuf::new()
            => |key, port| absolute_or_empty(key, port, "an absolute path, as /dev/ttyUSB0 or one in /dev/serial/by-id");
        /// Its speed, 8 data bits, no parity, 1 stop bit. Default 57600, the Razor's.
        baud: u32 = 57600, 300..=4_000_000, "baud";
        /// The protocol of the device.
        protocol: Protocol = Protocol::default();
        /// The magnetometer: it determines the scale of the Razor's counts, and names the calibration that is kept.
        chip: Chip = Chip::default();
    }
}

/// The protocol of a device.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Protocol {
    /// Listen, then ask, and log what was found.
    #[default]
    Auto,
    /// The Razor AHRS firmware, raw readings as text.
    Razor,
    /// The same in binary.
    RazorBinary,
    /// headingd's own log rows.
    LogRows,
}

impl Protocol {
    /// What a person calls it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "a known protocol",
            Self::Razor => "Razor AHRS, text",
            Self::RazorBinary => "Razor AHRS, binary",
            Self::LogRows => "log rows",
        }
    }
}

words! {
    /// The magnetometer behind the line.
    #[derive(Default)]
    pub enum Chip {
        /// HMC5843: Razor SEN-10125, sticks SEN-10183 and SEN-10321.
        #[default]
        Hmc5843 = "hmc5843",
        /// HMC5883L: Razor SEN-10736, stick SEN-10724.
        Hmc5883l = "hmc5883l",
    }
}

impl Chip {
    /// Counts per gauss at the gain after power-on, code 1, which the Razor never changes.
    pub fn counts_per_gauss(self) -> f64 {
        let chip = drivers::magnetometer(self.word()).expect("a chip has a driver");
        chip.sheet().gain(1)
    }
}
