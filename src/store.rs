//! The calibrations that survive a restart.
//!
//! One file, `calibration.json`, with a history for each sensor, replaced as a whole: whenever the power goes, either
//! the old file or the new one is there. A file that this program did not understand, or that somebody else has
//! changed meanwhile, is never lost: it is set aside first.

mod disk;
mod format;
pub mod history;
mod plausible;

use std::fs::{self, File};
use std::io::{self, Read};
use std::os::fd::AsFd;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::check::{absolute_or_empty, settings};
use crate::lock_file::{LockError, LockFile};
pub(crate) use disk::replace_file;
pub use format::{CalibrationFile, FormatError};
pub use history::{BoardMounting, CalibrationRecord, History, Identity, KeptCalibration};

const FILE_NAME: &str = "calibration.json";

/// Longest file, bytes: a calibration has up to 4 kB, and each sensor up to a hundred of them.
const LONGEST: u64 = 1 << 24;

settings! {
    /// Where the calibration is kept.
    #[derive(Eq)]
    pub struct Settings {
        /// The folder that the calibration is kept in, an absolute path, since a relative one would depend on where the
        /// daemon is started. Empty: it is not kept, and each start begins uncalibrated.
        directory: PathBuf = PathBuf::from("/var/lib/headingd")
            => |key, path| absolute_or_empty(key, path, "an absolute path, or empty to keep nothing");
        /// How many calibrations of a sensor are kept; then the oldest goes.
        history: usize = 10, 1..=100, "calibrations";
    }
}

impl Settings {
    /// The folder, if the calibration is to be kept.
    pub fn directory(&self) -> Option<&Path> {
        (!self.directory.as_os_str().is_empty()).then_some(&self.directory)
    }
}

