//! The header of a log: its `#` lines and its column names.

use std::io::BufRead;

use strsim::levenshtein;

use super::columns::{columns, names_columns};
use super::lines::{CutLine, LogLine, LogLines};
use super::rows::{Rows, Rule};
use super::time_of_day::RECORDED_FROM;
use super::{
    ACCEL, COLUMNS, GYRO, HEADING, Header, MAG, MAGIC, RecordingError, VERSION, place, shown,
};
use crate::date::{LATEST, parse_rfc3339};
use crate::frame::Mounting;
use crate::reading::STANDARD_GRAVITY_M_S2;

/// More `#` lines than this are no header.
const MOST_LINES: u64 = 1000;

/// Reads everything up to and with the line of column names.
pub(super) fn read<R: BufRead>(log: &str, lines: &mut LogLines<R>) -> Result<Rows, RecordingError> {
    let text = next_line(log, lines)?;
    let mut header = HeaderLines::begin(text).map_err(|what| wrong(log, lines.number, what))?;
    loop {
        let text = next_line(log, lines)?;
        let done = header.add(text);
        if let Some(rows) = done.map_err(|what| wrong(log, lines.number, what))? {
            return Ok(rows);
        }
    }
}

/// A header on its way, line by line: from a file, or over a serial line.
#[derive(Debug, Default)]
pub struct HeaderLines {
    count: u64,
    header: Header,
    given: Vec<&'static str>,
    mag: Option<Unit>,
    counts_per_gauss: Option<f64>,
    gyro: Option<Unit>,
    accel: Option<Unit>,
    /// The lines that say how to read the rows.
    lines: Vec<String>,
}

impl HeaderLines {
    /// Takes the first line, `# headingd-log 1`.
    pub fn begin(text: &str) -> Result<Self, String> {
        check_version(text)?;
        Ok(Self {
            count: 1,
            ..Self::default()
        })
    }

    /// Takes the next line; the one with the column names completes the header.
    pub fn add(&mut self, text: &str) -> Result<Option<Rows>, String> {
        self.count += 1;
        if gives_key(text) || names_columns(text.as_bytes()) {
            self.lines.push(text.trim().to_owned());
        }
        match text.strip_prefix('#') {
            Some(comment) if self.count <= MOST_LINES => self.add_key(comment).map(|()| None),
            Some(_) => Err(format!(
                "more than {MOST_LINES} # lines, but the line of column names must follow them"
            )),
            None if text.trim().is_empty() => Ok(None),
            None => {
                let columns = columns(text)?;
                let rules = self.rules()?;
                let header = std::mem::take(&mut self.header);
                Ok(Some(Rows {
                    header,
                    columns,
                    rules,
                    lines: std::mem::take(&mut self.lines),
                }))
            }
        }
    }

    /// Whether one of the [`KEYS`] was given.
    pub fn gave(&self, key: &str) -> bool {
        self.given.contains(&key)
    }

    /// Takes what follows the `#`; text that is no `key = value` is a remark, unless it only lacks the `=`.
    fn add_key(&mut self, comment: &str) -> Result<(), String> {
        let Some((key, value)) = comment.split_once('=') else {
            return match without_equals(comment) {
                Some((key, value)) => Err(format!(
                    "found {}, but between a key and its value must be =: {key} = {value}",
                    shown(comment.trim().as_bytes())
                )),
                None => Ok(()),
            };
        };
        let (key, value) = (key.trim(), value.trim());
        let Some(known) = KEYS.iter().find(|known| **known == key) else {
            if let Some(meant) = meant(key) {
                return Err(format!("{key} is no key; {meant} is one"));
            }
            if key == RECORDED_FROM && parse_rfc3339(value).is_none_or(|time| time >= LATEST) {
                return Err(format!(
                    "{key} is {}, but must be a time from 1970 to 9998, as 2026-11-21T10:00:00Z",
                    shown(value.as_bytes())
                ));
            }
            self.header.truth.push((key.to_owned(), value.to_owned()));
            return Ok(());
        };
        if self.given.contains(known) {
            return Err(format!("{key} is given a second time"));
        }
        self.given.push(known);
        let bad =
            |right: &str| format!("{key} is {}, but must be {right}", shown(value.as_bytes()));
        let unit = |known: &[Unit], right: &str| {
            let found = known.iter().find(|(name, _)| *name == value);
            found.copied().ok_or_else(|| bad(right))
        };
        let axes = || {
            value
                .parse()
                .map_err(|error| format!("{key} is wrong: {error}"))
        };
        match key {
            "sensor" => self.header.sensor = Some(value.to_owned()),
            "mag_unit" => self.mag = Some(unit(&MAG_UNITS, "mgauss, gauss, uT, nT or counts")?),
            "counts_per_gauss" => {
                let counts = value.parse().ok().filter(|n| (1.0..=1e6).contains(n));
                self.counts_per_gauss =
                    Some(counts.ok_or_else(|| bad("a number from 1 to 1000000"))?);
            }
            "gyro_unit" => self.gyro = Some(unit(&GYRO_UNITS, "rad/s or deg/s")?),
            "accel_unit" => self.accel = Some(unit(&ACCEL_UNITS, "m/s2 or g")?),
            "mag_axes" => self.header.mountings.mag = axes()?,
            "gyro_axes" => self.header.mountings.gyro = axes()?,
            _ => self.header.mountings.accel = axes()?,
        }
        Ok(())
    }

