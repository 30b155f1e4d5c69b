//! The rows of a log, one line at a time: text to numbers in our units.

use nalgebra::Vector3;

use super::{
    ACCEL, COLUMNS, Entry, GYRO, HEADING, Header, MAG, MAGIC, gives_key, names_columns, shown,
};
use crate::frame::wrap_360;
use crate::reading::Reading;

/// How one column's numbers become ours.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rule {
    /// Our unit = factor · the log's unit.
    pub(super) factor: f64,
    /// Largest credible magnitude, in the log's unit. Far above any sensor's range: it is there for
    /// broken rows.
    pub(super) limit: f64,
    /// The log's unit.
    pub(super) unit: &'static str,
}

/// How to read a log's rows, and its header.
#[derive(Clone, Debug)]
pub struct Rows {
    pub(crate) header: Header,
    /// For each column of the log, its index in [`COLUMNS`]; `None` if it is unknown.
    pub(crate) columns: Vec<Option<usize>>,
    /// For each of [`COLUMNS`].
    pub(super) rules: [Rule; COLUMNS.len()],
    /// The header's lines that say how to read the rows.
    pub(super) lines: Vec<String>,
}

/// A row's numbers in our units, in the order of [`COLUMNS`].
type Cells = [Option<f64>; COLUMNS.len()];

impl Rows {
    /// Whether a number means the same in both.
    pub fn has_units_of(&self, other: &Self) -> bool {
        let mut both = self.rules.iter().zip(&other.rules);
        both.all(|(one, other)| one.factor == other.factor)
    }

    /// Whether a line is no row: a remark, or a line of this log's header, which some devices repeat. A line of another header is an
    /// error. `repeated`: how many of the header's lines have come since its first was repeated.
    pub(super) fn is_known_header(
        &self,
        line: &[u8],
        repeated: &mut Option<usize>,
    ) -> Result<bool, String> {
        let is_remark = line.starts_with(b"#");
        if !is_remark && !names_columns(line) {
            return Ok(false);
        }
        let text = String::from_utf8_lossy(line);
        if is_remark && !gives_key(&text) {
            let content = text.trim_start_matches('#').trim_start();
            if content.starts_with(MAGIC) {
                *repeated = Some(0);
            }
            return Ok(true);
        }
        if self.lines.iter().any(|known| known == text.trim()) {
            if let Some(count) = repeated {
                *count += 1;
            }
            // A header that lacks a line of the first has that key's default. The line of column names ends it.
            if is_remark
                || repeated
                    .take()
                    .is_none_or(|count| count == self.lines.len())
            {
                return Ok(true);
            }
        }
        Err(format!(
            "found {}, another header than the first: split the log here",
            shown(line)
        ))
    }

    /// Where one of [`COLUMNS`] is in the log, its number from 1, for messages.
    pub(super) fn place(&self, column: usize) -> String {
        let found = |c: &Option<usize>| *c == Some(column);
        let number = 1 + self.columns.iter().position(found).unwrap_or(0);
        format!("column {number} ({})", COLUMNS[column])
    }

    /// One row, without checksum and line's end. The order of times is not checked here.
    pub fn row(&self, line: &[u8]) -> Result<Entry, String> {
        let cells = self.cells(line)?;
        let t_s = cells[0].ok_or_else(|| {
            let place = self.place(0);
            format!("{place}: found an empty cell, but each row must have its time in seconds")
        })?;
        let field = [cells[MAG], cells[MAG + 1], cells[MAG + 2]];
        Ok(Entry {
            reading: Reading {
                t_s,
                field_mgauss: field.iter().any(Option::is_some).then_some(field),
                rate_rad_s: self.vector(&cells, GYRO)?,
                specific_force_m_s2: self.vector(&cells, ACCEL)?,
            },
            heading_truth_deg: cells[HEADING].map(wrap_360),
        })
    }

    /// The row's numbers.
    fn cells(&self, line: &[u8]) -> Result<Cells, String> {
        let text = str::from_utf8(line).map_err(|error| {
            let rest = shown(&line[error.valid_up_to()..]);
            format!("found bytes that are no text: {rest}")
        })?;
        let count = 1 + line.iter().filter(|byte| **byte == b',').count();
        let expected = self.columns.len();
        if count != expected {
            // A comma for a decimal point makes two cells of a number, a semicolon one of two.
            let hint = match count > expected || line.contains(&b';') {
                true => "; decimals need a point, columns a comma",
                false => "",
            };
            return Err(format!(
                "found {count} cells in {}, but must be {expected}, one a column{hint}",
                shown(line)
            ));
        }
        let mut cells = [None; COLUMNS.len()];
        for (column, cell) in self.columns.iter().zip(text.split(',')) {
            let Some(column) = *column else { continue };
            let cell = cell.trim_ascii();
            if cell.is_empty() {
                continue;
            }
            let rule = &self.rules[column];
            match cell.parse::<f64>() {
                // What Arduino and NumPy print where there is no number.
                Ok(number) if number.is_nan() => {}
                Ok(number) if number.abs() <= rule.limit => {
                    cells[column] = Some(number * rule.factor);
                }
                // The true value is only there to compare with.
                _ if column == HEADING => {}
                parsed => {
                    let advice = match parsed {
                        Ok(number) if column == 0 && number.is_finite() => {
                            "; if these are milliseconds, divide by 1000"
                        }
                        Err(_) if column != 0 => "; leave the cell empty if the value is unknown",
                        _ => "",
                    };
                    return Err(format!(
                        "{place}: found {cell}, but must be a number from -{limit} to {limit} {unit}{advice}",
                        place = self.place(column),
                        cell = shown(cell.as_bytes()),
                        limit = rule.limit,
                        unit = rule.unit
                    ));
                }
            }
        }
        Ok(cells)
    }

    fn vector(&self, cells: &Cells, first: usize) -> Result<Option<Vector3<f64>>, String> {
        let axes = [cells[first], cells[first + 1], cells[first + 2]];
        if let [Some(x), Some(y), Some(z)] = axes {
            return Ok(Some(Vector3::new(x, y, z)));
        }
        match axes.iter().position(Option::is_none) {
            Some(empty) if axes != [None; 3] => Err(format!(
                "{}: found an empty cell, but {} must be filled or empty together",
                self.place(first + empty),
                COLUMNS[first..first + 3].join(", ")
            )),
            _ => Ok(None),
        }
    }
}
