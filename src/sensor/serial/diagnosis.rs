//! Why there are no readings, from what came in their place.

use super::Item;
use super::log_rows::HEADER_S;
use super::settings::{Protocol, Settings};
use crate::condition::SourceFault;

/// A text has hardly any byte that is no character; wrong speeds and binary numbers have many.
const ODD_SHARE: f64 = 0.1;

/// What has come since the last reading.
#[derive(Clone, Debug, Default)]
pub(super) struct Diagnosis {
    bytes: u64,
    /// Bytes that no ASCII text has.
    odd: u64,
    other_mode: Option<&'static str>,
    too_long: bool,
    /// Rows wait for their header.
    early: bool,
    unread: bool,
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

    /// Takes what is no reading.
    pub(super) fn item(&mut self, item: Item) {
        match item {
            Item::OtherMode(mode) => self.other_mode = Some(mode),
            Item::TooLong => self.too_long = true,
            // The first is half a line, as a rule.
            Item::Bad(why) => {
                self.bad = Some(why);
                self.garbled = true;
            }
            // Without lines that were not understood, it is the device that lacks the numbers.
            Item::Frame(_) => self.unread |= !std::mem::take(&mut self.garbled),
            Item::Early => self.early = true,
            Item::Timed(_) | Item::NewUnits | Item::Synch(_) => {}
        }
    }

    /// What is wrong, and what helps.
    pub(super) fn trouble(&self, settings: &Settings, protocol: Protocol) -> SourceFault {
        let baud = settings.baud;
        let speaks = protocol.name();
        let odd = self.odd as f64 / self.bytes.max(1) as f64;
        let (code, what) = if self.bytes == 0 {
            (
                "silent",
                "the device says nothing; check its power, its wires and whether it runs"
                    .to_owned(),
            )
        } else if self.early {
            (
                "no_header",
                format!(
                    "rows come without a header; they count {HEADER_S} s after the first, in milligauss, rad/s and m/s²; \
                     let the device send its header first (docs/serial.md)"
                ),
            )
        } else if self.unread {
            (
                "sensors",
                "the device says that it cannot read its sensors; check the wires between them"
                    .to_owned(),
            )
        } else if let Some(mode) = self.other_mode {
            (
                "other_mode",
                format!(
                    "the device sends {mode} and does not take the order to send raw readings; check that the \
                     port is the board's, and that the line is connected both ways"
                ),
            )
        } else if odd > ODD_SHARE {
            (
                "noise",
                format!(
                    "what comes is neither text nor {speaks}; check serial.baud, which is {baud}, and serial.protocol"
                ),
            )
        } else if self.too_long {
            (
                "long_line",
                format!(
                    "a line is longer than 4 KiB, so it is not {speaks}; check what the device sends"
                ),
            )
        } else {
            let what = self
                .bad
                .as_deref()
                .unwrap_or("found remarks, but no readings");
            (
                "not_understood",
                format!(
                    "{what}; expected {speaks}; check serial.protocol and what the device sends"
                ),
            )
        };
        SourceFault {
            code,
            message: format!("no readings from {}: {what}", settings.port.display()),
        }
    }
}