    fn rules(&self) -> Result<[Rule; COLUMNS.len()], String> {
        let mag = match (self.mag, self.counts_per_gauss) {
            (Some((COUNTS, _)), Some(counts)) => (COUNTS, 1000.0 / counts),
            (Some((COUNTS, _)), None) => {
                return Err("mag_unit = counts needs a line \"# counts_per_gauss = …\"".to_owned());
            }
            // The line of the unit may have been lost or garbled.
            (unit, Some(_)) => {
                let found = unit.map_or("without mag_unit".to_owned(), |(name, _)| {
                    format!("with mag_unit = {name}")
                });
                return Err(format!(
                    "counts_per_gauss is given {found}, but needs a line \"# mag_unit = counts\""
                ));
            }
            (unit, None) => unit.unwrap_or(MAG_UNITS[0]),
        };
        let rule = |(unit, factor): Unit, limit: f64| Rule {
            factor,
            limit: limit / factor,
            unit,
        };
        let mut rules = [rule(("s", 1.0), 1e12); COLUMNS.len()];
        rules[MAG..GYRO].fill(rule(mag, 1e6));
        rules[GYRO..ACCEL].fill(rule(self.gyro.unwrap_or(GYRO_UNITS[0]), 1e3));
        rules[ACCEL..HEADING].fill(rule(self.accel.unwrap_or(ACCEL_UNITS[0]), 1e4));
        rules[HEADING] = rule(("degrees", 1.0), 360.0);
        Ok(rules)
    }
}

/// The key of a unit or of axes that this one misspells: without that key, numbers would be read in wrong units. Other
/// keys are free, also those that resemble `sensor`.
fn meant(key: &str) -> Option<&'static str> {
    let key = key.to_lowercase().replace('-', "_");
    let mut units_and_axes = KEYS.into_iter().filter(|known| *known != "sensor");
    units_and_axes.find(|known| levenshtein(&key, known) <= 2)
}

/// The key of a unit or of axes, and a value that it may have, where a `:` or a space stands in place of the `=`.
fn without_equals(comment: &str) -> Option<(&'static str, &str)> {
    let comment = comment.trim();
    let (key, value) = comment
        .split_once(':')
        .or_else(|| comment.split_once(' '))?;
    let (key, value) = (meant(key.trim())?, value.trim());
    let names = |units: &[Unit]| {
        units
            .iter()
            .any(|(name, _)| name.eq_ignore_ascii_case(value))
    };
    let fits = match key {
        "mag_unit" => names(&MAG_UNITS),
        "gyro_unit" => names(&GYRO_UNITS),
        "accel_unit" => names(&ACCEL_UNITS),
        "counts_per_gauss" => value.parse::<f64>().is_ok(),
        _ => value.parse::<Mounting>().is_ok(),
    };
    fits.then_some((key, value))
}

impl Rows {
    /// Rows without a header, of this many cells: `t_s,mx,my,mz`, or with `gx,gy,gz`, or with `ax,ay,az`
    /// too, or with `heading_deg` too; in milligauss, rad/s and m/s². `None` for any other count.
    pub fn plain(cells: usize) -> Option<Self> {
        let known = [GYRO, ACCEL, HEADING, COLUMNS.len()].contains(&cells);
        known.then(|| Self {
            header: Header::default(),
            columns: (0..cells).map(Some).collect(),
            rules: HeaderLines::default()
                .rules()
                .expect("without units none is wrong"),
            lines: Vec::new(),
        })
    }
}

