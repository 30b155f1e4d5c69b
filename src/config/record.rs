//! Table `[record]`: raw readings kept in a ring of log files.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::check::{Check, Fault, within};

/// Where raw readings are kept, and how many.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// A folder, absolute; it is made if it is missing. Empty: nothing is recorded.
    pub directory: PathBuf,
    /// How many files are kept, 2 to 1000; then the oldest goes.
    pub files: usize,
    /// How long a file becomes, 1 to 1024 MiB.
    pub file_mib: u64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            directory: PathBuf::new(),
            files: 12,
            file_mib: 32,
        }
    }
}

impl Check for Settings {
    fn check(&self) -> Vec<Fault> {
        let mut faults = Vec::new();
        if !self.directory.as_os_str().is_empty() && !self.directory.is_absolute() {
            faults.push(Fault {
                key: "directory".to_owned(),
                found: format!("{:?}", self.directory),
                right: "an absolute path, or empty".to_owned(),
            });
        }
        within(&mut faults, "files", self.files, 2..=1000, "files");
        within(&mut faults, "file_mib", self.file_mib, 1..=1024, "MiB");
        faults
    }
}
