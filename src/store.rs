//! The calibration that survives a restart.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::check::{Check, Fault};

/// Where the calibration is kept.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// The folder that the calibration is kept in, an absolute path. Empty: it is not kept, and each
    /// start begins uncalibrated.
    pub directory: PathBuf,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            directory: PathBuf::from("/var/lib/headingd"),
        }
    }
}

impl Settings {
    /// The folder, if the calibration is to be kept.
    pub fn directory(&self) -> Option<&Path> {
        (!self.directory.as_os_str().is_empty()).then_some(&self.directory)
    }
}

impl Check for Settings {
    fn check(&self) -> Vec<Fault> {
        match self.directory() {
            // The folder that a daemon happens to be started in is no place to look for it next time.
            Some(directory) if directory.is_relative() => vec![Fault {
                key: "directory".to_owned(),
                found: format!("{directory:?}"),
                right: "an absolute path, or empty to keep nothing".to_owned(),
            }],
            _ => Vec::new(),
        }
    }
}