fn wrong(log: &str, line: u64, what: String) -> RecordingError {
    let place = place(log, line);
    RecordingError::Data(format!("cannot read the header of {place}: {what}"))
}

fn next_line<'a, R: BufRead>(
    log: &str,
    lines: &'a mut LogLines<R>,
) -> Result<&'a str, RecordingError> {
    let before = lines.number;
    let line = lines
        .advance()
        .map_err(|source| RecordingError::broken_off(log, before, source))?;
    let what = match line {
        LogLine::Cut(CutLine::Whole) => match str::from_utf8(lines.text()) {
            Ok(text) => return Ok(text),
            Err(_) => format!("found {}, which is not UTF-8 text", shown(lines.text())),
        },
        LogLine::Cut(CutLine::TooLong) => "the line is longer than 4 KiB".to_owned(),
        LogLine::CutOff | LogLine::End => {
            return Err(RecordingError::Data(format!(
                "log {log} has no reading: it must begin with \"# {MAGIC} {VERSION}\" and its column names, and rows must follow"
            )));
        }
    };
    Err(wrong(log, before + 1, what))
}

/// The format version that a line names, if it is the first line of a log.
pub fn version(text: &str) -> Option<u32> {
    let comment = text.trim_start_matches('\u{feff}').strip_prefix('#')?;
    comment.trim().strip_prefix(MAGIC)?.trim().parse().ok()
}

fn check_version(text: &str) -> Result<(), String> {
    match version(text) {
        Some(VERSION) => Ok(()),
        Some(newer) if newer > VERSION => Err(format!(
            "the log has format version {newer}, but this headingd reads version {VERSION}; a newer headingd may read it"
        )),
        _ => Err(format!(
            "the first line is {}, but must be \"# {MAGIC} {VERSION}\"",
            shown(text.trim_start_matches('\u{feff}').as_bytes())
        )),
    }
}

