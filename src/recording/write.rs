//! Writing a log.

use std::io::{self, Write};

use super::{COLUMNS, Entry, Header, MAGIC, VERSION};

impl Header {
    /// All its lines, and the column names.
    pub(crate) fn text(&self) -> String {
        let mut text = format!("# {MAGIC} {VERSION}\n");
        let mut add = |key: &str, value: &str| text += &format!("# {key} = {value}\n");
        if let Some(sensor) = &self.sensor {
            add("sensor", sensor);
        }
        add("mag_unit", "mgauss");
        add("gyro_unit", "rad/s");
        add("accel_unit", "m/s2");
        add("mag_axes", &self.mountings.mag.to_string());
        add("gyro_axes", &self.mountings.gyro.to_string());
        add("accel_axes", &self.mountings.accel.to_string());
        for (key, value) in &self.truth {
            add(key, value);
        }
        text + &COLUMNS.join(",") + "\n"
    }
}

/// Writes a log in milligauss, rad/s and m/s², each number exactly and as short as can be.
///
/// Each row goes out as one write, so the output should be buffered if rows may be lost in a crash,
/// and may be unbuffered if they may not.
#[derive(Debug)]
pub struct Writer<W: Write> {
    output: W,
    line: Vec<u8>,
}

impl<W: Write> Writer<W> {
    /// Writes the header. Its texts must be single lines, as those of a header that was read are.
    ///
    /// # Errors
    ///
    /// When writing fails.
    pub fn new(mut output: W, header: &Header) -> io::Result<Self> {
        output.write_all(header.text().as_bytes())?;
        Ok(Self {
            output,
            line: Vec::new(),
        })
    }

    /// Writes one row, and returns its length in bytes. A number that is not finite is no measurement, and left empty.
    ///
    /// # Errors
    ///
    /// When writing fails.
    pub fn write(&mut self, entry: &Entry) -> io::Result<usize> {
        self.line.clear();
        row(&mut self.line, entry)?;
        self.output.write_all(&self.line)?;
        Ok(self.line.len())
    }

    /// Flushes the output.
    ///
    /// # Errors
    ///
    /// When writing fails.
    pub fn flush(&mut self) -> io::Result<()> {
        self.output.flush()
    }
}

/// A whole log.
///
/// # Errors
///
/// When writing fails.
pub fn written(header: &Header, entries: impl IntoIterator<Item = Entry>) -> io::Result<Vec<u8>> {
    let mut log = Vec::new();
    let mut writer = Writer::new(&mut log, header)?;
    for entry in entries {
        writer.write(&entry)?;
    }
    Ok(log)
}

fn row(line: &mut Vec<u8>, entry: &Entry) -> io::Result<()> {
    let reading = &entry.reading;
    write!(line, "{}", reading.t_s)?;
    let cells = reading.cells().into_iter().flatten();
    for cell in cells.chain([entry.heading_truth_deg]) {
        match cell.filter(|n| n.is_finite()) {
            Some(number) => write!(line, ",{number}")?,
            None => line.push(b','),
        }
    }
    line.push(b'\n');
    Ok(())
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;
    use proptest::prelude::*;

    use super::super::Reader;
    use super::*;
    use crate::reading::Reading;

    #[test]
    fn a_log_looks_as_documented() {
        let header = Header {
            sensor: Some("hmc5843".into()),
            truth: vec![("seed".into(), "7".into())],
            ..Header::default()
        };
        let entry = Entry {
            reading: Reading {
                t_s: 0.5,
                field_mgauss: Some([Some(87.69), None, Some(f64::NAN)]),
                rate_rad_s: Some(Vector3::new(0.001, f64::INFINITY, 0.4)),
                specific_force_m_s2: Some(Vector3::new(0.0, -0.05, -9.79)),
            },
            heading_truth_deg: Some(30.0),
        };
        assert_eq!(
            String::from_utf8(written(&header, [entry]).unwrap()).unwrap(),
            "# headingd-log 1\n# sensor = hmc5843\n# mag_unit = mgauss\n# gyro_unit = rad/s\n\
             # accel_unit = m/s2\n# mag_axes = +x +y +z\n# gyro_axes = +x +y +z\n\
             # accel_axes = +x +y +z\n# seed = 7\n\
             t_s,mx,my,mz,gx,gy,gz,ax,ay,az,heading_deg\n\
             0.5,87.69,,,,,,0,-0.05,-9.79,30\n"
        );
    }

    fn vector(limit: f64) -> impl Strategy<Value = Option<Vector3<f64>>> {
        prop::option::of(prop::array::uniform3(-limit..limit).prop_map(Vector3::from))
    }

    fn entries() -> impl Strategy<Value = Vec<Entry>> {
        let field = prop::option::of(prop::array::uniform3(prop::option::of(-1e6..1e6)))
            .prop_map(|field| field.filter(|axes| axes.iter().any(Option::is_some)));
        let heading = prop::option::of(0.0..360.0);
        // As long as the longest gap that is not taken for a jump.
        let entry = (0.0..60.0, field, vector(1e3), vector(1e4), heading).prop_map(
            |(t_s, field_mgauss, rate_rad_s, specific_force_m_s2, heading_truth_deg)| Entry {
                reading: Reading {
                    t_s,
                    field_mgauss,
                    rate_rad_s,
                    specific_force_m_s2,
                },
                heading_truth_deg,
            },
        );
        prop::collection::vec(entry, 0..20).prop_map(|mut entries| {
            entries.sort_by(|a, b| a.reading.t_s.total_cmp(&b.reading.t_s));
            entries
        })
    }

    proptest! {
        #[test]
        fn what_was_written_is_read(entries in entries(), crlf in any::<bool>()) {
            let header = Header {
                truth: vec![("a".into(), "b = c".into())],
                ..Header::default()
            };
            let mut text = String::from_utf8(written(&header, entries.clone()).unwrap()).unwrap();
            if crlf {
                text = text.replace('\n', "\r\n");
            }
            let reader = Reader::new("a", text.as_bytes()).unwrap();
            prop_assert_eq!(reader.header(), &header);
            let read: Vec<Entry> = reader.map(Result::unwrap).collect();
            prop_assert_eq!(read, entries);
        }

        #[test]
        fn a_log_cut_anywhere_gives_exactly_its_whole_rows(entries in entries(), at in 0.0..1.0) {
            let text = written(&Header::default(), entries.clone()).unwrap();
            let head = written(&Header::default(), []).unwrap().len();
            let cut = &text[..(at * (text.len() + 1) as f64) as usize];
            let reader = Reader::new("a", cut);
            prop_assert_eq!(reader.is_ok(), cut.len() >= head);
            let Ok(mut reader) = reader else { return Ok(()) };
            let whole: Vec<Entry> = reader.by_ref().map(Result::unwrap).collect();
            let ends = cut[head..].iter().filter(|byte| **byte == b'\n').count();
            prop_assert_eq!(whole.len(), ends);
            let cut_off = reader.skips().first().is_some_and(|why| why.contains("cut off"));
            prop_assert_eq!(cut_off, !cut.ends_with(b"\n"));
            for (row, entry) in whole.into_iter().zip(&entries) {
                prop_assert_eq!(row.reading, entry.reading);
            }
        }
    }
}
