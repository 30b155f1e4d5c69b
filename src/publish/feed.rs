//! From the one publisher to many clients: each reads at its own pace, and none can hold up another.

use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Duration, Instant};

use tokio::sync::broadcast;

use super::gpsd::{self, Device};
use super::{nmea, raw};
use crate::calibration::outcome::Outcome;
use crate::condition::Report;
use crate::heading::Heading;
use crate::reading::Reading;
use crate::recording::Header;

/// How many raw readings a client may fall behind before it loses the oldest: some six seconds of them.
const READINGS: usize = 1024;

/// A longer time from one heading to the next is a gap.
const MOST_CYCLE_S: f64 = 10.0;

/// Share of the newest of those times in what clients are told.
const CYCLE_GAIN: f64 = 0.02;

/// The daemon's end of the server: a handle on what it shares with the clients.
pub type Publisher = Arc<Feed>;

/// What the publisher and the clients share. Publishing never blocks, whatever the clients do.
#[derive(Debug)]
pub struct Feed {
    /// Path of the source.
    pub(super) path: String,
    nmea: nmea::Settings,
    pub(super) clients: AtomicUsize,
    stale: Duration,
    /// A ring of bounded size: a client that falls behind by more than it holds loses the oldest.
    ring: broadcast::Sender<Broadcast>,
    /// Raw readings; made for the first client that asks.
    readings: OnceLock<broadcast::Sender<Raw>>,
    /// Counts the readings.
    read: AtomicU64,
    latest: Mutex<Latest>,
}

#[derive(Debug)]
struct Latest {
    device: Device,
    heading: Option<Arc<PublishedHeading>>,
    /// By their kinds.
    events: [NumberedLine; 2],
    board: Arc<str>,
    cycle_s: Option<f64>,
}

impl Latest {
    /// Follows how long it takes from one heading to the next. Sources tick unevenly, and jump.
    fn count(&mut self, heading: &Heading) {
        let Some(last) = &self.heading else { return };
        let passed_s = heading.t_s - last.heading.t_s;
        if 0.0 < passed_s && passed_s <= MOST_CYCLE_S {
            let cycle_s = self.cycle_s.get_or_insert(passed_s);
            *cycle_s += CYCLE_GAIN * (passed_s - *cycle_s);
        }
    }
}

/// A heading on its way to clients.
#[derive(Clone, Debug)]
pub(super) struct PublishedHeading {
    pub(super) heading: Heading,
    /// When the magnetometer was read.
    pub(super) taken: Instant,
    /// The same moment, RFC 3339 in UTC, if the time of day is known.
    pub(super) time: Option<String>,
    /// Its lines in both formats of the socket: encoded once, for all clients, if one of them wants the format. `att` is without the
    /// heading's age, which is added when it is written to a client.
    att: OnceLock<String>,
    nmea: OnceLock<String>,
}

/// One entry of the ring.
#[derive(Clone, Debug)]
pub(super) enum Broadcast {
    Heading(Arc<PublishedHeading>),
    Event(EventKind, NumberedLine),
}

/// One entry of the ring of raw readings.
#[derive(Clone, Debug)]
pub(super) enum Raw {
    /// The readings that follow are this board's.
    Board(Arc<str>),
    /// A reading with its number.
    Reading(u64, Reading),
}

/// What is sent when it happens, and to whoever begins to watch for it.
#[derive(Clone, Copy, Debug)]
pub(super) enum EventKind {
    State,
    Calibration,
}

impl EventKind {
    pub(super) const ALL: [Self; 2] = [Self::State, Self::Calibration];
}

/// A line with its number, by which a client that fell behind knows what it has missed. Number 0 stands for no line.
#[derive(Clone, Debug, Default)]
pub(super) struct NumberedLine {
    pub(super) number: u64,
    pub(super) line: Arc<str>,
}

impl Feed {
    pub(super) fn new(
        device: Device,
        nmea: nmea::Settings,
        backlog: usize,
        stale: Duration,
    ) -> Self {
        Self {
            path: device.path.clone(),
            nmea,
            clients: AtomicUsize::new(0),
            stale,
            ring: broadcast::Sender::new(backlog),
            readings: OnceLock::new(),
            read: AtomicU64::new(0),
            latest: Mutex::new(Latest {
                device,
                heading: None,
                events: Default::default(),
                board: Arc::default(),
                cycle_s: None,
            }),
        }
    }

    /// Sends a heading to all who watch for headings, and keeps it for `?POLL;`. `taken` is when the
    /// magnetometer was read: the heading is not sent once it is older than `stale_s`. `time` is the same
    /// moment, RFC 3339 in UTC, if the time of day is known.
    pub fn heading(&self, heading: Heading, taken: Instant, time: Option<String>) {
        let mut latest = self.lock();
        latest.count(&heading);
        if latest.device.activated.is_none() {
            latest.device.activated.clone_from(&time);
        }
        let published = Arc::new(PublishedHeading {
            heading,
            taken,
            time,
            att: OnceLock::new(),
            nmea: OnceLock::new(),
        });
        self.send(Broadcast::Heading(published.clone()));
        latest.heading = Some(published);
    }

