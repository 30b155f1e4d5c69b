//! The Razor AHRS firmware's raw readings as text, `#osrt`: three lines a frame, `#A-R=`, `#M-R=`, `#G-R=`.
//!
//! A sensor that could not be read repeats its last numbers; a line `!ERR: reading …` comes before them,
//! if error output is on (`#oe1`).

use super::Item;
use super::lines::{SerialLine, SerialLines};
use super::razor::{Frame, RazorCounts, Sensor};
use super::shown;

/// Beginnings of lines that the firmware, its forks or its predecessor send in other modes.
const OTHER_MODES: [(&str, &str); 9] = [
    ("#YPR", "angles (#ot)"),
    ("#A-C=", "calibrated readings (#osct)"),
    ("#M-C=", "calibrated readings (#osct)"),
    ("#G-C=", "calibrated readings (#osct)"),
    ("accel x,y,z", "calibration (#oc)"),
    ("magn x,y,z", "calibration (#oc)"),
    ("gyro x,y,z", "calibration (#oc)"),
    (
        "$",
        "SparkFun's stock firmware, which is not the Razor AHRS",
    ),
    ("#AMG-ERR:", "error counts (#oec)"),
];

/// Bytes in, frames out.
#[derive(Clone, Debug)]
pub struct RazorText {
    counts_per_gauss: f64,
    lines: SerialLines,
    pending: Pending,
}

/// The frame that is coming in.
#[derive(Clone, Debug, Default)]
struct Pending {
    frame: Frame,
    /// Sensors that could not be read: their numbers are old.
    failed: [bool; 3],
}

impl RazorText {
    /// For a magnetometer with this gain, counts per gauss.
    pub fn new(counts_per_gauss: f64) -> Self {
        Self {
            counts_per_gauss,
            lines: SerialLines::default(),
            pending: Pending::default(),
        }
    }

    /// Hands over what `bytes` complete, in order.
    pub fn feed(&mut self, bytes: &[u8], mut found: impl FnMut(Item)) {
        let (pending, gain) = (&mut self.pending, self.counts_per_gauss);
        self.lines.feed(bytes, |line| match line {
            SerialLine::Whole(line) => pending.line(line, gain, &mut found),
            SerialLine::TooLong => found(Item::TooLong),
        });
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
        let sensors = [
            ("#A-R=", Sensor::Accel),
            ("#M-R=", Sensor::Mag),
            ("#G-R=", Sensor::Gyro),
        ];
        let raw = sensors
            .iter()
            .find_map(|(name, sensor)| Some((*sensor, text.strip_prefix(name)?)));
        if let Some((sensor, numbers)) = raw {
            // Its place in the frame is taken: the end of the frame before was lost.
            if self.begun(sensor) {
                self.end(gain, found);
            }
            match counts(numbers) {
                Ok(counts) => *self.slot(sensor) = Some(counts),
                Err(why) => found(Item::Bad(format!("found {}: {why}", shown(line)))),
            }
            if sensor == Sensor::Gyro {
                self.end(gain, found);
            }
        } else if let Some(what) = text.strip_prefix("!ERR: reading ") {
            let names = ["accelerometer", "magnetometer", "gyroscope"];
            if self.frame != Frame::default() {
                self.end(gain, found);
            }
            match names.iter().position(|name| *name == what) {
                Some(index) => self.failed[index] = true,
                // Garbled: it may have been any of them.
                None => self.failed = [true; 3],
            }
            found(Item::Remark);
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

    /// Whether a line of this sensor cannot belong to the frame that is coming in.
    fn begun(&self, sensor: Sensor) -> bool {
        let Frame { accel, mag, gyro } = self.frame;
        match sensor {
            Sensor::Accel => accel.is_some() || mag.is_some() || gyro.is_some(),
            Sensor::Mag => mag.is_some() || gyro.is_some(),
            Sensor::Gyro => gyro.is_some(),
        }
    }

    fn slot(&mut self, sensor: Sensor) -> &mut Option<RazorCounts> {
        match sensor {
            Sensor::Accel => &mut self.frame.accel,
            Sensor::Mag => &mut self.frame.mag,
            Sensor::Gyro => &mut self.frame.gyro,
        }
    }

    fn end(&mut self, gain: f64, found: &mut impl FnMut(Item)) {
        let Self { mut frame, failed } = std::mem::take(self);
        for (failed, slot) in
            failed
                .into_iter()
                .zip([&mut frame.accel, &mut frame.mag, &mut frame.gyro])
        {
            if failed {
                *slot = None;
            }
        }
        found(Item::Frame(frame.reading(gain)));
    }
}

/// Three numbers as Arduino's `print(float)` writes them. An empty one, `nan`, `inf` or `ovf` is an axis of
/// which nothing is known.
fn counts(text: &str) -> Result<RazorCounts, &'static str> {
    let mut counts = [None; 3];
    let mut cells = text.split(',');
    for count in &mut counts {
        let cell = cells
            .next()
            .ok_or("three numbers must stand there")?
            .trim_ascii();
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
        Some(_) => Err("three numbers must stand there"),
    }
}
