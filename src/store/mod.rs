//! The calibration that survives a restart.
//!
//! One file, `calibration.json`, replaced as a whole: whenever the power goes, either the old
//! calibration or the new one is there. A file that this program did not understand, or that belongs to
//! another sensor, is never overwritten: it is set aside first.

mod format;

use std::fmt;
use std::fs::{self, File, OpenOptions, Permissions};
use std::io::{self, Read, Write};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::calibration::model::Calibration;
use crate::check::{Check, Fault};
use crate::frame::Mounting;
use format::FormatError;

const FILE_NAME: &str = "calibration.json";
const TEMPORARY_SUFFIX: &str = ".tmp";

/// Longest file that is read, bytes: a calibration has one or two thousand.
const LONGEST: u64 = 1 << 20;

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

/// Which sensor a calibration holds for, and how it is mounted.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Identity {
    /// The sensor's name, such as `hmc5843`.
    pub sensor: String,
    /// The magnetometer's mounting.
    pub mag_axes: Mounting,
}

impl fmt::Display for Identity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} mounted {}", self.sensor, self.mag_axes)
    }
}

/// A calibration as it is kept.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Stored {
    /// The sensor that it holds for.
    #[serde(flatten)]
    pub identity: Identity,
    /// When it was saved, seconds since 1970-01-01 UTC.
    pub saved_unix_s: u64,
    /// The calibration.
    pub calibration: Calibration,
}

/// What a store holds for a sensor.
#[derive(Clone, Debug, PartialEq)]
pub enum Loaded {
    /// Nothing yet.
    None,
    /// A calibration of this sensor.
    Found(Stored),
    /// A calibration of another sensor, or of another mounting: it must not be used.
    OtherSensor(Stored),
}

/// What went wrong with a calibration file.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// The folder cannot be used.
    #[error(
        "cannot keep calibrations in folder {}: {source}; set store.directory to a folder that this user may write, \
         or start the daemon with StateDirectory=headingd in its systemd unit",
        directory.display()
    )]
    Directory {
        /// The folder.
        directory: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The file cannot be read.
    #[error("cannot read calibration {}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The file can be read, but is no calibration: half-written or damaged.
    #[error("{} is not a usable calibration file: {why}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// What is wrong in it.
        why: String,
    },
    /// A newer program wrote the file.
    #[error(
        "calibration {} has version {version}, which this program is too old to read",
        path.display()
    )]
    Newer {
        /// The file.
        path: PathBuf,
        /// Its version.
        version: u64,
    },
    /// The calibration has values that cannot be kept. The file is as it was.
    #[error("cannot save calibration {}: {why}", path.display())]
    Unsavable {
        /// The file.
        path: PathBuf,
        /// What is wrong with the calibration.
        why: String,
    },
    /// The file cannot be written.
    #[error("cannot save calibration {}: {source}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
}

/// A folder that a calibration is kept in.
#[derive(Clone, Debug)]
pub struct Store {
    directory: PathBuf,
}

impl Store {
    /// Opens the folder, or makes it. Fails if nothing can be written there: better now than after
    /// the first turn.
    pub fn open(directory: &Path) -> Result<Self, StoreError> {
        let fail = |source| StoreError::Directory {
            directory: directory.to_owned(),
            source,
        };
        fs::create_dir_all(directory).map_err(fail)?;
        let store = Self {
            directory: directory.to_owned(),
        };
        store.remove_leftovers().map_err(fail)?;
        let mut probe = temporary(directory, FILE_NAME).map_err(fail)?;
        probe.write_all(b"probe").map_err(fail)?;
        probe.close().map_err(fail)?;
        Ok(store)
    }

    /// The folder as it is, without a look at it: for reading, where nothing can be written.
    pub fn unchecked(directory: &Path) -> Self {
        Self {
            directory: directory.to_owned(),
        }
    }

    /// The calibration kept for this sensor. A file that cannot be used is an error, and stays as it is.
    pub fn load(&self, identity: &Identity) -> Result<Loaded, StoreError> {
        match Self::read_file(&self.path()) {
            Ok(stored) if stored.identity == *identity => Ok(Loaded::Found(stored)),
            Ok(stored) => Ok(Loaded::OtherSensor(stored)),
            Err(StoreError::Read { source, .. }) if source.kind() == io::ErrorKind::NotFound => {
                Ok(Loaded::None)
            }
            Err(error) => Err(error),
        }
    }

