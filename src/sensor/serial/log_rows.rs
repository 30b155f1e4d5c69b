//! headingd's own log rows over a line, with or without their header: what a sketch of twenty lines sends.
//!
//! A device may send its header once, with every reset, or now and then; it takes effect with its last line. Once a
//! row has ended in a checksum, each row must. Where no header comes, rows have the first 4, 7, 10 or 11
//! columns of the log format, in our units.

use nalgebra::Matrix3;

use super::Item;
use super::shown;
use crate::frame::{Mounting, Mountings};
use crate::reading::Field;
use crate::recording::{
    CutLine, HeaderLines, LineCutter, Rows, check_row, gives_key, names_columns, version,
};

/// Rows count without a header after this time, seconds of their own clock: the sketch of docs/serial.md repeats its header
/// every 500 rows, 11 s at its 45 Hz, and slower sketches need some more.
pub(super) const HEADER_S: f64 = 15.0;
/// Each row adds its time step to that wait, but no less and no more than this, seconds: the clock may stand still, and a lost
/// decimal point makes a time a thousand times as late.
const STEP_S: (f64, f64) = (0.001, 1.0);

/// Bytes in, readings out.
#[derive(Debug, Default)]
pub struct LogRows {
    lines: LineCutter,
    /// How the daemon holds the chips to be mounted.
    board: Mountings,
    /// A header on its way.
    header: Option<HeaderLines>,
    /// What was wrong with the last one, if anything.
    header_fault: Option<String>,
    rows: Option<Rows>,
    /// Whether the header says how the chips of field, rate and force are mounted.
    named: [bool; 3],
    /// Turn field, rate and force into the axes of the board's chips.
    turns: [Matrix3<f64>; 3],
    /// The device has sent a part of a header: rows count only after the whole.
    has_header: bool,
    /// How rows that counted without one were read: their units may be wrong.
    plain: Option<Rows>,
    first: bool,
    /// The device ends its rows in checksums: one without has lost it.
    checked: bool,
    /// Cells of the line before, where there is no header: two lines must agree.
    cells: usize,
    /// How long rows have come without a header, and the time of the last, seconds.
    waited_s: f64,
    last_s: f64,
}

impl LogRows {
    /// Readings come out in the axes of chips that are mounted like this, whatever the header says.
    pub fn new(board: Mountings) -> Self {
        Self {
            board,
            turns: [Matrix3::identity(); 3],
            first: true,
            last_s: f64::INFINITY,
            ..Self::default()
        }
    }

    /// The port has been opened anew. Rows of the `same_device` mean what they meant before; another one must send a header if the last one
    /// did: rows in other units or axes would give wrong headings.
    pub fn reopen(&mut self, same_device: bool) {
        if same_device {
            self.lines = LineCutter::default();
            (self.header, self.first) = (None, true);
        } else {
            *self = Self {
                has_header: self.has_header,
                ..Self::new(self.board)
            };
        }
    }

    /// Goes on with what another one knows of the same device, whose port was opened anew.
    pub fn take_over(&mut self, last: Self) {
        let board = self.board;
        *self = Self { board, ..last };
        self.reopen(true);
        self.turn();
    }

    /// Whether rows count in assumed units and axes, since no header has come.
    pub fn lacks_header(&self) -> bool {
        !self.has_header && self.waited_s >= HEADER_S
    }

    /// Decodes `bytes`, and calls `found` with each completed item.
    pub fn feed(&mut self, mut bytes: &[u8], mut found: impl FnMut(Item)) {
        let mut lines = std::mem::take(&mut self.lines);
        while let Some(line) = lines.next(&mut bytes) {
            match line {
                CutLine::Whole => self.line(lines.text(), &mut found),
                CutLine::TooLong => found(Item::TooLong),
            }
        }
        self.lines = lines;
    }

