//! Table `[log]`: the daemon's own log.

use serde::{Deserialize, Serialize};
use tracing_subscriber::EnvFilter;

use crate::check::{Check, Fault};

/// What goes to the system's journal.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// A level (`off`, `error`, `warn`, `info`, `debug`, `trace`), or several of the form `target=level`
    /// with commas between them.
    pub filter: String,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            filter: "info".to_owned(),
        }
    }
}

impl Check for Settings {
    fn check(&self) -> Vec<Fault> {
        const LEVELS: [&str; 6] = ["off", "error", "warn", "info", "debug", "trace"];
        // The parser takes a misspelt level for the name of a target, and then shows nothing else.
        let misspelt = !self.filter.contains('[')
            && self.filter.split(',').any(|part| {
                let part = part.trim();
                !part.contains('=') && !LEVELS.iter().any(|level| level.eq_ignore_ascii_case(part))
            });
        if !misspelt && EnvFilter::try_new(&self.filter).is_ok() {
            return Vec::new();
        }
        vec![Fault {
            key: "filter".to_owned(),
            found: format!("{:?}", self.filter),
            right: format!(
                "one of {}, or target=level with commas between",
                LEVELS.join(", ")
            ),
        }]
    }
}