    /// Sends the condition to all who watch for `STATE`, and keeps it for those who will.
    pub fn state(&self, report: &Report) {
        self.event(EventKind::State, gpsd::state(report));
    }

    /// Sends the outcome to all who watch for `CALIBRATION`, and keeps it for those who will.
    pub fn calibration(&self, outcome: &Outcome) {
        self.event(EventKind::Calibration, gpsd::calibration(outcome));
    }

    fn event(&self, kind: EventKind, line: String) {
        let mut latest = self.lock();
        let last = &mut latest.events[kind as usize];
        *last = NumberedLine {
            number: last.number + 1,
            line: line.into(),
        };
        self.send(Broadcast::Event(kind, last.clone()));
    }

    /// The source has become another one at the same path.
    pub fn device(&self, device: Device) {
        self.lock().device = device;
    }

    /// Says whose raw readings will come, for clients that ask for them, now or later.
    pub fn board(&self, header: &Header) {
        let line: Arc<str> = raw::board(header).into();
        self.lock().board = line.clone();
        self.send_raw(Raw::Board(line));
    }

    /// Sends a raw reading to all who watch for `READING`.
    pub fn reading(&self, reading: &Reading) {
        let seq = self.read.fetch_add(1, Ordering::Relaxed) + 1;
        self.send_raw(Raw::Reading(seq, *reading));
    }

    /// The latest heading, while it is not stale.
    pub fn latest(&self) -> Option<Heading> {
        let latest = self.lock();
        let kept = latest.heading.as_ref()?;
        (!self.is_stale(kept.taken)).then(|| kept.heading.clone())
    }

    /// How many clients are connected.
    pub fn clients(&self) -> usize {
        self.clients.load(Ordering::Relaxed)
    }

    pub(super) fn subscribe(&self) -> broadcast::Receiver<Broadcast> {
        self.ring.subscribe()
    }

    pub(super) fn subscribe_readings(&self) -> broadcast::Receiver<Raw> {
        let made = || broadcast::Sender::new(READINGS);
        self.readings.get_or_init(made).subscribe()
    }

    /// The object that tells whose readings they are; empty if nobody has said.
    pub(super) fn board_line(&self) -> Arc<str> {
        self.lock().board.clone()
    }

    /// The device, as `DEVICE` tells it.
    pub(super) fn device_line(&self) -> String {
        let latest = self.lock();
        gpsd::device(&latest.device, latest.cycle_s)
    }

    /// The latest event of each kind.
    pub(super) fn events(&self) -> [NumberedLine; 2] {
        self.lock().events.clone()
    }

    /// Whether a heading read at `taken` is too old to be shown to anybody.
    pub(super) fn is_stale(&self, taken: Instant) -> bool {
        taken.elapsed() > self.stale
    }

    /// Appends a heading as an `ATT` object.
    pub(super) fn put_att(&self, out: &mut String, published: &PublishedHeading) {
        out.push_str(published.att.get_or_init(|| {
            let mut line = String::new();
            let time = published.time.as_deref();
            gpsd::att_begin(&mut line, &self.path, &published.heading, time);
            line
        }));
        let age_ms = published.taken.elapsed().as_millis();
        gpsd::att_end(out, u64::try_from(age_ms).unwrap_or(u64::MAX));
    }

    /// A heading as NMEA 0183.
    pub(super) fn nmea<'a>(&self, published: &'a PublishedHeading) -> &'a str {
        let encoded = || nmea::sentences(&self.nmea.talker, &published.heading);
        published.nmea.get_or_init(encoded)
    }

    /// How often headings go out as NMEA 0183, unless a client asks for another rate.
    pub(super) fn nmea_rate_hz(&self) -> f64 {
        self.nmea.rate_hz
    }

    pub(super) fn poll(&self) -> String {
        let latest = self.lock();
        match &latest.heading {
            Some(kept) if !self.is_stale(kept.taken) => {
                let mut att = String::new();
                self.put_att(&mut att, kept);
                gpsd::poll(Some(&att), kept.time.as_deref())
            }
            _ => gpsd::poll(None, None),
        }
    }

    fn send(&self, message: Broadcast) {
        // The only error is that nobody is listening.
        let _ = self.ring.send(message);
    }

    fn send_raw(&self, message: Raw) {
        if let Some(ring) = self.readings.get() {
            // The only error is that nobody is listening.
            let _ = ring.send(message);
        }
    }

    fn lock(&self) -> MutexGuard<'_, Latest> {
        // Each field is replaced whole, so a panic elsewhere cannot have left it half changed.
        self.latest.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_device_that_was_opened_before_the_time_of_day_was_known_learns_it() {
        let device = Device {
            path: "d".to_owned(),
            activated: None,
            sensor: None,
            bps: None,
        };
        let feed = Feed::new(device, nmea::Settings::default(), 8, Duration::MAX);
        for time in [None, Some("2026-11-21T10:00:00.000Z"), Some("later")] {
            let time = time.map(str::to_owned);
            feed.heading(Heading::default(), Instant::now(), time);
        }
        let device = feed.device_line();
        let known = r#""activated":"2026-11-21T10:00:00.000Z""#;
        assert!(device.contains(known), "{device}");
    }
}
