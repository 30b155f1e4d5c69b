//! Table `[source]`: where readings come from.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::check::{Check, Fault, within};

/// Where readings come from, and how fast.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// What the source is.
    pub kind: Kind,
    /// The log to replay; of no effect with other kinds. A relative path starts in the working folder. Empty: none.
    pub log: PathBuf,
    /// How fast a log is replayed or a simulation runs, in times real time: 0.1 to 1000. Of no effect with
    /// real devices.
    pub speed: f64,
}

/// The kinds of source.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// A simulated board: table `[simulator]`.
    #[default]
    Simulator,
    /// A recorded log.
    Replay,
    /// Chips on an I2C bus: table `[i2c]`.
    I2c,
    /// A board behind a serial line: table `[serial]`.
    Serial,
}

impl Kind {
    /// Whether its readings are taken now, by a real device.
    pub fn is_live(self) -> bool {
        matches!(self, Self::I2c | Self::Serial)
    }
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            kind: Kind::default(),
            log: PathBuf::new(),
            speed: 1.0,
        }
    }
}

impl Settings {
    /// How fast time goes: a real device has the pace it has.
    pub fn pace(&self) -> f64 {
        if self.kind.is_live() { 1.0 } else { self.speed }
    }
}

impl Check for Settings {
    fn check(&self) -> Vec<Fault> {
        let mut faults = Vec::new();
        if self.kind == Kind::Replay && self.log.as_os_str().is_empty() {
            faults.push(Fault {
                key: "log".to_owned(),
                found: "empty".to_owned(),
                right: "the path of the log to replay".to_owned(),
            });
        }
        within(
            &mut faults,
            "speed",
            self.speed,
            0.1..=1000.0,
            "times real time",
        );
        faults
    }
}
