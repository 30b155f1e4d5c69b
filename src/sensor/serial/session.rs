//! One opened port: from its bytes to timed readings, what to send to the device, and what is wrong. Pure.

use super::Item;
use super::decoder::Decoder;
use super::device_clock::DeviceClock;
use super::diagnosis::Diagnosis;
use super::log_rows::LogRows;
use super::settings::{Protocol, Settings};
use super::start::Start;
use super::steady_clock::SteadyClock;
use crate::condition::SourceFault;
use crate::reading::Reading;

/// A device of unknown kind is listened to before it is asked.
const LISTEN_S: f64 = 2.0;
/// Time for a device to boot, to be asked and to send its first field; more than the authors' client gives it.
const FIRST_S: f64 = 6.0;
/// Without a field for this long something is wrong.
const NEXT_S: f64 = 2.0;
/// And after this long without a reading the port is opened anew, which resets the device.
const REOPEN_S: f64 = 12.0;

#[derive(Debug, Default)]
pub(super) struct Due {
    pub(super) send: Option<&'static [u8]>,
    /// A fault to report, once.
    pub(super) trouble: Option<SourceFault>,
    /// A line for the log about refused lines, when one is due.
    pub(super) refused: Option<String>,
    /// The port is to be closed and opened again.
    pub(super) reopen: bool,
}

#[derive(Debug)]
pub(super) struct PortSession {
    settings: Settings,
    pub(super) decoder: Decoder,
    start: Start,
    pub(super) frames: SteadyClock,
    device: DeviceClock,
    diagnosis: Diagnosis,
    heard_s: f64,
    /// Time of the last reading, or of the last row that waits for a header; at first, when the port was opened.
    good_s: f64,
    /// When the last field came, or the port was opened: without one, the other readings are of no use.
    field_s: f64,
    /// Readings so far.
    pub(super) good: u64,
    /// Lines refused since the first reading.
    bad: u64,
    refused: Option<String>,
    /// How long a field may be missing before that is told, seconds; infinite once it has been.
    patience_s: f64,
}

impl PortSession {
    pub(super) fn new(settings: &Settings, now_s: f64) -> Self {
        let listen_s = match settings.protocol {
            Protocol::Auto => LISTEN_S,
            _ => 0.0,
        };
        Self {
            settings: settings.clone(),
            decoder: Decoder::new(settings),
            start: Start::at(now_s + listen_s),
            frames: SteadyClock::default(),
            device: DeviceClock::default(),
            diagnosis: Diagnosis::default(),
            heard_s: now_s,
            good_s: now_s,
            field_s: now_s,
            good: 0,
            bad: 0,
            refused: None,
            patience_s: FIRST_S,
        }
    }

    /// The port was not read for this long, seconds: the machine was suspended, or the process stopped. The device was not silent.
    pub(super) fn resume(&mut self, away_s: f64) {
        self.frames.resume();
        for last_s in [&mut self.heard_s, &mut self.good_s, &mut self.field_s] {
            *last_s += away_s;
        }
    }

    /// Takes bytes that have arrived at this time: the readings that they complete, and `None` where the readings that
    /// follow were sent in other units or axes.
    pub(super) fn bytes(
        &mut self,
        bytes: &[u8],
        log_rows: &mut LogRows,
        now_s: f64,
    ) -> Vec<Option<Reading>> {
        self.heard_s = now_s;
        self.diagnosis.bytes(bytes);
        let (mut items, mut readings) = (Vec::new(), Vec::new());
        self.decoder.feed(bytes, log_rows, |item| items.push(item));
        let mut field = false;
        for item in items {
            let timed = match &item {
                Item::Frame(frame) => Reading {
                    t_s: self.frames.time(now_s),
                    ..*frame
                },
                Item::Timed(row) => Reading {
                    t_s: self.device.time(row.t_s, now_s),
                    ..*row
                },
                Item::NewUnits => {
                    readings.push(None);
                    continue;
                }
                _ => {
                    self.take_other(item, now_s);
                    continue;
                }
            };
            let has_field = timed.field_mgauss.is_some();
            field |= has_field;
            if !has_field {
                self.diagnosis.item(item);
            }
            if has_field || timed.rate_rad_s.is_some() || timed.specific_force_m_s2.is_some() {
                self.good += 1;
                self.good_s = now_s;
                readings.push(Some(timed));
            }
        }
        if self.decoder.is_lost() {
            self.start.select_again();
        }
        if field {
            self.field_s = now_s;
            self.patience_s = NEXT_S;
            self.diagnosis = Diagnosis::default();
        }
        readings
    }