/// What went wrong with a calibration file or its folder, and with which one.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// The folder cannot be used.
    #[error("cannot keep calibrations in folder {}: {}", .0.display(), .1)]
    Directory(PathBuf, #[source] io::Error),
    /// Another process has the folder: this one, if it is known.
    #[error(
        "cannot keep calibrations in folder {}: another daemon keeps its own there{}; stop it, or name another \
         folder",
        .0.display(), .1.map(|pid| format!(" (process {pid})")).unwrap_or_default()
    )]
    InUse(PathBuf, Option<u32>),
    /// The file cannot be read.
    #[error("cannot read calibration {}: {}", .0.display(), .1)]
    Read(PathBuf, #[source] io::Error),
    /// The file can be read, but is no calibration that can be used, and why.
    #[error("{} is not a usable calibration file: {}", .0.display(), .1)]
    Format(PathBuf, #[source] FormatError),
    /// The calibration has values that cannot be kept, and which. The file is as it was.
    #[error("cannot save calibration {}: {}", .0.display(), .1)]
    Unsavable(PathBuf, String),
    /// The file cannot be written.
    #[error("cannot save calibration {}: {}", .0.display(), .1)]
    Write(PathBuf, #[source] io::Error),
}

/// A folder that calibrations are kept in.
#[derive(Clone, Debug)]
pub struct Store {
    directory: PathBuf,
    /// Nobody else changes anything there meanwhile.
    _lock: Arc<LockFile>,
}

impl Store {
    /// Opens the folder, or makes it, and sees whether it can be written. No other process can open it until this and its
    /// clones are dropped; this one can.
    ///
    /// # Errors
    ///
    /// When the folder cannot be made or used, or when another process has it.
    pub fn open(directory: &Path) -> Result<Self, StoreError> {
        let store = Self::claim(directory)?;
        store.probe()?;
        Ok(store)
    }

    /// The same without testing whether the folder can be written: on a full disk too, nobody else gets it.
    ///
    /// # Errors
    ///
    /// When the folder cannot be made, or when another process has it.
    pub fn claim(directory: &Path) -> Result<Self, StoreError> {
        let fail = |error| StoreError::Directory(directory.to_owned(), error);
        fs::create_dir_all(directory).map_err(|error| {
            fail(if directory.is_file() {
                io::Error::new(error.kind(), "it is a file, not a folder")
            } else {
                error
            })
        })?;
        let lock = LockFile::of_folder(directory).map_err(|error| match error {
            LockError::Held(pid) => StoreError::InUse(directory.to_owned(), pid),
            LockError::System(error) => fail(error),
        })?;
        Ok(Self {
            directory: directory.to_owned(),
            _lock: lock,
        })
    }

    /// Writes a probe: better now than after the first turn.
    ///
    /// # Errors
    ///
    /// When the folder cannot be written.
    pub fn probe(&self) -> Result<(), StoreError> {
        let fail = |error| StoreError::Directory(self.directory.clone(), error);
        disk::remove_leftovers(&self.directory, FILE_NAME).map_err(fail)?;
        let probe = disk::written(&self.directory, FILE_NAME, b"probe").map_err(fail)?;
        probe.close().map_err(fail)
    }

    /// Keeps this in place of `known`, which is what was loaded or saved last for this sensor. What is kept for
    /// other sensors stays. A file that could not be used, or in which somebody else has changed what is kept for
    /// this sensor, is set aside; its new path is given back. After an error the file
    /// is the old one or the new one.
    ///
    /// # Errors
    ///
    /// When the folder or the file cannot be written.
    pub fn save(
        &self,
        history: &History,
        known: Option<&History>,
    ) -> Result<Option<PathBuf>, StoreError> {
        let path = self.path();
        let fail = |error| StoreError::Write(path.clone(), error);
        let (mut contents, reason) = match Self::contents(&self.directory) {
            Ok(contents) => {
                let found = contents.find(&history.identity);
                // After an error in syncing the folder, it may hold this one already.
                let ours = [known, Some(history), None].contains(&found);
                let reason = (!ours).then_some("changed");
                (contents, reason)
            }
            Err(StoreError::Format(_, FormatError::Newer(_))) => {
                (CalibrationFile::default(), Some("newer"))
            }
            Err(_) => (CalibrationFile::default(), Some("unreadable")),
        };
        contents.put(history.clone());
        let unsavable = |why| StoreError::Unsavable(path.clone(), why);
        let text = contents.to_json().map_err(&unsavable)?;
        if text.len() as u64 > LONGEST {
            let why = format!("it would be longer than {LONGEST} bytes");
            return Err(unsavable(why));
        }
        // Nothing is changed before the new file is safe on disk.
        let new = disk::written(&self.directory, FILE_NAME, text.as_bytes()).map_err(fail)?;
        let aside = reason.map(|reason| disk::set_aside(&path, reason));
        let aside = aside.transpose().map_err(fail)?;
        new.persist(&path).map_err(|error| fail(error.error))?;
        disk::sync_folder(&self.directory).map_err(fail)?;
        Ok(aside)
    }

    /// All that is kept in a folder, whoever has it; nothing, if it has no file yet. A file that cannot be used stays as it is.
    ///
    /// # Errors
    ///
    /// When the file cannot be read, or does not hold calibrations.
    pub fn contents(directory: &Path) -> Result<CalibrationFile, StoreError> {
        let path = Self::file_in(directory);
        match fs::metadata(&path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(CalibrationFile::default()),
            // A pipe would be waited for, and a device has no end.
            Ok(found) if !found.is_file() => {
                let why = FormatError::Unreadable("it is no regular file".to_owned());
                Err(StoreError::Format(path, why))
            }
            _ => Self::read_file(&path),
        }
    }

    /// What any calibration file holds; "-" is standard input.
    ///
    /// # Errors
    ///
    /// When the file cannot be read, or does not hold calibrations.
    pub fn read_file(path: &Path) -> Result<CalibrationFile, StoreError> {
        let opened = match path.to_str() {
            Some("-") => io::stdin().as_fd().try_clone_to_owned().map(File::from),
            _ => File::open(path),
        };
        let mut bytes = Vec::new();
        opened
            .and_then(|file| file.take(LONGEST + 1).read_to_end(&mut bytes))
            .map_err(|error| StoreError::Read(path.to_owned(), error))?;
        let contents = if bytes.len() as u64 > LONGEST {
            let why = format!("it is longer than {LONGEST} bytes");
            Err(FormatError::Unreadable(why))
        } else {
            CalibrationFile::from_json(&bytes)
        };
        contents.map_err(|error| StoreError::Format(path.to_owned(), error))
    }

    /// The file that the calibrations are kept in.
    pub fn path(&self) -> PathBuf {
        Self::file_in(&self.directory)
    }

    /// The same of any folder.
    pub fn file_in(directory: &Path) -> PathBuf {
        directory.join(FILE_NAME)
    }
}
