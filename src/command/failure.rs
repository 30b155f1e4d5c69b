//! Exit statuses, and the errors of the rooms below that become one.

use std::fmt;
use std::io::{self, Write};

use crate::logging;
use crate::recording::RecordingError;
use crate::store::StoreError;

/// Why a command failed: what the shell and the user are told.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{message}")]
pub struct Failure {
    /// Exit status: one of the constants here.
    pub status: u8,
    /// What went wrong; may have several lines. Empty: it has been said.
    pub message: String,
}

impl Failure {
    /// Wrong arguments (as clap has it).
    pub const USAGE: u8 = 2;
    /// The work was done, and the answer is no: a calibration that was refused, chips that are not well.
    pub const REFUSED: u8 = 3;
    /// Data that cannot be understood (EX_DATAERR in sysexits.h).
    pub const DATA: u8 = 65;
    /// No such input file, or it cannot be read (EX_NOINPUT).
    pub const NO_INPUT: u8 = 66;
    /// A service or device is not there (EX_UNAVAILABLE).
    pub const UNAVAILABLE: u8 = 69;
    /// The system refused something that it should give: a thread, a signal (EX_OSERR).
    pub const SYSTEM: u8 = 71;
    /// An output file cannot be created (EX_CANTCREAT).
    pub const CANNOT_CREATE: u8 = 73;
    /// Reading or writing failed on the way (EX_IOERR).
    pub const IO: u8 = 74;
    /// Not allowed (EX_NOPERM).
    pub const NO_PERMISSION: u8 = 77;
    /// A wrong configuration (EX_CONFIG).
    pub const CONFIG: u8 = 78;

    pub fn new(status: u8, message: impl fmt::Display) -> Self {
        Self {
            status,
            message: message.to_string(),
        }
    }

    /// Says on standard error what went wrong; in the journal as an error, each line of it.
    pub fn tell(&self) {
        let priority = if logging::to_journal() { "<3>" } else { "" };
        for line in self.message.lines() {
            let _ = writeln!(io::stderr(), "{priority}headingd: {line}");
        }
    }
}

/// Turns an error into a [`Failure`] that says what was being done.
pub trait OrFail<T> {
    /// The error becomes `what: error`, with this exit status.
    fn or_fail(self, status: u8, what: impl fmt::Display) -> Result<T, Failure>;
}

impl<T, E: fmt::Display> OrFail<T> for Result<T, E> {
    fn or_fail(self, status: u8, what: impl fmt::Display) -> Result<T, Failure> {
        self.map_err(|error| Failure::new(status, format!("{what}: {error}")))
    }
}

/// The status of a log that cannot be used.
pub fn log_status(error: &RecordingError) -> u8 {
    match error {
        RecordingError::Data(_) => Failure::DATA,
        RecordingError::Input(_) => Failure::NO_INPUT,
    }
}

impl From<RecordingError> for Failure {
    fn from(error: RecordingError) -> Self {
        Self::new(log_status(&error), error)
    }
}

impl From<StoreError> for Failure {
    fn from(error: StoreError) -> Self {
        let status = match error {
            StoreError::Read { .. } => Self::NO_INPUT,
            StoreError::Format { .. } => Self::DATA,
            StoreError::InUse { .. } => Self::UNAVAILABLE,
            StoreError::Unsavable { .. } => Self::IO,
            StoreError::Directory { .. } | StoreError::Write { .. } => Self::CANNOT_CREATE,
        };
        Self::new(status, error)
    }
}
