//! Table `[record]`: raw readings kept in a ring of log files.

use std::path::PathBuf;

use crate::check::{Fault, settings};

settings! {
    /// Where raw readings are kept, and how many.
    #[derive(Eq)]
    pub struct Settings {
        /// A folder, absolute; it is made if it is missing. Empty: nothing is recorded.
        directory: PathBuf = PathBuf::new();
        /// How many files are kept; then the oldest goes.
        files: usize = 12, 2..=1000, "files";
        /// How long a file becomes.
        file_mib: u64 = 32, 1..=1024, "MiB";
    }
    also Settings::check_directory;
}

impl Settings {
    fn check_directory(&self, faults: &mut Vec<Fault>) {
        if !self.directory.as_os_str().is_empty() && !self.directory.is_absolute() {
            let found = format!("{:?}", self.directory);
            faults.push(Fault::new("directory", found, "an absolute path, or empty"));
        }
    }
}
