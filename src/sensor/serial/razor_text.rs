//! The Razor AHRS firmware's raw readings as text, `#osrt`: three lines a frame, `#A-R=`, `#M-R=`, `#G-R=`.
//!
//! A sensor that could not be read repeats its last numbers; a line `!ERR: reading …` comes before them,
//! if error output is on (`#oe1`).

use super::Item;
use super::razor::{RazorCounts, RazorFrame, reading};
use super::shown;
use crate::recording::{CutLine, LineCutter};

/// Beginnings of lines that the firmware, its forks or its predecessor send in other modes.
const OTHER_MODES: [(&str, &str); 10] = [
    ("#YPR", "angles (#ot)"),
    ("#A-C=", "calibrated readings (#osct)"),
    ("#M-C=", "calibrated readings (#osct)"),
    ("#G-C=", "calibrated readings (#osct)"),
    ("accel x,y,z", "calibration (#oc)"),
    ("magn x,y,z", "calibration (#oc)"),
    ("gyro x,y,z", "calibration (#oc)"),
    ("$G", "NMEA 0183 (a GPS?)"),
    (
        "$",
        "SparkFun's stock firmware, which is not the Razor AHRS",
    ),
    ("#AMG-ERR:", "error counts (#oec)"),
];

/// The last sensor of a frame.
const GYRO: usize = 2;

/// Bytes in, frames out.
#[derive(Debug)]
pub struct RazorText {
    counts_per_gauss: f64,
    lines: LineCutter,
    pending: Pending,
}

/// The frame that is coming in.
#[derive(Debug, Default)]
struct Pending {
    frame: RazorFrame,
    /// Sensors that could not be read: their numbers are old.
    failed: [bool; 3],
}

impl RazorText {
    /// For a magnetometer with this gain, counts per gauss.
    pub fn new(counts_per_gauss: f64) -> Self {
        Self {
            counts_per_gauss,
            lines: LineCutter::default(),
            pending: Pending::default(),
        }
    }

    /// Decodes `bytes`, and calls `found` with each completed item.
    pub fn feed(&mut self, mut bytes: &[u8], mut found: impl FnMut(Item)) {
        let gain = self.counts_per_gauss;
        while let Some(line) = self.lines.next(&mut bytes) {
            match line {
                CutLine::Whole => self.pending.line(self.lines.text(), gain, &mut found),
                CutLine::TooLong => found(Item::TooLong),
            }
        }
    }
}

impl Pending {
    fn line(&mut self, line: &[u8], gain: f64, found: &mut impl FnMut(Item)) {
        // Whatever came before it on its line: the firmware may have been sending binary numbers.
        if let [.., b'#', b'S', b'Y', b'N', b'C', b'H', a, b] = *line {
            return found(Item::Synch([a, b]));
        }
        let Ok(text) = str::from_utf8(line) else {
            return found(Item::Bad(format!(
                "found {}, which is no text",
                shown(line)
            )));
        };
        let mut sensors = ["#A-R=", "#M-R=", "#G-R="].into_iter().enumerate();
        let raw = sensors.find_map(|(sensor, name)| Some((sensor, text.strip_prefix(name)?)));
        if let Some((sensor, numbers)) = raw {
            // Its place in the frame, or one behind it, is taken: the end of the frame before was lost.
            if self.frame[sensor..].iter().any(Option::is_some) {
                self.end(gain, found);
            }
            match counts(numbers) {
                Ok(counts) => self.frame[sensor] = Some(counts),
                Err(why) => found(Item::Bad(format!("found {}: {why}", shown(line)))),
            }
            if sensor == GYRO {
                self.end(gain, found);
            }
        } else if let Some(what) = text.strip_prefix("!ERR: reading ") {
            let names = ["accelerometer", "magnetometer", "gyroscope"];
            if self.frame != RazorFrame::default() {
                self.end(gain, found);
            }
            match names.iter().position(|name| *name == what) {
                Some(index) => self.failed[index] = true,
                // Garbled: it may have been any of them.
                None => self.failed = [true; 3],
            }
        } else if let Some((_, mode)) = OTHER_MODES
            .iter()
            .find(|(start, _)| text.starts_with(start))
        {
            found(Item::OtherMode(mode));
        } else if !text.trim_ascii().is_empty() {
            found(Item::Bad(format!(
                "found {}, which is no line of the Razor AHRS firmware",
                shown(line)
            )));
        }
    }

    fn end(&mut self, gain: f64, found: &mut impl FnMut(Item)) {
        let Self { mut frame, failed } = std::mem::take(self);
        for (failed, counts) in failed.into_iter().zip(&mut frame) {
            if failed {
                *counts = None;
            }
        }
        found(Item::Frame(reading(frame, gain)));
    }
}

/// Three numbers as Arduino's `print(float)` writes them. An empty one, `nan`, `inf` or `ovf` is an axis of
/// which nothing is known.
fn counts(text: &str) -> Result<RazorCounts, &'static str> {
    let mut counts = [None; 3];
    let mut cells = text.split(',');
    for count in &mut counts {
        let cell = cells.next().ok_or("must be three numbers")?.trim_ascii();
        let unsigned = cell.strip_prefix('-').unwrap_or(cell);
        if unsigned.is_empty() || unsigned.eq_ignore_ascii_case("ovf") {
            continue;
        }
        let number: f64 = cell.parse().map_err(|_| "a number is garbled")?;
        if number.is_finite() {
            if number.fract() != 0.0 {
                return Err("raw counts are whole numbers; is it another firmware?");
            }
            *count = Some(number);
        }
    }
    match cells.next() {
        None => Ok(counts),
        Some(_) => Err("must be three numbers"),
    }
}
