//! Reading a log, row by row, in one buffer.

use std::io::BufRead;
use std::iter::from_fn;

use super::header;
use super::lines::{LogLine, LogLines};
use super::rows::{RowFault, Rows};
use super::stretch::{self, TimeOrder};
use super::{Entry, Header, LineError, RecordingError};

/// The unit of the times is checked on the first 1000 rows, if they hold at least 20 steps between gyro readings …
const FIRST_ROWS: usize = 1000;
const FEWEST_STEPS: usize = 20;
/// … and the median step is shorter than this: one of 500 Hz has it in milliseconds.
const LONG_STEP_S: f64 = 2.0;

/// Reads a log: the header at once, then an iterator of its rows, in milligauss, rad/s and m/s².
///
/// A row that cannot be used is an inner error, and the next row follows it; an outer error means
/// that the input failed, and is the last item. The times of the entries never decrease within a stretch.
#[derive(Debug)]
pub struct Reader<R> {
    pub(crate) log: String,
    lines: LogLines<R>,
    rows: Rows,
    /// A line of another header was found: the rows after it may be in other units.
    other_header: bool,
    /// How many lines of a header have been repeated since its first.
    repeated: Option<usize>,
    last_s: Option<f64>,
    begins_stretch: bool,
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
            begins_stretch: false,
            doubtful: None,
            next: None,
            failure: None,
            done: false,
        })
    }

    pub fn header(&self) -> &Header {
        self.rows.header()
    }

    /// Looks at the first rows for times that are in another unit.
    pub fn check_times(mut self) -> Result<(), RecordingError> {
        let rows = from_fn(|| self.row()).take(FIRST_ROWS).flatten();
        let readings = rows.map(|(entry, _)| entry.reading);
        let times: Vec<f64> = readings
            .filter_map(|reading| reading.rate_rad_s.map(|_| reading.t_s))
            .collect();
        let mut steps: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
        steps.sort_by(f64::total_cmp);
        let step = steps.get(steps.len() / 2).copied().unwrap_or_default();
        if steps.len() < FEWEST_STEPS || step < LONG_STEP_S {
            return Ok(());
        }
        let (unit, divisor) = match step {
            ..1e3 => ("milliseconds", 1000),
            ..1e6 => ("microseconds", 1_000_000),
            _ => ("nanoseconds", 1_000_000_000),
        };
        let column = self.rows.place(0).0;
        let what = format!(
            "the gyro's readings are {step:.0} apart in column {column} (t_s), as in {unit}, but times must be in seconds: \
             divide them by {divisor}"
        );
        Err(RecordingError::Times {
            log: self.log,
            what,
        })
    }

    /// Whether a new stretch begins with the last entry: its time has nothing to do with those before.
    pub fn begins_stretch(&self) -> bool {
        self.begins_stretch
    }

    /// The next row that can be understood, or why one cannot; `None` at the end.
    fn row(&mut self) -> Option<Result<Numbered, LineError>> {
        let broken = |what: &str| Err((None, what.to_owned()));
        while !self.done {
            let before = self.lines.number;
            let found = match self.lines.advance() {
                Ok(LogLine::End) => break,
                Ok(_) if self.lines.text.trim_ascii().is_empty() => continue,
                Ok(LogLine::Whole) => self.whole_line(),
                Ok(LogLine::TooLong) => broken("the line is longer than 4 KiB, so it is no row"),
                // Its last number may have lost digits and still look like a number.
                Ok(LogLine::CutOff) => {
                    broken("the log ends here without the end of the line: the row was cut off")
                }
                Err(source) => {
                    self.failure = Some(RecordingError::Read {
                        log: self.log.clone(),
                        line: before,
                        source,
                    });
                    break;
                }
            };
            let line = self.lines.number;
            match found {
                Ok(Some(entry)) => return Some(Ok((entry, line))),
                Ok(None) => {}
                Err(fault) => return Some(Err(self.line_error(line, fault))),
            }
        }
        self.done = true;
        None
    }

    /// The entry in the line; `None` where it is a remark, or belongs to the header, repeated.
    fn whole_line(&mut self) -> Result<Option<Entry>, RowFault> {
        let line = &self.lines.text[..];
        let known = self.rows.is_known_header(line, &mut self.repeated);
        self.other_header |= known.is_err();
        if known.map_err(|what| (None, what))? {
            return Ok(None);
        }
        if self.other_header {
            let what = "found a row after another header than the first: split the log there";
            return Err((None, what.to_owned()));
        }
        self.rows.entry(line).map(Some)
    }

    /// The entry, unless its time cannot be right.
    fn judged(&mut self, (entry, line): Numbered, order: TimeOrder) -> Result<Entry, LineError> {
        let t_s = entry.reading.t_s;
        if let (TimeOrder::Odd, Some(last_s)) = (order, self.last_s) {
            let what = if t_s < last_s {
                format!("found time {t_s}, but must be at least {last_s}, that of the row before")
            } else {
                format!(
                    "found time {t_s}, but the row before has {last_s}, and the next does not go on from here"
                )
            };
            return Err(self.line_error(line, (Some(0), what)));
        }
        self.last_s = Some(t_s);
        self.begins_stretch = order == TimeOrder::Jump;
        Ok(entry)
    }

    fn line_error(&self, line: u64, (column, what): RowFault) -> LineError {
        LineError {
            log: self.log.clone(),
            line,
            column: column.map(|column| self.rows.place(column)),
            what,
        }
    }
}

