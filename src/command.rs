//! Commands, one file each; the command line; exit statuses.

use std::fmt;
use std::io::{self, Write};
use std::ops::RangeInclusive;
use std::path::Path;

use clap::builder::{PossibleValuesParser, TypedValueParser};
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

use crate::logging;
use crate::recording::{Entry, RecordingError, Skips};
use crate::sensor::replay::Replay;
use crate::store::{Contents, Store, StoreError, replace_file};

mod align;
mod calibrate;
mod calibration;
mod check;
pub mod cli;
mod config;
mod config_file;
mod control;
mod demo;
mod field;
mod headings;
mod monitor;
mod mounting;
mod overwrite;
mod progress;
mod record;
mod replay;
mod report;
mod run;
mod runtime;
mod simulate;
mod status;
mod wait;
mod watch;

use progress::Progress;

/// Why a command failed: what the shell and the user are told.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{message}")]
struct Failure {
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
trait OrFail<T> {
    /// The error becomes `what: error`, with this exit status.
    fn or_fail(self, status: u8, what: impl fmt::Display) -> Result<T, Failure>;
}

impl<T, E: fmt::Display> OrFail<T> for Result<T, E> {
    fn or_fail(self, status: u8, what: impl fmt::Display) -> Result<T, Failure> {
        self.map_err(|error| Failure::new(status, format!("{what}: {error}")))
    }
}

/// Says this on standard error. Nobody reads it where that is gone; eprintln! would panic.
fn tell(text: impl fmt::Display) {
    let _ = writeln!(io::stderr(), "headingd: {text}");
}

/// What has come of writing to standard output. A reader that has gone away (`| head`) ends the command, which is no failure.
fn output<T>(written: io::Result<T>) -> Result<T, Failure> {
    written.map_err(|error| match error.kind() {
        io::ErrorKind::BrokenPipe => Failure::new(0, ""),
        _ => Failure::new(
            Failure::IO,
            format!("cannot write to standard output: {error}"),
        ),
    })
}

fn print(text: &str) -> Result<(), Failure> {
    write_out(Path::new("-"), text.as_bytes())
}

/// Replaces a file as a whole; "-" is standard output.
fn write_out(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    if path == Path::new("-") {
        let mut out = io::stdout().lock();
        return output(out.write_all(bytes).and_then(|()| out.flush()));
    }
    let what = format!("cannot write {}", path.display());
    replace_file(path, bytes).or_fail(Failure::CANNOT_CREATE, what)
}

/// Writes a calibration file; "-" is standard output.
fn write_calibrations(path: &Path, contents: &Contents) -> Result<(), Failure> {
    if path == Path::new("-") {
        let json = contents.to_json();
        return print(&json.map_err(|why| Failure::new(Failure::DATA, why))?);
    }
    Ok(Store::write_file(path, contents)?)
}

/// Writes a value to standard output, as one line of JSON.
fn print_json(value: &impl Serialize) -> Result<(), Failure> {
    let json = serde_json::to_string(value).or_fail(Failure::IO, "cannot write JSON")?;
    print(&(json + "\n"))
}

/// A text of an object that the daemon sent; empty where it has none.
fn text<'a>(object: &'a Value, key: &str) -> &'a str {
    object[key].as_str().unwrap_or_default()
}

/// Reads an option that is a number within a range; `what` says of what: "a number of seconds".
fn number(
    what: &'static str,
    range: RangeInclusive<f64>,
) -> impl Fn(&str) -> Result<f64, String> + Clone + Send + Sync + 'static {
    move |text| {
        let number = text.parse().ok().filter(|number| range.contains(number));
        let (least, most) = range.clone().into_inner();
        number.ok_or_else(|| format!("must be {what} from {least} to {most}"))
    }
}

/// Reads an option whose words are those of the configuration.
fn word<T>(words: &'static [&'static str]) -> impl TypedValueParser<Value = T>
where
    T: DeserializeOwned + Clone + Send + Sync + 'static,
{
    PossibleValuesParser::new(words).try_map(|word| serde_json::from_value(word.into()))
}

/// Reads a log to its end, beside a bar on a terminal. Hands over each entry, and whether a new stretch begins with it.
fn read_log(
    mut log: Replay,
    mut take: impl FnMut(Entry, bool) -> Result<(), Failure>,
) -> Result<Skips, Failure> {
    let mut bar = Progress::new();
    while let Some(entry) = log.next() {
        take(entry?, log.begins_stretch())?;
        bar.follow(&log);
    }
    if log.skips().is_empty() {
        let log = log.name().to_owned();
        return Err(RecordingError::Empty { log }.into());
    }
    Ok(log.skips().clone())
}

/// Where a log's time jumps, what follows is taken as so much later: longer than any gyro's gap, seconds.
const STRETCHES_APART_S: f64 = 10.0;

/// Like `read_log`, with times that go on where those of the log jump.
fn read_log_on(
    log: Replay,
    mut take: impl FnMut(Entry, bool) -> Result<(), Failure>,
) -> Result<Skips, Failure> {
    let (mut last_s, mut later_s) = (0.0, 0.0);
    read_log(log, |mut entry, begins_stretch| {
        if begins_stretch {
            later_s = last_s + STRETCHES_APART_S - entry.reading.t_s;
        }
        entry.reading.t_s += later_s;
        last_s = entry.reading.t_s;
        take(entry, begins_stretch)
    })
}

/// Says on standard error that rows of a log were skipped, if some were; that most were is a failure.
fn tell_skips(skips: &Skips) -> Result<(), Failure> {
    let Some(summary) = skips.summary() else {
        return Ok(());
    };
    if skips.are_most() {
        let message = format!("most of the log cannot be used: {summary}");
        return Err(Failure::new(Failure::DATA, message));
    }
    tell(summary);
    Ok(())
}

/// Says on standard error how many values of a log were dropped that no sensor can have taken, if some were.
fn tell_dropped(count: u64) {
    if count > 0 {
        let values = if count == 1 { "value" } else { "values" };
        tell(format_args!(
            "{count} {values} dropped that no sensor can have taken"
        ));
    }
}

/// The status of a log that cannot be used.
fn log_status(error: &RecordingError) -> u8 {
    match error {
        RecordingError::Header { .. }
        | RecordingError::Empty { .. }
        | RecordingError::Times { .. } => Failure::DATA,
        RecordingError::Open { .. } | RecordingError::Read { .. } => Failure::NO_INPUT,
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
            StoreError::Unreadable { .. } | StoreError::Newer { .. } => Self::DATA,
            StoreError::InUse { .. } => Self::UNAVAILABLE,
            StoreError::Unsavable { .. } => Self::IO,
            StoreError::Directory { .. } | StoreError::Write { .. } => Self::CANNOT_CREATE,
        };
        Self::new(status, error)
    }
}
