//! Reading a log, row by row, in one buffer.

use std::io::BufRead;
use std::iter::from_fn;

use super::header;
use super::lines::{CutLine, LogLine, LogLines};
use super::rows::Rows;
use super::stretch::{self, DroppedRows, TimeOrder};
use super::{Entry, Header, RecordingError, Skips, check_row, place};
use crate::reading::Reading;

/// The unit of the times is checked on the first 1000 rows, for each of gyro and magnetometer with at least 20 steps.
const FIRST_ROWS: usize = 1000;
const FEWEST_STEPS: usize = 20;
/// A median step of this many seconds or more means another unit: 500 Hz in milliseconds has a step of 2.
const LONG_STEP_S: f64 = 2.0;
/// Where the median step is 0 and no other is shorter than this, the times are all the same, or in whole seconds.
const COARSE_STEP_S: f64 = 0.5;

/// Reads a log: the header at once, then an iterator of its rows, in milligauss, rad/s and m/s².
///
/// A row that cannot be used is skipped and counted; a true value that cannot be used is left out. An error means that the input
/// failed, and is the last item. The times of the entries never decrease within a stretch.
#[derive(Debug)]
pub struct Reader<R> {
    log: String,
    lines: LogLines<R>,
    rows: Rows,
    /// A line of another header was found: the rows after it may be in other units.
    other_header: bool,
    /// How many lines of a header have been repeated since its first.
    repeated: Option<usize>,
    last_s: Option<f64>,
    dropped: DroppedRows,
    begins_stretch: bool,
    skips: Skips,
    /// A row whose time is doubtful until the next one is known, and that one.
    doubtful: Option<Numbered>,
    next: Option<Numbered>,
    failure: Option<RecordingError>,
    done: bool,
}

/// A row and the number of its line.
type Numbered = (Entry, u64);

impl<R: BufRead> Reader<R> {
    /// Reads the header. `log` names the log in messages.
    pub fn new(log: impl Into<String>, input: R) -> Result<Self, RecordingError> {
        let log = log.into();
        let mut lines = LogLines::new(input);
        let rows = header::read(&log, &mut lines)?;
        Ok(Self {
            log,
            lines,
            rows,
            other_header: false,
            repeated: None,
            last_s: None,
            dropped: DroppedRows::default(),
            begins_stretch: false,
            skips: Skips::default(),
            doubtful: None,
            next: None,
            failure: None,
            done: false,
        })
    }

    /// The log's name in messages.
    pub fn name(&self) -> &str {
        &self.log
    }

    /// The log's header.
    pub fn header(&self) -> &Header {
        &self.rows.header
    }

    /// The rows skipped so far.
    pub fn skips(&self) -> &Skips {
        &self.skips
    }

    pub(crate) fn input(&self) -> &R {
        &self.lines.input
    }

    /// Looks at the first rows for times that are in another unit.
    pub fn check_times(mut self) -> Result<(), RecordingError> {
        let rows = from_fn(|| self.row()).take(FIRST_ROWS);
        let readings: Vec<Reading> = rows.map(|(entry, _)| entry.reading).collect();
        let has_rate: fn(&Reading) -> bool = |reading| reading.rate_rad_s.is_some();
        let has_field: fn(&Reading) -> bool = |reading| reading.field_mgauss.is_some();
        let column = self.rows.place(0);
        for (sensor, has) in [("gyro", has_rate), ("magnetometer", has_field)] {
            let times = readings.iter().filter(|one| has(one)).map(|one| one.t_s);
            if let Some(what) = fault_of_times(sensor, times.collect(), &column) {
                let log = self.log;
                return Err(RecordingError::Data(format!(
                    "cannot use log {log}: {what}"
                )));
            }
        }
        Ok(())
    }

    /// Whether a new stretch begins with the last entry: its time has nothing to do with those before, or motion was lost before it.
    pub fn begins_stretch(&self) -> bool {
        self.begins_stretch
    }