impl<R: BufRead> Iterator for Reader<R> {
    type Item = Result<Result<Entry, LineError>, RecordingError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            let row = match self.next.take() {
                Some(row) => Some(row),
                None => match self.row() {
                    Some(Ok(row)) => Some(row),
                    // What cannot be understood decides nothing: it may be told before a doubtful row.
                    Some(Err(error)) => return Some(Ok(Err(error))),
                    None => None,
                },
            };
            if let (Some(doubtful), Some(last_s)) = (self.doubtful.take(), self.last_s) {
                self.next = row;
                let next_s = row.map(|(entry, _)| entry.reading.t_s);
                let order = stretch::before(last_s, doubtful.0.reading.t_s, next_s);
                return Some(Ok(self.judged(doubtful, order)));
            }
            let Some(row) = row else {
                return self.failure.take().map(Err);
            };
            match stretch::at_once(self.last_s, row.0.reading.t_s) {
                Some(order) => return Some(Ok(self.judged(row, order))),
                None => self.doubtful = Some(row),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::io::{self, BufReader, Read};

    use nalgebra::Vector3;
    use proptest::prelude::*;

    use super::*;
    use crate::reading::Reading;

    const HEAD: &str = "# headingd-log 1\nt_s,mx,my,mz,gx,gy,gz,ax,ay,az,heading_deg\n";

    /// Its last number may have lost digits.
    #[test]
    fn a_row_without_its_end_is_refused() {
        let rows = rows(format!("{HEAD}7,,,,,,,,,,\n8,1,2,3,,,,,,,1").as_bytes());
        let [Ok(_), Err(row)] = &rows[..] else {
            panic!("{rows:?}")
        };
        assert!(row.what.contains("cut off"), "{row}");
    }

    fn rows(text: &[u8]) -> Vec<Result<Entry, LineError>> {
        Reader::new("a.csv", text)
            .unwrap()
            .map(Result::unwrap)
            .collect()
    }

    #[test]
    fn units_become_ours() {
        let text = "# headingd-log 1\n# mag_unit = uT\n# gyro_unit = deg/s\n# accel_unit = g\n\
                    heading_deg,az,ay,ax,gz,gy,gx,mz,my,mx,note,t_s\n\
                    -90,-1,0,2,180,0,0,3,2,1,hello,0.5\r\n";
        let entry = rows(text.as_bytes()).remove(0).unwrap();
        let reading = entry.reading;
        assert_eq!(reading.t_s, 0.5);
        assert_eq!(
            reading.field_mgauss,
            Some([Some(10.0), Some(20.0), Some(30.0)])
        );
        assert_eq!(
            reading.rate_rad_s,
            Some(Vector3::new(0.0, 0.0, std::f64::consts::PI))
        );
        assert_eq!(
            reading.specific_force_m_s2,
            Some(Vector3::new(19.6133, 0.0, -9.80665))
        );
        assert_eq!(entry.heading_truth_rad, Some(270f64.to_radians()));

        for (unit, first) in [
            ("mgauss", 2.6),
            ("gauss", 2600.0),
            ("nT", 0.026),
            ("counts\n# counts_per_gauss = 1300", 2.0),
        ] {
            let text = format!("# headingd-log 1\n# mag_unit = {unit}\nt_s,mx,my,mz\n0,2.6,0,0\n");
            let field = rows(text.as_bytes()).remove(0).unwrap().reading;
            let x = field.whole_field_mgauss().unwrap().x;
            assert!((x - first).abs() < 1e-12, "{unit}: {x}");
        }
    }

    #[test]
    fn an_empty_cell_is_silence_or_an_overflow_but_never_0() {
        let text = format!(
            "{HEAD}0,1,,3,,,,,,,\n0,,,,1,2,3,,,,\n\n0,,,,,,,,,,\n0,1,NaN,3,nan,-nan,NAN,,,,\n"
        );
        let rows = rows(text.as_bytes());
        let reading = |i: usize| rows[i].as_ref().unwrap().reading;
        assert_eq!(reading(0).field_mgauss, Some([Some(1.0), None, Some(3.0)]));
        assert_eq!(reading(0).rate_rad_s, None);
        assert_eq!(reading(1).field_mgauss, None);
        assert_eq!(reading(1).rate_rad_s, Some(Vector3::new(1.0, 2.0, 3.0)));
        assert_eq!(reading(2), Reading::default());
        assert_eq!(reading(3), reading(0));
        assert_eq!(rows.len(), 4);
    }

    #[test]
    fn a_bad_row_is_named_and_the_next_one_read() {
        let long = "1".repeat(5000);
        let good = "7,,,,,,,,,,";
        for (row, column, why) in [
            ("8,1,inf,3,,,,,,,", ", column 3 (my)", "1000000 mgauss"),
            ("8,1,2,0x3,,,,,,,", ", column 4 (mz)", "found \"0x3\""),
            ("8,1,2,1e7,,,,,,,", ", column 4 (mz)", "found \"1e7\""),
            ("2e12,,,,,,,,,,", ", column 1 (t_s)", "1000000000000 s"),
            (",1,2,3,,,,,,,", ", column 1 (t_s)", "empty cell"),
            ("6.9,1,2,3,,,,,,,", ", column 1 (t_s)", "at least 7"),
            ("8,,,,1,,3,,,,", ", column 6 (gy)", "gx, gy, gz must be"),
            ("8,,,,,,,1,2,,", ", column 10 (az)", "ax, ay, az must be"),
            ("8,,,,,,,,,,361", ", column 11 (heading_deg)", "360 degrees"),
            ("8,1,2,3", "", "found 4 cells"),
            (&long, "", "longer than 4 KiB"),
        ] {
            let text = format!("{HEAD}{good}\n{row}\n{good}\n");
            let rows = rows(text.as_bytes());
            let message = rows[1].as_ref().unwrap_err().to_string();
            assert!(
                message.starts_with(&format!("log a.csv, line 4{column}: ")),
                "{message}"
            );
            assert!(message.contains(why), "{message}");
            assert!(rows.len() == 3 && rows[2].is_ok(), "{row}");
        }
    }

    /// The times that are used, with `|` where a stretch begins, and the lines of those that are dropped.
    fn used(times: &str) -> (String, Vec<u64>) {
        let text = format!("# headingd-log 1\nt_s\n{}\n", times.replace(' ', "\n"));
        let mut reader = Reader::new("a.csv", text.as_bytes()).unwrap();
        let (mut kept, mut dropped) = (Vec::new(), Vec::new());
        while let Some(row) = reader.next() {
            match row.unwrap() {
                Ok(entry) => {
                    kept.extend(reader.begins_stretch().then(|| "|".to_owned()));
                    kept.push(entry.reading.t_s.to_string());
                }
                Err(error) => dropped.push(error.line - 2),
            }
        }
        (kept.join(" "), dropped)
    }

    #[test]
    fn an_odd_time_is_dropped_and_a_jump_begins_a_stretch() {
        for (times, right, dropped) in [
            ("0 1 999999999 2 3", "0 1 2 3", &[3][..]),
            ("0 1 999999999 888888888 2 3", "0 1 2 3", &[3, 4]),
            ("0 1 -500 2 3", "0 1 2 3", &[3]),
            ("999999999 0 1", "999999999 | 0 1", &[]),
            ("0 1 5000 5001 5002", "0 1 | 5000 5001 5002", &[]),
            ("50 51 0 1 2", "50 51 | 0 1 2", &[]),
            ("50 51 0 nonsense 1 2", "50 51 | 0 1 2", &[4]),
            ("50 51 0 nonsense 52", "50 51 52", &[4, 3]),
            ("0 30 90 91", "0 30 90 91", &[]),
            ("0 1 999999999", "0 1", &[3]),
            ("0 30", "0 30", &[]),
            ("0 1 0.98 0.99 1.01", "0 1 1.01", &[3, 4]),
            ("50 51 0 0 0 52", "50 51 52", &[3, 4, 5]),
            // The ends of a second, either way, …
            ("7 8 7.5", "7 8", &[3]),
            ("7 8.1 7.5", "7 7.5", &[2]),
            ("7 6 6.02", "7", &[2, 3]),
            ("7 5.9 5.92", "7 | 5.9 5.92", &[]),
            // … and of a minute.
            ("7 67 500", "7 67", &[3]),
            ("7 67.1 67.12", "7 | 67.1 67.12", &[]),
            ("7 67.1 67.1", "7", &[2, 3]),
        ] {
            let (kept, lines) = used(times);
            assert_eq!((kept.as_str(), &lines[..]), (right, dropped), "{times}");
        }
    }

    #[test]
    fn times_that_are_no_seconds_are_refused() {
        let checked = |step: f64, count: usize| {
            // The magnetometer's rows repeat the times: the steps of all rows have the median 0.
            let row = |i: usize| {
                let t = i as f64 * step;
                format!("{t},,,,0,0,{i},,,,\n{t},1,2,3,,,,,,,\n")
            };
            let text = HEAD.to_owned() + &(0..count).map(row).collect::<String>();
            Reader::new("a.csv", text.as_bytes()).unwrap().check_times()
        };
        for (step, apart, unit, divisor) in [
            (5.0, "5", "milliseconds", "1000"),
            (10_000.0, "10000", "microseconds", "1000000"),
            (1e7, "10000000", "nanoseconds", "1000000000"),
        ] {
            assert_eq!(
                checked(step, 60).unwrap_err().to_string(),
                format!(
                    "cannot use log a.csv: the gyro's readings are {apart} apart in column 1 (t_s), as in {unit}, but \
                     times must be in seconds: divide them by {divisor}"
                )
            );
        }
        // A logger of 1 Hz, and a log too short to tell.
        assert!(checked(1.0, 60).is_ok() && checked(10.0, 20).is_ok());
    }

    #[test]
    fn milliseconds_are_suspected_in_a_number_that_is_too_large() {
        for (row, suspected) in [
            ("1764000000000,,,,,,,,,,", true),
            ("x,,,,,,,,,,", false),
            ("nan,,,,,,,,,,", false),
            ("inf,,,,,,,,,,", false),
            ("0,1e13,2,3,,,,,,,", false),
        ] {
            let rows = rows(format!("{HEAD}{row}\n").as_bytes());
            let message = rows[0].as_ref().unwrap_err().to_string();
            let advice = "1000000000000 s; if these are milliseconds, divide by 1000";
            assert_eq!(message.ends_with(advice), suspected, "{message}");
            assert_eq!(message.contains("milliseconds"), suspected, "{message}");
        }
    }

    #[test]
    fn bytes_that_are_no_text_spoil_their_line_only() {
        let text = [HEAD.as_bytes(), b"0,\xff\xfe\0,,,,,,,,,\n1,,,,,,,,,,\n"].concat();
        let rows = rows(&text);
        let message = rows[0].as_ref().unwrap_err().to_string();
        assert!(
            message.contains("line 3: found bytes that are no text"),
            "{message}"
        );
        assert!(rows[1].is_ok());
    }

    #[test]
    fn a_failing_input_ends_the_rows() {
        struct Broken;
        impl Read for Broken {
            fn read(&mut self, _: &mut [u8]) -> io::Result<usize> {
                Err(io::Error::other("unplugged"))
            }
        }
        let text = format!("{HEAD}0,,,,,,,,,,\n");
        let mut reader =
            Reader::new("a.csv", BufReader::new(text.as_bytes().chain(Broken))).unwrap();
        assert!(reader.next().unwrap().unwrap().is_ok());
        let error = reader.next().unwrap().unwrap_err();
        assert_eq!(
            error.to_string(),
            "cannot read log a.csv after line 3: unplugged"
        );
        assert!(reader.next().is_none());
    }

    proptest! {
        #[test]
        fn no_bytes_make_it_panic(bytes in prop::collection::vec(any::<u8>(), 0..2000)) {
            for head in ["", "# headingd-log 1\n", HEAD] {
                if let Ok(reader) = Reader::new("a", &[head.as_bytes(), &bytes].concat()[..]) {
                    reader.for_each(drop);
                }
            }
        }

        #[test]
        fn no_near_row_makes_it_panic(text in "[0-9eE+.,\r\nNnaif-]{0,300}") {
            Reader::new("a", format!("{HEAD}{text}").as_bytes()).unwrap().for_each(drop);
        }
    }
}
