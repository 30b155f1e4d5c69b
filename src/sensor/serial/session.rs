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

/// The Razor's loop (`OUTPUT__DATA_INTERVAL`), seconds.
const RAZOR_PERIOD_S: f64 = 0.02;
/// A device of unknown kind is listened to before it is asked.
const LISTEN_S: f64 = 2.0;
/// A device has this long to boot, to be asked and to send its first reading; more than the authors' client
/// gives it.
const FIRST_S: f64 = 6.0;
/// Without a reading for this long something is wrong.
const NEXT_S: f64 = 2.0;
/// And after this long the port is opened anew, which resets the device.
const REOPEN_S: f64 = 12.0;

#[derive(Debug, Default)]
pub(super) struct Orders {
    pub(super) send: Option<&'static [u8]>,
    /// To be told, once.
    pub(super) trouble: Option<SourceFault>,
    /// The port is to be closed and opened again.
    pub(super) reopen: bool,
}

#[derive(Debug)]
pub(super) struct PortSession {
    settings: Settings,
    decoder: Decoder,
    start: Start,
    frames: SteadyClock,
    device: DeviceClock,
    diagnosis: Diagnosis,
    heard_s: f64,
    /// When the last reading came; before the first, when the port was opened.
    good_s: f64,
    /// When the last row came that waits for a header: there is nothing wrong with the port.
    early_s: f64,
    patience_s: f64,
    complained: bool,
}

impl PortSession {
    pub(super) fn new(settings: &Settings, log_rows: LogRows, now_s: f64) -> Self {
        let listen_s = match settings.protocol {
            Protocol::Auto => LISTEN_S,
            _ => 0.0,
        };
        Self {
            settings: settings.clone(),
            decoder: Decoder::new(settings, log_rows),
            start: Start::at(now_s + listen_s),
            frames: SteadyClock::new(RAZOR_PERIOD_S),
            device: DeviceClock::default(),
            diagnosis: Diagnosis::default(),
            heard_s: now_s,
            good_s: now_s,
            early_s: now_s,
            patience_s: FIRST_S,
            complained: false,
        }
    }

    /// What is known of the device's log rows.
    pub(super) fn into_log_rows(self) -> LogRows {
        self.decoder.into_log_rows()
    }

    pub(super) fn protocol(&self) -> Protocol {
        self.decoder.protocol()
    }

    /// How many frames were lost on the way.
    pub(super) fn lost(&self) -> u64 {
        self.frames.lost()
    }

    /// Nobody has listened for a while: the next bytes may have waited.
    pub(super) fn resume(&mut self) {
        self.frames.resume();
    }

    /// Takes bytes that have arrived at this time, and hands over the readings that they complete; `None`
    /// where the readings that follow have other units.
    pub(super) fn bytes(
        &mut self,
        bytes: &[u8],
        now_s: f64,
        mut reading: impl FnMut(Option<Reading>),
    ) {
        self.heard_s = now_s;
        self.diagnosis.bytes(bytes);
        let mut good = false;
        self.decoder.feed(bytes, |item| {
            let timed = match item {
                Item::Frame(frame) => Reading {
                    t_s: self.frames.time(now_s),
                    ..frame
                },
                Item::Timed(row) => Reading {
                    t_s: self.device.time(row.t_s, now_s),
                    ..row
                },
                Item::NewUnits => return reading(None),
                other => {
                    match &other {
                        Item::Early => self.early_s = now_s,
                        Item::Synch(id) => self.start.answered(*id),
                        Item::OtherMode(_) => self.start.order_again(),
                        _ => {}
                    }
                    return self.diagnosis.item(other);
                }
            };
            let says_something = timed.field_mgauss.is_some()
                || timed.rate_rad_s.is_some()
                || timed.specific_force_m_s2.is_some();
            if says_something {
                good = true;
                reading(Some(timed));
            } else {
                self.diagnosis.item(Item::Frame(timed));
            }
        });
        if self.decoder.is_lost() {
            self.start.order_again();
        }
        if good {
            self.good_s = now_s;
            self.patience_s = NEXT_S;
            self.complained = false;
            self.diagnosis = Diagnosis::default();
        }
    }

    /// What the time asks for.
    pub(super) fn orders(&mut self, now_s: f64) -> Orders {
        if now_s - self.heard_s > NEXT_S {
            self.start.ask_again(now_s);
        }
        let waited_s = now_s - self.good_s;
        let complain = waited_s > self.patience_s && !self.complained;
        self.complained |= complain;
        let protocol = self.protocol();
        Orders {
            send: self.start.due(now_s, protocol),
            trouble: complain.then(|| self.diagnosis.trouble(&self.settings, protocol)),
            reopen: now_s - self.good_s.max(self.early_s) > REOPEN_S,
        }
    }
}