/// A unit's name in a log, and what one of it is in ours.
type Unit = (&'static str, f64);

/// What a count is depends on `counts_per_gauss`.
const COUNTS: &str = "counts";
const MAG_UNITS: [Unit; 5] = [
    ("mgauss", 1.0),
    ("gauss", 1000.0),
    ("uT", 10.0),
    ("nT", 0.01),
    (COUNTS, f64::NAN),
];
const GYRO_UNITS: [Unit; 2] = [("rad/s", 1.0), ("deg/s", 1f64.to_radians())];
const ACCEL_UNITS: [Unit; 2] = [("m/s2", 1.0), ("g", STANDARD_GRAVITY_M_S2)];

/// The keys with a meaning of their own; a log may give each only once.
const KEYS: [&str; 8] = [
    "sensor",
    "mag_unit",
    "counts_per_gauss",
    "gyro_unit",
    "accel_unit",
    "mag_axes",
    "gyro_axes",
    "accel_axes",
];

/// Whether a `#` line gives one of the keys that say how to read the rows.
pub(crate) fn gives_key(line: &str) -> bool {
    let key = line.strip_prefix('#').and_then(|text| text.split_once('='));
    key.is_some_and(|(key, _)| KEYS.contains(&key.trim()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(text: &str) -> Result<Rows, String> {
        read("a.csv", &mut LogLines::new(text.as_bytes())).map_err(|error| error.to_string())
    }

    #[test]
    fn keys_are_understood_and_unknown_ones_are_kept() {
        let Rows {
            header,
            columns,
            rules,
            ..
        } = rows(
            "\u{feff}# headingd-log 1\r\n#sensor=hmc5843\r\n# a remark: mag_unit\r\n# mag_unit: see the data sheet\r\n# mag_unit = counts\r\n\
             # counts_per_gauss = 1300\r\n# gyro_axes = -x +y -z\r\n# truth_scale = 1 2 3\r\n\
             # sensor_1 = bmp280\r\n# sensors = 3\r\n\
             az,ax,ay,t_s,magnitude\r\n",
        )
        .unwrap();
        assert_eq!(header.sensor.as_deref(), Some("hmc5843"));
        assert_eq!(header.mountings.gyro, "-x +y -z".parse().unwrap());
        assert_eq!(header.mountings.mag, Default::default());
        let kept = [
            ("truth_scale", "1 2 3"),
            ("sensor_1", "bmp280"),
            ("sensors", "3"),
        ];
        assert_eq!(
            header.truth,
            kept.map(|(key, value)| (key.into(), value.into()))
        );
        assert_eq!(columns, [Some(9), Some(7), Some(8), Some(0), None]);
        assert_eq!(rules[MAG].factor, 1000.0 / 1300.0);
    }

    #[test]
    fn a_wrong_header_is_named_with_its_line_and_reason() {
        for (text, line, why) in [
            ("t_s,mx\n", 1, "must be \"# headingd-log 1\""),
            ("# headingd-log 1.5\n", 1, "must be \"# headingd-log 1\""),
            ("# headingd-log 2\n", 1, "a newer headingd"),
            ("# headingd-log 1\n# mag_unit = tesla\n", 2, "uT, nT or"),
            ("# headingd-log 1\n# mag_units = uT\n", 2, "mag_unit is one"),
            ("# headingd-log 1\n# mag_uint = uT\n", 2, "mag_unit is one"),
            (
                "# headingd-log 1\n# Gyro-Unit = deg/s\n",
                2,
                "gyro_unit is one",
            ),
            ("# headingd-log 1\n# gyro_unit = rpm\n", 2, "rad/s or"),
            ("# headingd-log 1\n# accel_unit = ft\n", 2, "m/s2 or g"),
            ("# headingd-log 1\n# mag_axes = +x +x +z\n", 2, "once"),
            (
                "# headingd-log 1\n# sensor = a\n# sensor = b\n",
                3,
                "second",
            ),
            ("# headingd-log 1\n# counts_per_gauss = 0\n", 2, "from 1"),
            (
                "# headingd-log 1\n# mag_unit = counts\nt_s\n",
                3,
                "counts_per",
            ),
            (
                "# headingd-log 1\n# counts_per_gauss = 1300\nt_s\n",
                3,
                "without mag_unit, but needs a line \"# mag_unit = counts\"",
            ),
            (
                "# headingd-log 1\n# mag_unit = uT\n# counts_per_gauss = 1300\nt_s\n",
                4,
                "with mag_unit = uT, but needs",
            ),
            ("# headingd-log 1\n0.1,1,2,3\n", 2, "t_s among them"),
            ("# headingd-log 1\nt_s,t_s\n", 2, "more than once"),
            ("# headingd-log 1\nt_s,mx,my\n", 2, "mx, my, mz must"),
            ("# headingd-log 1\nt_s,gx,gy,gz,mag_x\n", 2, "be mx, my, mz"),
            ("# headingd-log 1\nt_s,Mx,My,Mz\n", 2, "be mx, my, mz"),
            (
                "# headingd-log 1\nt_s,mx,my,mz,gyro_x\n",
                2,
                "be gx, gy, gz",
            ),
            ("# headingd-log 1\nt_s,AccX (g)\n", 2, "be ax, ay, az"),
            ("# headingd-log 1\n# mag_unit: uT\n", 2, "mag_unit = uT"),
            (
                "# headingd-log 1\n# Gyro Unit: deg/s\n",
                2,
                "gyro_unit = deg/s",
            ),
            (
                "# headingd-log 1\n# gyro_unit deg/s\n",
                2,
                "gyro_unit = deg/s",
            ),
            (
                "# headingd-log 1\n# mag_axes +y -x +z\n",
                2,
                "mag_axes = +y -x +z",
            ),
            (
                "# headingd-log 1\n# recorded_from = 21.11.2026\n",
                2,
                "must be a time from 1970 to 9998, as 2026-",
            ),
            // Its readings would go on into the year 10000.
            (
                "# headingd-log 1\n# recorded_from = 9999-12-31T23:59:59Z\n",
                2,
                "must be a time from 1970 to 9998",
            ),
        ] {
            let message = rows(text).unwrap_err();
            assert!(message.contains(why), "{text:?}: {message}");
            assert!(
                message.contains(&format!("a.csv, line {line}: ")),
                "{text:?}: {message}"
            );
        }
    }

    #[test]
    fn other_columns_have_any_name() {
        rows("# headingd-log 1\nt_s,gx,gy,gz,max,mm_x,accuracy,gyro_temp,azimuth,gyro_x\n")
            .unwrap();
    }

    #[test]
    fn a_header_that_never_ends_is_given_up() {
        let text = "# headingd-log 1\n".to_owned() + &"# x = 1\n".repeat(2000);
        assert!(rows(&text).unwrap_err().contains("more than 1000"));
    }
}
