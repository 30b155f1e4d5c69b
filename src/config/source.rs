//! Table `[source]`: where readings come from.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::check::{Fault, settings};

settings! {
    /// Where readings come from, and how fast.
    pub struct Settings {
        /// What the source is. There is no default: whoever reads headings must know where they come from.
        kind: Option<Kind> = None;
        /// The log to replay; of no effect with other kinds. A relative path starts in the working folder. Empty: none.
        log: PathBuf = PathBuf::new();
        /// How fast a log is replayed or a simulation runs, in times real time. Of no effect with
        /// real devices.
        speed: f64 = 1.0, 0.1..=1000.0, "times real time";
    }
    compares Settings::check_log;
}

/// The kinds of source.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// A simulated board: table `[simulator]`.
    Simulator,
    /// A recorded log.
    Replay,
    /// Chips on an I2C bus: table `[i2c]`.
    I2c,
    /// A board behind a serial line: table `[serial]`.
    Serial,
}

impl Settings {
    /// What to do where no source is set.
    pub const UNSET: &str = "source.kind is not set, so there are no readings: in table [source], write kind = \"i2c\" \
                             for chips on an I2C bus, \"serial\" for a board behind a serial line, \"replay\" for a \
                             log, or \"simulator\" to try headingd with invented readings";

    /// Whether the readings are taken now, by a real device.
    pub fn is_live(&self) -> bool {
        matches!(self.kind, Some(Kind::I2c | Kind::Serial))
    }

    /// How fast time goes: a real device has the pace it has.
    pub fn pace(&self) -> f64 {
        if self.is_live() { 1.0 } else { self.speed }
    }

    fn check_log(&self, faults: &mut Vec<Fault>) {
        let found = match self.log.to_str() {
            Some("") => "empty",
            Some("-") => "standard input",
            _ => return,
        };
        if self.kind == Some(Kind::Replay) {
            faults.push(Fault::new("log", found, "the path of the log to replay"));
        }
    }
}
