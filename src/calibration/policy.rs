//! When calibrations are made, and why one was.

use std::fmt;

use serde::{Deserialize, Serialize};

/// Whether the daemon calibrates by itself.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Policy {
    /// On every turn that is seen.
    #[default]
    On,
    /// Only when it is told to.
    Off,
    /// Never, while there is a calibration in force: that one is not replaced.
    Locked,
}

impl Policy {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::On, Self::Off, Self::Locked];

    /// The word as published and kept.
    pub fn word(self) -> &'static str {
        match self {
            Self::On => "on",
            Self::Off => "off",
            Self::Locked => "locked",
        }
    }

    /// For people: what helps where no calibration is in force.
    pub fn remedy(self) -> &'static str {
        match self {
            Self::On | Self::Locked => "turn the board once",
            Self::Off => "headingd calibration start, and then turn the board once",
        }
    }
}

/// Why a calibration was made, or how it came here.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Reason {
    /// The board was turned.
    Turn,
    /// Somebody asked for it.
    Start,
    /// The one before had stopped fitting.
    Stale,
    /// Somebody brought it in a file.
    Import,
    /// It was made on a recorded log.
    Log,
}

impl Reason {
    /// The word as published and kept.
    pub fn word(self) -> &'static str {
        match self {
            Self::Turn => "turn",
            Self::Start => "start",
            Self::Stale => "stale",
            Self::Import => "import",
            Self::Log => "log",
        }
    }
}

impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.word())
    }
}