    /// The next row that can be understood; `None` at the end. Those before it that cannot are skipped.
    fn row(&mut self) -> Option<Numbered> {
        let broken = |what: &str| Err(what.to_owned());
        while !self.done {
            let before = self.lines.number;
            let found = match self.lines.advance() {
                Ok(LogLine::End) => break,
                Ok(LogLine::Cut(CutLine::TooLong)) => {
                    broken("the line is longer than 4 KiB, so it is no row")
                }
                Ok(_) if self.lines.text().trim_ascii().is_empty() => continue,
                Ok(LogLine::Cut(CutLine::Whole)) => self.whole_line(),
                // Its last number may have lost digits and still look like a number.
                Ok(LogLine::CutOff) => {
                    broken("the log ends here without the end of the line: the row was cut off")
                }
                Err(source) => {
                    self.failure = Some(RecordingError::broken_off(&self.log, before, source));
                    break;
                }
            };
            let line = self.lines.number;
            match found {
                Ok(Some(entry)) => return Some((entry, line)),
                Ok(None) => {}
                Err(what) => self.skip(line, &what),
            }
        }
        self.done = true;
        None
    }

    /// The entry in the line; `None` where it is a remark, or belongs to the header, repeated.
    fn whole_line(&mut self) -> Result<Option<Entry>, String> {
        let line = self.lines.text();
        let known = self.rows.is_known_header(line, &mut self.repeated);
        self.other_header |= known.is_err();
        if known? {
            return Ok(None);
        }
        if self.other_header {
            let what = "found a row after another header than the first: split the log there";
            return Err(what.to_owned());
        }
        let (row, _) = check_row(line)?;
        self.rows.row(row).map(Some)
    }

    /// The entry; a row whose time cannot be right is skipped.
    fn judged(&mut self, (entry, line): Numbered, order: TimeOrder) -> Option<Entry> {
        let t_s = entry.reading.t_s;
        if let (TimeOrder::Odd, Some(last_s)) = (order, self.last_s) {
            self.dropped.take(&entry.reading, last_s - t_s);
            let what = if t_s < last_s {
                format!("found time {t_s}, but must be at least {last_s}, that of the row before")
            } else {
                format!(
                    "found time {t_s}, but the row before has {last_s}, and the next does not go on from here"
                )
            };
            self.skip(line, &format!("{}: {what}", self.rows.place(0)));
            return None;
        }
        self.last_s = Some(t_s);
        let lost_motion = std::mem::take(&mut self.dropped).lost_motion();
        self.begins_stretch = order == TimeOrder::Jump || lost_motion;
        self.skips.kept += 1;
        Some(entry)
    }

    fn skip(&mut self, line: u64, what: &str) {
        let place = place(&self.log, line);
        self.skips.skip(format!("{place}: {what}"));
    }
}

impl<R: BufRead> Iterator for Reader<R> {
    type Item = Result<Entry, RecordingError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            let row = self.next.take().or_else(|| self.row());
            let judged = if let (Some(doubtful), Some(last_s)) = (self.doubtful.take(), self.last_s)
            {
                self.next = row;
                let next_s = row.map(|(entry, _)| entry.reading.t_s);
                let order = stretch::before(last_s, doubtful.0.reading.t_s, next_s);
                self.judged(doubtful, order)
            } else if let Some(row) = row {
                let Some(order) = stretch::at_once(self.last_s, row.0.reading.t_s) else {
                    self.doubtful = Some(row);
                    continue;
                };
                self.judged(row, order)
            } else {
                return self.failure.take().map(Err);
            };
            if let Some(entry) = judged {
                return Some(Ok(entry));
            }
        }
    }
}

/// What is wrong with the times of a sensor's readings, which stand in this column.
fn fault_of_times(sensor: &str, times: Vec<f64>, column: &str) -> Option<String> {
    let mut steps: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    steps.sort_by(f64::total_cmp);
    let step = steps.get(steps.len() / 2).copied().unwrap_or_default();
    let fine = |step: &f64| *step > 0.0 && *step < COARSE_STEP_S;
    let coarse = step == 0.0 && !steps.iter().any(fine);
    if steps.len() < FEWEST_STEPS || step < LONG_STEP_S && !coarse {
        return None;
    }
    if coarse {
        return Some(format!(
            "most of the {sensor}'s readings have the same time as the one before in {column}, but each needs the time at \
             which it was taken, in seconds with their fractions"
        ));
    }
    let (unit, divisor) = match step {
        ..1e3 => ("milliseconds", 1000),
        ..1e6 => ("microseconds", 1_000_000),
        _ => ("nanoseconds", 1_000_000_000),
    };
    Some(format!(
        "the {sensor}'s readings are {step:.0} apart in {column}, as in {unit}, but times must be in seconds: divide them by \
         {divisor}"
    ))
}

#[cfg(test)]
mod tests;