    /// Keeps a calibration in place of the last one. A file that could not be used, or is another
    /// sensor's, is set aside first; its new path is given back. After an error the old file is intact.
    pub fn save(&self, stored: &Stored) -> Result<Option<PathBuf>, StoreError> {
        let path = self.path();
        let text = text(&path, stored)?;
        let fail = |source| StoreError::Write {
            path: path.clone(),
            source,
        };
        let reason = match self.load(&stored.identity) {
            Ok(Loaded::None | Loaded::Found(_)) => None,
            Ok(Loaded::OtherSensor(_)) => Some("other"),
            Err(_) => Some("unreadable"),
        };
        // Only with the new file safe on disk does the old one move.
        let new = written(&self.directory, FILE_NAME, &text).map_err(fail)?;
        let aside = reason.map(|reason| set_aside(&path, reason)).transpose();
        let aside = aside.map_err(fail)?;
        new.persist(&path).map_err(|error| fail(error.error))?;
        sync_folder(&self.directory).map_err(fail)?;
        Ok(aside)
    }

    /// The calibration in any file.
    pub fn read_file(path: &Path) -> Result<Stored, StoreError> {
        let mut bytes = Vec::new();
        File::open(path)
            .and_then(|file| file.take(LONGEST + 1).read_to_end(&mut bytes))
            .map_err(|source| StoreError::Read {
                path: path.to_owned(),
                source,
            })?;
        let unreadable = |why| StoreError::Unreadable {
            path: path.to_owned(),
            why,
        };
        if bytes.len() as u64 > LONGEST {
            return Err(unreadable(format!("it is longer than {LONGEST} bytes")));
        }
        format::read(&bytes).map_err(|error| match error {
            FormatError::Unreadable(why) => unreadable(why),
            FormatError::Newer(version) => StoreError::Newer {
                path: path.to_owned(),
                version,
            },
        })
    }

    /// Writes a calibration to any file, in place of what it held. After an error a regular file is as
    /// it was.
    pub fn write_file(path: &Path, stored: &Stored) -> Result<(), StoreError> {
        let text = text(path, stored)?;
        replace(path, &text).map_err(|source| StoreError::Write {
            path: path.to_owned(),
            source,
        })
    }

    /// The file that the calibration is kept in.
    pub fn path(&self) -> PathBuf {
        self.directory.join(FILE_NAME)
    }

    /// Removes what a process left that was killed while it saved.
    fn remove_leftovers(&self) -> io::Result<()> {
        for entry in fs::read_dir(&self.directory)? {
            let entry = entry?;
            let name = entry.file_name();
            let name = name.to_string_lossy();
            if name.starts_with(&temporary_prefix(FILE_NAME)) && name.ends_with(TEMPORARY_SUFFIX) {
                fs::remove_file(entry.path())?;
            }
        }
        Ok(())
    }
}

fn text(path: &Path, stored: &Stored) -> Result<String, StoreError> {
    format::write(stored).map_err(|why| StoreError::Unsavable {
        path: path.to_owned(),
        why,
    })
}

/// Replaces a file's content as a whole.
fn replace(path: &Path, text: &str) -> io::Result<()> {
    // A link keeps pointing where it did, and a device or pipe is written to, not replaced.
    let path = match fs::canonicalize(path) {
        Ok(path) => path,
        Err(error) if error.kind() == io::ErrorKind::NotFound => path.to_owned(),
        Err(error) => return Err(error),
    };
    if path.exists() && !path.is_file() {
        let mut device = OpenOptions::new().write(true).open(&path)?;
        return device.write_all(text.as_bytes());
    }
    let directory = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    written(directory, &name, text)?.persist(&path)?;
    sync_folder(directory)
}

fn temporary_prefix(name: &str) -> String {
    format!(".{name}.")
}

fn temporary(directory: &Path, name: &str) -> io::Result<tempfile::NamedTempFile> {
    tempfile::Builder::new()
        .prefix(&temporary_prefix(name))
        .suffix(TEMPORARY_SUFFIX)
        // A calibration is no secret; the umask still applies.
        .permissions(Permissions::from_mode(0o644))
        .tempfile_in(directory)
}

/// A temporary file with this content, safe on disk.
fn written(directory: &Path, name: &str, text: &str) -> io::Result<tempfile::NamedTempFile> {
    let mut file = temporary(directory, name)?;
    file.write_all(text.as_bytes())?;
    file.as_file().sync_all()?;
    Ok(file)
}

/// Makes a rename last: it is the folder that has changed.
fn sync_folder(directory: &Path) -> io::Result<()> {
    File::open(directory)?.sync_all()
}

/// Renames the file to `<path>.<reason>-<n>`, n the first free number.
fn set_aside(path: &Path, reason: &str) -> io::Result<PathBuf> {
    let mut number = 1_u32;
    loop {
        let mut name = path.as_os_str().to_owned();
        name.push(format!(".{reason}-{number}"));
        let aside = PathBuf::from(name);
        if fs::symlink_metadata(&aside).is_err() {
            fs::rename(path, &aside)?;
            return Ok(aside);
        }
        number += 1;
    }
}
