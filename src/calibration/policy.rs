//! When the daemon calibrates, and where a calibration came from.

use crate::check::words;

words! {
    /// Whether the daemon calibrates by itself.
    #[derive(Default)]
    pub enum Policy {
        /// On every full turn, and on other motion.
        #[default]
        On = "on",
        /// Only on request.
        Off = "off",
        /// While a calibration is active, never: it is not replaced.
        Locked = "locked",
    }
}

impl Policy {
    /// For people: what helps where no calibration is active.
    pub fn remedy(self) -> &'static str {
        match self {
            Self::On | Self::Locked => "turn the board once",
            Self::Off => "headingd calibration start, and then turn the board once",
        }
    }
}

words! {
    /// What started a calibration, or where it came from.
    pub enum CalibrationOrigin {
        /// The board was turned or moved. Version 0.1 had another word, `stale`, for a turn that was to replace a calibration.
        #[serde(alias = "stale")]
        Turn = "turn",
        /// Somebody asked for it.
        Start = "start",
        /// Somebody brought it in a file.
        Import = "import",
        /// It was made on a recorded log.
        Log = "log",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn origins_of_earlier_versions_are_read() {
        use CalibrationOrigin::{Import, Log, Start, Turn};
        let read = |word: &str| serde_json::from_str::<CalibrationOrigin>(word).unwrap();
        assert_eq!(read("\"stale\""), Turn);
        for origin in [Turn, Start, Import, Log] {
            assert_eq!(read(&format!("{:?}", origin.word())), origin);
        }
    }
}
