//! Why there is no field, from what came in its place.

use super::Item;
use super::log_rows::HEADER_S;
use super::settings::{Protocol, Settings};
use crate::condition::SourceFault;

/// A larger share of non-text bytes means a wrong speed or a binary protocol.
const ODD_SHARE: f64 = 0.1;
/// After so many good rows without a field, the last refused line is not the reason.
const MANY_ROWS: u32 = 100;

/// What has come since the last field.
#[derive(Clone, Debug, Default)]
pub(super) struct Diagnosis {
    bytes: u64,
    /// Bytes that no ASCII text has.
    odd: u64,
    other_mode: Option<&'static str>,
    too_long: bool,
    /// Rows wait for their header.
    early: bool,
    /// What is wrong with the device's header.
    header: Option<String>,
    unread: bool,
    /// The other sensors can be read.
    others: bool,
    /// Good rows without a field since the last line that cannot be used.
    rows: u32,
    /// What has come since the last frame cannot be used.
    garbled: bool,
    bad: Option<String>,
}

impl Diagnosis {
    pub(super) fn bytes(&mut self, bytes: &[u8]) {
        let is_text = |byte: &u8| matches!(byte, b' '..=b'~' | b'\r' | b'\n' | b'\t');
        self.bytes += bytes.len() as u64;
        self.odd += bytes.iter().filter(|byte| !is_text(byte)).count() as u64;
    }

    /// Whether this shows for the first time that rows lack a header, or a right one.
    pub(super) fn first_lacks_header(&self, item: &Item) -> bool {
        match item {
            Item::Early => !self.early,
            Item::BadHeader(_) => self.header.is_none(),
            _ => false,
        }
    }

    /// Takes what has no field.
    pub(super) fn item(&mut self, item: Item) {
        if let Item::Frame(reading) | Item::Timed(reading) = &item {
            self.others |= reading.rate_rad_s.or(reading.specific_force_m_s2).is_some();
        }
        match item {
            Item::OtherMode(mode) => self.other_mode = Some(mode),
            Item::TooLong => self.too_long = true,
            // The last one is kept: the first is usually half a line.
            Item::Bad(why) => {
                self.bad = Some(why);
                self.garbled = true;
                self.rows = 0;
            }
            Item::BadHeader(why) => self.header = Some(why),
            // Without a garbled line since the last frame, the device could not read its sensors.
            Item::Frame(_) => self.unread |= !std::mem::take(&mut self.garbled),
            Item::Timed(_) => self.rows = self.rows.saturating_add(1),
            Item::Early => self.early = true,
            Item::NewUnits | Item::Synch(_) => {}
        }
    }

    /// What is wrong, and what helps.
    pub(super) fn trouble(&self, settings: &Settings, protocol: Protocol) -> SourceFault {
        let (code, what) = self.cause(settings.baud, protocol.name());
        let readings = if self.others { "field" } else { "readings" };
        SourceFault {
            code,
            message: format!("no {readings} from {}: {what}", settings.port.display()),
        }
    }

    /// The first cause that applies.
    fn cause(&self, baud: u32, protocol: &str) -> (&'static str, String) {
        if self.bytes == 0 {
            let what = "the device sends nothing; check its power, its wires and whether it runs";
            return ("silent", what.to_owned());
        }
        if let Some(header) = &self.header {
            let what = format!("the device's header is wrong: {header}");
            return ("not_understood", what);
        }
        if self.early {
            let what = format!(
                "rows come without a header; they count {HEADER_S} s after the first, in milligauss, rad/s and m/s²; \
                 let the device send its header first (docs/serial.md)"
            );
            return ("no_header", what);
        }
        if self.unread {
            let sensors = if self.others {
                "magnetometer"
            } else {
                "sensors"
            };
            let what = format!(
                "the device says that it cannot read its {sensors}; check the wires between them"
            );
            return ("sensors", what);
        }
        if self.rows > 0 && (self.bad.is_none() || self.rows > MANY_ROWS) {
            let what = "the magnetometer's cells are empty: it cannot be read, or a magnet is near; check its wires";
            return ("sensors", what.to_owned());
        }
        if let Some(mode) = self.other_mode {
            let what = format!(
                "the device sends {mode} and does not take the order to send raw readings; check that the \
                 port is the board's, and that the line is connected both ways"
            );
            return ("other_mode", what);
        }
        if self.odd as f64 > ODD_SHARE * self.bytes as f64 {
            let what = format!(
                "what comes is neither text nor {protocol}; check serial.baud, which is {baud}, and serial.protocol"
            );
            return ("noise", what);
        }
        if self.too_long {
            let what = format!(
                "a line is longer than 4 KiB, so it is not {protocol}; check what the device sends"
            );
            return ("long_line", what);
        }
        let bad = self.bad.as_deref();
        let found = bad.unwrap_or("what came has no whole reading in it");
        let what = format!(
            "{found}; expected {protocol}; check serial.protocol and what the device sends"
        );
        ("not_understood", what)
    }
}
