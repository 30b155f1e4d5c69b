//! Raw readings as objects of the dialect, written and read back: the header and the rows of a log, for clients that
//! ask for them.

use std::fmt::Write;

use nalgebra::Vector3;
use serde::Deserialize;
use serde_json::Value;

use super::json::push_string;
use crate::reading::Reading;
use crate::recording::{COLUMNS, Header, Reader, RecordingError};

/// What a client that wants raw readings hears.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(tag = "class", rename_all = "UPPERCASE")]
pub enum Object {
    /// Whose readings they are; comes before the first, and when the service reads another board.
    Board {
        /// The header of a log, all its lines.
        header: String,
    },
    Reading(Row),
    State {
        cal_state: String,
        message: String,
    },
    #[serde(other)]
    Other,
}

/// One reading, in the columns of a log; what is not known is left out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
pub struct Row {
    /// Counts the source's readings from 1: a gap is what was lost on the way to this client.
    pub seq: u64,
    t_s: f64,
    mx: Option<f64>,
    my: Option<f64>,
    mz: Option<f64>,
    gx: Option<f64>,
    gy: Option<f64>,
    gz: Option<f64>,
    ax: Option<f64>,
    ay: Option<f64>,
    az: Option<f64>,
}

/// The object that tells whose readings these are.
pub(super) fn board(header: &Header) -> String {
    let mut line = String::from(r#"{"class":"BOARD""#);
    push_string(&mut line, "header", &header.text());
    line + "}"
}

/// A reading as an object, each number exactly and as short as can be.
pub(super) fn reading(seq: u64, reading: &Reading) -> String {
    let t_s = Value::from(reading.t_s);
    let mut line = format!(r#"{{"class":"READING","seq":{seq},"t_s":{t_s}"#);
    for (name, cell) in COLUMNS[1..].iter().zip(reading.cells().as_flattened()) {
        if let Some(number) = cell {
            // Writing to a String does not fail.
            let _ = write!(line, r#","{name}":{}"#, Value::from(*number));
        }
    }
    line + "}"
}

/// The header that a board's object holds.
pub fn header(text: &str) -> Result<Header, RecordingError> {
    Reader::new("BOARD", text.as_bytes()).map(|reader| reader.header().clone())
}

impl Row {
    /// The reading, as a log would give it back.
    pub fn reading(&self) -> Reading {
        let field = [self.mx, self.my, self.mz];
        let whole = |x: Option<f64>, y, z| Some(Vector3::new(x?, y?, z?));
        Reading {
            t_s: self.t_s,
            field_mgauss: field.iter().any(Option::is_some).then_some(field),
            rate_rad_s: whole(self.gx, self.gy, self.gz),
            specific_force_m_s2: whole(self.ax, self.ay, self.az),
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_board_is_the_header_of_a_log() {
        let right = Header {
            sensor: Some("hmc5843".into()),
            truth: vec![
                ("class".into(), "a \"b\"".into()),
                ("class".into(), "c".into()),
            ],
            ..Header::default()
        };
        let text = board(&right);
        assert!(
            text.starts_with(r##"{"class":"BOARD","header":"# headingd-log 1\n"##),
            "{text}"
        );
        let Ok(Object::Board { header: found }) = serde_json::from_str(&text) else {
            panic!("{text}");
        };
        assert_eq!(header(&found).unwrap(), right);
        assert!(header("# headingd-log 2\n").is_err());
    }

    fn vector(limit: f64) -> impl Strategy<Value = Option<Vector3<f64>>> {
        prop::option::of(prop::array::uniform3(-limit..limit).prop_map(Vector3::from))
    }

    proptest! {
        #[test]
        fn a_reading_comes_back_bit_by_bit(
            t_s in 0.0..1e7,
            field in prop::option::of(prop::array::uniform3(prop::option::of(-1e4..1e4))),
            rate_rad_s in vector(100.0),
            specific_force_m_s2 in vector(1e3),
        ) {
            let right = Reading {
                t_s,
                field_mgauss: field.filter(|axes| axes.iter().any(Option::is_some)),
                rate_rad_s,
                specific_force_m_s2,
            };
            match serde_json::from_str(&reading(3, &right)) {
                Ok(Object::Reading(row)) => {
                    prop_assert_eq!(row.seq, 3);
                    prop_assert_eq!(row.reading(), right);
                }
                other => prop_assert!(false, "{:?}", other),
            }
        }
    }
}