    /// Takes what is no reading.
    fn take_other(&mut self, item: Item, now_s: f64) {
        match &item {
            Item::Early => self.good_s = now_s,
            Item::Synch(id) => self.start.answered(*id),
            Item::OtherMode(_) => self.start.select_again(),
            // Before the first reading, half a line and boot messages are normal.
            Item::Bad(why) | Item::BadHeader(why) if self.good > 0 => self.count_bad(why),
            _ => {}
        }
        // Rows prove that the device has booted, so the fault is due sooner; not at once, since the first rows may date from
        // before the reset.
        if self.good == 0 && self.diagnosis.first_lacks_header(&item) {
            self.patience_s = NEXT_S;
        }
        self.diagnosis.item(item);
    }

    /// Counts a line that was refused.
    fn count_bad(&mut self, why: &str) {
        self.bad += 1;
        // At the first, the tenth, the hundredth …
        if self.bad == 10u64.pow(self.bad.ilog10()) {
            self.refused = Some(format!(
                "lines refused so far: {}, readings used: {}; the last line: {why}",
                self.bad, self.good
            ));
        }
    }

    /// Returns what is due at this time.
    pub(super) fn due(&mut self, now_s: f64) -> Due {
        if now_s - self.heard_s > NEXT_S {
            self.start.ask_again(now_s);
        }
        let protocol = self.decoder.protocol;
        let complain = now_s - self.field_s > self.patience_s;
        if complain {
            self.patience_s = f64::INFINITY;
        }
        Due {
            send: self.start.due(now_s, protocol),
            refused: self.refused.take(),
            trouble: complain.then(|| self.diagnosis.trouble(&self.settings, protocol)),
            reopen: now_s - self.good_s > REOPEN_S,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::Mountings;

    type Rig = (PortSession, LogRows);

    fn session(protocol: Protocol) -> Rig {
        let settings = Settings {
            port: "/dev/ttyX".into(),
            protocol,
            ..Settings::default()
        };
        let log_rows = LogRows::new(Mountings::default());
        (PortSession::new(&settings, 0.0), log_rows)
    }

    /// What is said in so many seconds of these lines, ten times a second; `{i}` in them is another digit each time.
    fn said((session, rows): &mut Rig, from_s: u32, seconds: u32, lines: &str) -> Vec<Due> {
        let said = |i: u32| {
            let now_s = f64::from(from_s) + f64::from(i) / 10.0;
            let lines = lines
                .replace("{t}", &now_s.to_string())
                .replace("{i}", &(i % 10).to_string());
            session.bytes(lines.as_bytes(), rows, now_s);
            session.due(now_s)
        };
        (1..=10 * seconds).map(said).collect()
    }

    fn only_trouble(said: Vec<Due>) -> String {
        assert!(said.iter().all(|due| !due.reopen));
        let mut troubles = said.into_iter().filter_map(|due| due.trouble);
        let trouble = troubles.next().expect("a trouble");
        assert_eq!(troubles.next(), None);
        format!("{}: {}", trouble.code, trouble.message)
    }

    const HEADER: &str = "# headingd-log 1\nt_s,mx,my,mz,gx,gy,gz\n";

    #[test]
    fn a_magnetometer_alone_that_fails_is_told_with_its_reason() {
        let good = "#A-R=0,{i},256\n#M-R={i},0,99\n#G-R=0,0,{i}\n";
        let failed = format!("!ERR: reading magnetometer\n{good}");
        let mut razor = session(Protocol::Razor);
        assert!(
            said(&mut razor, 0, 3, good)
                .iter()
                .all(|due| due.trouble.is_none())
        );
        let trouble = only_trouble(said(&mut razor, 3, 20, &failed));
        assert!(
            trouble.starts_with("sensors: no field from /dev/ttyX: "),
            "{trouble}"
        );
        assert!(trouble.contains("its magnetometer"), "{trouble}");

        for (row, why) in [
            ("{t},1,x,3,,,\n{t},,,,0,0,{i}\n", "found \"x\""),
            ("{t},,,,0,0,{i}\n", "cells are empty"),
        ] {
            let mut rows = session(Protocol::LogRows);
            said(&mut rows, 0, 1, HEADER);
            let trouble = only_trouble(said(&mut rows, 1, 20, row));
            assert!(trouble.contains(why), "{trouble}");
        }
    }

    #[test]
    fn a_header_that_is_missing_or_wrong_is_told_after_2_s() {
        let (mut session, mut rows) = session(Protocol::LogRows);
        let wrong = HEADER.replace("\nt_s", "\n# mag_unit = gaus\nt_s");
        let plain = "x\n0.1,1,2,3,0,0,1\n0.2,1,2,3,0,0,2\n";
        let mut told = Vec::new();
        for (lines, now_s) in [(plain, 1.0), (plain, 2.1), (&wrong, 2.2), (plain, 2.3)] {
            session.bytes(lines.as_bytes(), &mut rows, now_s);
            let trouble = session.due(now_s).trouble;
            told.extend(trouble.map(|trouble| (now_s, trouble)));
        }
        let rights = [
            (2.1, "rows come without a header"),
            (
                2.2,
                "the device's header is wrong: mag_unit is \"gaus\", but must be mgauss",
            ),
        ];
        assert_eq!(told.len(), rights.len(), "{told:?}");
        for ((told_s, told), (right_s, right)) in told.iter().zip(rights) {
            assert!(
                *told_s == right_s && told.message.contains(right),
                "{told:?}"
            );
        }
    }

    #[test]
    fn refused_lines_are_told_at_the_first_and_at_each_tenfold() {
        let mut rows = session(Protocol::LogRows);
        let good = "{t},1,{i},3,0,0,0\n";
        let told = |said: Vec<Due>| -> Vec<String> {
            said.into_iter().filter_map(|due| due.refused).collect()
        };
        assert!(told(said(&mut rows, 0, 1, &format!("{HEADER}nonsense\n"))).is_empty());
        assert!(told(said(&mut rows, 1, 1, good)).is_empty());
        let told = told(said(&mut rows, 2, 12, &format!("{good}9,9*00\n")));
        let begins = [
            "lines refused so far: 1, readings used: 11;",
            "lines refused so far: 10, readings used: 20;",
            "lines refused so far: 100, readings used: 110;",
        ];
        assert_eq!(told.len(), begins.len(), "{told:?}");
        for (told, begins) in told.iter().zip(begins) {
            assert!(
                told.starts_with(begins) && told.contains("checksum"),
                "{told}"
            );
        }
    }

    #[test]
    fn a_damaged_header_between_good_rows_is_told() {
        let mut rows = session(Protocol::LogRows);
        said(&mut rows, 0, 1, &format!("{HEADER}{{t}},1,{{i}},3,0,0,0\n"));
        let damaged = HEADER.replace("\nt_s", "\n# mag_unit = tesla\nt_s");
        let refused = said(&mut rows, 1, 1, &damaged)[0].refused.clone();
        assert!(refused.is_some_and(|told| told.contains("tesla")));
    }
}
