//! Starts the Razor: asks until it answers, then selects its output.
//!
//! Opening the port resets the board, which ignores input for a second or two and then sends angles. As its
//! authors' own client does (`C++/RazorAHRS.cpp`), `#s00` is repeated until `#SYNCH00` comes back.

use super::settings::Protocol;

/// Interval of requests, seconds; longer after [`SOON_S`], since the firmware may join the rest of one request to the next.
const PACE_S: f64 = 0.2;
const SOON_S: f64 = 5.0;
const LATER_PACE_S: f64 = 1.0;

const ASK: &[u8] = b"#s00";
/// Raw text; stream on; error lines on, since a sensor that cannot be read repeats its old numbers.
const TEXT: &[u8] = b"#osrt#o1#oe1#s01";
/// Raw binary; stream on; error lines off, since they would mix with the frames.
const BINARY: &[u8] = b"#osrb#o1#oe0#s01";

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    Asking,
    Selecting,
    Done,
}

#[derive(Clone, Debug)]
pub(super) struct Start {
    stage: Stage,
    /// Asking began, or begins, at this time, seconds.
    from_s: f64,
    sent_s: f64,
}

impl Start {
    /// Begins to ask at this time, seconds.
    pub(super) fn at(from_s: f64) -> Self {
        Self {
            stage: Stage::Asking,
            from_s,
            sent_s: f64::NEG_INFINITY,
        }
    }

    pub(super) fn due(&mut self, now_s: f64, protocol: Protocol) -> Option<&'static [u8]> {
        let pace_s = match self.stage {
            Stage::Asking if now_s - self.from_s <= SOON_S => PACE_S,
            _ => LATER_PACE_S,
        };
        let is_due = now_s >= self.from_s && now_s - self.sent_s >= pace_s;
        let bytes = match (self.stage, protocol) {
            (_, Protocol::LogRows) | (Stage::Done, _) => return None,
            (Stage::Asking, _) | (_, Protocol::Auto) => ASK,
            (Stage::Selecting, Protocol::Razor) => TEXT,
            (Stage::Selecting, Protocol::RazorBinary) => BINARY,
        };
        is_due.then(|| {
            self.sent_s = now_s;
            bytes
        })
    }

    pub(super) fn answered(&mut self, id: [u8; 2]) {
        match (self.stage, &id) {
            (Stage::Asking, b"00") => {
                self.stage = Stage::Selecting;
                self.sent_s = f64::NEG_INFINITY;
            }
            (Stage::Selecting, b"01") => self.stage = Stage::Done,
            _ => {}
        }
    }

    /// The device sends another output than the selected one: it was reset.
    pub(super) fn select_again(&mut self) {
        if self.stage == Stage::Done {
            self.stage = Stage::Selecting;
        }
    }

    /// The device is silent.
    pub(super) fn ask_again(&mut self, now_s: f64) {
        if self.stage == Stage::Done {
            *self = Self::at(now_s);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_asks_then_selects_then_is_quiet() {
        let mut start = Start::at(1.0);
        assert_eq!(start.due(0.9, Protocol::Razor), None);
        assert_eq!(start.due(1.0, Protocol::Razor), Some(ASK));
        assert_eq!(start.due(1.1, Protocol::Razor), None);
        assert_eq!(start.due(1.3, Protocol::Razor), Some(ASK));
        assert_eq!(start.due(7.0, Protocol::Razor), Some(ASK));
        assert_eq!(start.due(7.5, Protocol::Razor), None);
        start.answered(*b"01");
        start.answered(*b"00");
        assert_eq!(start.due(7.6, Protocol::Razor), Some(TEXT));
        assert_eq!(start.due(8.7, Protocol::RazorBinary), Some(BINARY));
        start.answered(*b"01");
        assert_eq!(start.due(100.0, Protocol::Razor), None);
        start.select_again();
        assert_eq!(start.due(100.1, Protocol::Razor), Some(TEXT));
        start.answered(*b"01");
        start.ask_again(101.0);
        assert_eq!(start.due(101.0, Protocol::Razor), Some(ASK));
        // A device that sends log rows is sent nothing.
        assert_eq!(Start::at(0.0).due(9.0, Protocol::LogRows), None);
    }
}
