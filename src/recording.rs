//! The log format: raw readings as CSV, read and written.
//!
//! docs/logs.md describes it; `stretch.rs` has the rules for times.
//!
//! A row whose three magnetometer cells are all empty says nothing of the magnetometer: the format cannot tell an
//! overflow of all three axes from silence.

mod checksum;
mod columns;
mod header;
mod lines;
mod read;
mod rows;
mod stretch;
mod time_of_day;
mod write;

use std::io;

use crate::frame::Mountings;
use crate::reading::Reading;

pub(crate) use checksum::check as check_row;
pub(crate) use columns::names_columns;
pub(crate) use header::{HeaderLines, gives_key, version};
pub(crate) use lines::{CutLine, LineCutter};
pub(crate) use read::Reader;
pub(crate) use rows::Rows;
pub(crate) use time_of_day::{RECORDED_FROM, TimeOfDay};
pub use write::{Writer, written};

/// The first line of every log this version reads and writes, without its `#`.
const MAGIC: &str = "headingd-log";
const VERSION: u32 = 1;

/// The name of the magnetometer of a log that gives none.
pub(crate) const UNKNOWN_SENSOR: &str = "unknown";

/// The known columns, in the order they are written.
pub(crate) const COLUMNS: [&str; 11] = [
    "t_s",
    "mx",
    "my",
    "mz",
    "gx",
    "gy",
    "gz",
    "ax",
    "ay",
    "az",
    "heading_deg",
];
/// Where the columns of each sensor start in [`COLUMNS`].
const MAG: usize = 1;
const GYRO: usize = 4;
const ACCEL: usize = 7;
const HEADING: usize = 10;

/// The `#` lines of a log. Units are not here: readings are always in ours.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Header {
    /// The magnetometer's name: `hmc5843`.
    pub sensor: Option<String>,
    /// How the chips are mounted in the body frame.
    pub mountings: Mountings,
    /// The other `# key = value` lines in their order: a simulated log keeps its parameters here.
    pub truth: Vec<(String, String)>,
}

impl Header {
    /// The magnetometer's name, or "unknown".
    pub fn sensor_name(&self) -> &str {
        self.sensor.as_deref().unwrap_or(UNKNOWN_SENSOR)
    }

    /// The time of day of the first reading as the log has it, RFC 3339.
    pub fn recorded_from(&self) -> Option<&str> {
        let mut lines = self.truth.iter();
        let (_, time) = lines.rfind(|(key, _)| key == RECORDED_FROM)?;
        Some(time)
    }
}

/// One row of a log.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Entry {
    /// The reading.
    pub reading: Reading,
    /// True heading of body X at that time, if the log knows it: degrees in [0, 360), clockwise from
    /// magnetic north.
    pub heading_truth_deg: Option<f64>,
}

/// Why a log cannot be read, or not any further; the text names the log.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// What was read cannot be used as a log.
    #[error("{0}")]
    Data(String),
    /// The log cannot be opened, or its input failed.
    #[error("{0}")]
    Input(String),
}

impl RecordingError {
    /// The input failed after this line, from 1; 0 if none was read.
    fn broken_off(log: &str, line: u64, source: io::Error) -> Self {
        Self::Input(format!("cannot read log {log} after line {line}: {source}"))
    }
}

/// Where something was found in a log, for messages.
fn place(log: &str, line: u64) -> String {
    format!("log {log}, line {line}")
}

/// Counts the rows that were skipped, and keeps why the first was: the one worth showing.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Skips {
    kept: u64,
    count: u64,
    first: Option<String>,
}

impl Skips {
    /// Counts a row that cannot be used; `why` has its line.
    fn skip(&mut self, why: String) {
        self.count += 1;
        self.first.get_or_insert(why);
    }

    /// Whether there was no row at all.
    pub fn is_empty(&self) -> bool {
        self.count + self.kept == 0
    }

    /// Whether more rows were skipped than kept.
    pub fn are_most(&self) -> bool {
        self.count > self.kept
    }

    /// For people: how many rows were skipped, and why the first; `None` if none was.
    pub fn summary(&self) -> Option<String> {
        let first = self.first()?;
        let rows = if self.count == 1 { "row" } else { "rows" };
        Some(format!("{} {rows} skipped; the first: {first}", self.count))
    }

    /// Where the first skipped row is, and what is wrong with it.
    pub fn first(&self) -> Option<&str> {
        self.first.as_deref()
    }
}

/// Text of a log or a line as an error message shows it: quoted, escaped and not too long.
pub(crate) fn shown(text: &[u8]) -> String {
    const LONGEST: usize = 40;
    let text = String::from_utf8_lossy(&text[..text.len().min(4 * LONGEST)]);
    if text.chars().count() > LONGEST {
        let start: String = text.chars().take(LONGEST).collect();
        format!("{start:?}…")
    } else {
        format!("{text:?}")
    }
}
