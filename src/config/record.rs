//! Table `[record]`: raw readings kept in a ring of log files.

use std::path::{Path, PathBuf};

use crate::check::{absolute_or_empty, settings};

settings! {
    /// Where raw readings are kept, and how many.
    #[derive(Eq)]
    pub struct Settings {
        /// A folder, absolute; it is made if it is missing. Empty: nothing is recorded.
        directory: PathBuf = PathBuf::new()
            => |key, path| absolute_or_empty(key, path, "an absolute path, or empty");
        /// How many full files have room; beyond that the oldest goes. A file that is not full counts by its size.
        files: usize = 12, 2..=1000, "files";
        /// How long a file becomes.
        file_mib: u64 = 32, 1..=1024, "MiB";
    }
}

impl Settings {
    /// The folder, if anything is to be recorded.
    pub fn directory(&self) -> Option<&Path> {
        (!self.directory.as_os_str().is_empty()).then_some(&self.directory)
    }

    /// How long a file becomes, bytes.
    pub fn file_bytes(&self) -> u64 {
        self.file_mib << 20
    }
}