    fn line(&mut self, line: &[u8], found: &mut impl FnMut(Item)) {
        let first = std::mem::take(&mut self.first);
        if line.trim_ascii().is_empty() {
            return;
        }
        // A damaged byte must not make a line of the header a remark: its unit would be lost.
        let text = String::from_utf8_lossy(line);
        let is_header = text.trim_start_matches('\u{feff}').starts_with('#') || names_columns(line);
        if is_header {
            match HeaderLines::begin(&text) {
                Ok(begun) => {
                    self.header = Some(begun);
                    return self.heard_header();
                }
                Err(what) if version(&text).is_some() => {
                    // The rows that follow are none that are known.
                    self.rows = None;
                    self.heard_header();
                    return self.refuse_header(what, found);
                }
                Err(_) => {}
            }
        }
        match &mut self.header {
            Some(header) if is_header => match header.add(&text) {
                Ok(None) => {}
                Ok(Some(rows)) => {
                    self.named =
                        ["mag_axes", "gyro_axes", "accel_axes"].map(|key| header.gave(key));
                    (self.header, self.header_fault) = (None, None);
                    let before = self.rows.take().or(self.plain.take());
                    let same_units = before.as_ref().map(|before| rows.has_units_of(before));
                    let turns = self.turns;
                    self.rows = Some(rows);
                    self.turn();
                    if same_units.is_some_and(|same| !same || turns != self.turns) {
                        found(Item::NewUnits);
                    }
                }
                Err(what) => self.refuse_header(what, found),
            },
            // Its beginning was lost, or it is a remark. Rows wait for the next whole header; a device that sends it only at its
            // reset must be reset.
            _ if is_header => {
                if names_columns(line) || gives_key(&text) {
                    self.heard_header();
                }
            }
            _ => {
                // A row where the header should go on: its column names were lost.
                self.header = None;
                // The beginning of the first line was lost, and what is left may look whole.
                if !first {
                    let bad = |what| Item::Bad(format!("found {}: {what}", shown(line)));
                    found(self.row(line).unwrap_or_else(bad));
                }
            }
        }
    }

    fn refuse_header(&mut self, what: String, found: &mut impl FnMut(Item)) {
        self.header = None;
        self.header_fault = Some(what.clone());
        found(Item::BadHeader(what));
    }

    /// Once a sign of a header has come, rows without one no longer count.
    fn heard_header(&mut self) {
        if !self.has_header {
            self.has_header = true;
            self.plain = self.rows.take().filter(|_| self.waited_s >= HEADER_S);
        }
    }

    /// Finds how the axes of the rows are turned into those of the board's chips.
    fn turn(&mut self) {
        let Some(rows) = &self.rows else {
            return;
        };
        let (theirs, ours, named) = (rows.header.mountings, self.board, self.named);
        let turn = |named, theirs: Mounting, ours: Mounting| match named && theirs != ours {
            true => ours.rotation().transpose() * theirs.rotation(),
            false => Matrix3::identity(),
        };
        self.turns = [
            turn(named[0], theirs.mag, ours.mag),
            turn(named[1], theirs.gyro, ours.gyro),
            turn(named[2], theirs.accel, ours.accel),
        ];
    }

    fn row(&mut self, line: &[u8]) -> Result<Item, String> {
        let (line, checked) = check_row(line)?;
        self.checked |= checked;
        if self.checked && !checked {
            return Err("a row without its checksum, but those before it had one".to_owned());
        }
        if !self.has_header {
            let cells = 1 + line.iter().filter(|byte| **byte == b',').count();
            let agree = cells == self.cells;
            // A line may have lost a part and still look whole, so that one alone changes nothing.
            if agree
                && self
                    .rows
                    .as_ref()
                    .is_none_or(|rows| rows.columns.len() != cells)
            {
                self.rows = Some(Rows::plain(cells).ok_or_else(|| {
                    format!("{cells} cells, but without a header a row must have 4, 7, 10 or 11")
                })?);
            }
            self.cells = cells;
        }
        let Some(rows) = &self.rows else {
            if let Some(fault) = &self.header_fault {
                return Ok(Item::BadHeader(fault.clone()));
            }
            return Err(match self.has_header {
                true => {
                    "a row, but its header was lost; waiting for the next one: reset the device"
                }
                false => "a first row; waiting for a second one like it",
            }
            .to_owned());
        };
        let mut reading = rows.row(line)?.reading;
        if !self.has_header {
            let step_s = (reading.t_s - self.last_s).clamp(STEP_S.0, STEP_S.1);
            (self.waited_s, self.last_s) = (self.waited_s + step_s, reading.t_s);
            if self.waited_s < HEADER_S {
                return Ok(Item::Early);
            }
        }
        let [mag, gyro, accel] = &self.turns;
        reading.field_mgauss = reading.field_mgauss.map(|field| turned(mag, field));
        reading.rate_rad_s = reading.rate_rad_s.map(|rate| gyro * rate);
        reading.specific_force_m_s2 = reading.specific_force_m_s2.map(|force| accel * force);
        Ok(Item::Timed(reading))
    }
}

/// Rotates a field. An axis that depends on an overflowed one is unknown.
fn turned(turn: &Matrix3<f64>, field: Field) -> Field {
    std::array::from_fn(|row| {
        (0..3)
            .filter(|column| turn[(row, *column)].abs() > 1e-9)
            .map(|column| Some(turn[(row, column)] * field[column]?))
            .sum()
    })
}
