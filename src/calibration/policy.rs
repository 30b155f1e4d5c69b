//! When the daemon calibrates, and what started a calibration.

use serde::{Deserialize, Serialize};

/// Whether the daemon calibrates by itself.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Policy {
    /// On every turn that is seen.
    #[default]
    On,
    /// Only on request.
    Off,
    /// Never, while there is an active calibration: that one is not replaced.
    Locked,
}

impl Policy {
    /// The word as published and kept.
    pub fn word(self) -> &'static str {
        match self {
            Self::On => "on",
            Self::Off => "off",
            Self::Locked => "locked",
        }
    }

    /// For people: what helps where no calibration is active.
    pub fn remedy(self) -> &'static str {
        match self {
            Self::On | Self::Locked => "turn the board once",
            Self::Off => "headingd calibration start, and then turn the board once",
        }
    }
}

/// What started a calibration, or where it came from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Reason {
    /// The board was turned or moved. Version 0.1 told apart turns that were to replace a calibration.
    #[serde(alias = "stale")]
    Turn,
    /// Somebody asked for it.
    Start,
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
            Self::Import => "import",
            Self::Log => "log",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reasons_of_earlier_versions_are_read() {
        let read = |word: &str| serde_json::from_str::<Reason>(word).unwrap();
        assert_eq!(read("\"stale\""), Reason::Turn);
        for reason in [Reason::Turn, Reason::Start, Reason::Import, Reason::Log] {
            assert_eq!(read(&format!("{:?}", reason.word())), reason);
        }
    }
}
