//! The source thread: readings of a log or a simulated board, each at its own time, or of real chips and boards.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Instant;

use tokio::sync::mpsc;

use super::{DaemonError, chips, serial, spawn};
use crate::condition::Trouble;
use crate::config::Config;
use crate::config::source::Kind;
use crate::frame::Mountings;
use crate::reading::Reading;
use crate::recording::{Header, Skips};
use crate::sensor::clock::{Clock, SystemClock};
use crate::sensor::i2c;
use crate::sensor::replay::{Replay, ReplayError};
use crate::sensor::serial::Bridge;
use crate::sensor::simulator::Simulator;

/// How many messages wait for the pipeline; then the source waits.
const WAITING_MESSAGES: usize = 64;

/// What the source thread says.
#[derive(Debug)]
pub(super) enum Message {
    /// A reading, and when it was handed out.
    Reading(Reading, Instant),
    /// Several readings at once, in order, each with the moment when it was taken.
    Readings(Vec<(Reading, Instant)>),
    /// The times of the readings that follow have nothing to do with those before.
    NewStretch,
    /// Something is wrong with the source, which goes on trying; `None` when it works again.
    Trouble(Option<Trouble>),
    /// There is nothing left; why most of what there was could not be used, if so.
    End(Option<String>),
    /// The source cannot go on, and this is why.
    Broken(Trouble),
}

/// Where readings come from.
pub(super) enum Source {
    Played(Played),
    I2c {
        settings: i2c::Settings,
        mountings: Box<Mountings>,
    },
    Serial {
        port: String,
        baud: u32,
        header: Box<Header>,
        bridge: Box<Bridge>,
    },
}

/// A source whose readings were made before.
pub(super) enum Played {
    Simulator(Box<Simulator>),
    Replay { log: String, replay: Box<Replay> },
}

/// A source at work.
pub(super) struct Playing {
    pub(super) messages: mpsc::Receiver<Message>,
    pub(super) thread: JoinHandle<()>,
    stop: Arc<AtomicBool>,
}

impl Playing {
    /// Tells the thread to end, which it does at once or when it looks next.
    pub(super) fn stop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        // The thread may be waiting for room.
        self.messages.close();
        while self.messages.try_recv().is_ok() {}
    }
}

impl Source {
    pub(super) fn open(config: &Config) -> Result<Self, DaemonError> {
        Ok(match config.source.kind.ok_or(DaemonError::NoSource)? {
            Kind::Simulator => {
                let simulator =
                    Simulator::new(config.simulator.clone()).map_err(DaemonError::Simulator)?;
                Self::Played(Played::Simulator(Box::new(simulator)))
            }
            Kind::Replay => Self::Played(Played::Replay {
                log: config.source.log.display().to_string(),
                replay: Box::new(Replay::open(&config.source.log)?),
            }),
            // Chips that are missing now may come yet: nothing is opened here.
            Kind::I2c => Self::I2c {
                settings: config.i2c.clone(),
                mountings: Box::new(config.i2c.mountings(&config.mounting.chips())),
            },
            Kind::Serial => Self::Serial {
                port: config.serial.port.display().to_string(),
                baud: config.serial.baud,
                header: Box::new(Header {
                    sensor: Some(config.serial.chip.name().to_owned()),
                    mountings: config.mounting.chips(),
                    ..Header::default()
                }),
                bridge: Box::new(Bridge::new(&config.serial, config.mounting.chips())),
            },
        })
    }

    /// As clients see it.
    pub(super) fn name(&self) -> String {
        match self {
            Self::Played(Played::Simulator(_)) => "simulator".to_owned(),
            Self::Played(Played::Replay { log, .. }) => log.clone(),
            Self::I2c { settings, .. } => settings.path().display().to_string(),
            Self::Serial { port, .. } => port.clone(),
        }
    }

    /// Speed of its line in bits a second, if it has one.
    pub(super) fn bps(&self) -> Option<u32> {
        match self {
            Self::Serial { baud, .. } => Some(*baud),
            Self::Played(_) | Self::I2c { .. } => None,
        }
    }

    /// What the board says of itself.
    pub(super) fn header(&self) -> Header {
        match self {
            Self::Played(Played::Simulator(simulator)) => simulator.header(),
            Self::Played(Played::Replay { replay, .. }) => replay.header().clone(),
            Self::I2c {
                settings,
                mountings,
            } => Header {
                sensor: Some(settings.sensor().to_owned()),
                mountings: **mountings,
                ..Header::default()
            },
            Self::Serial { header, .. } => (**header).clone(),
        }
    }

    /// Starts to hand out readings, those that are played `speed` times as fast as they were taken.
    pub(super) fn start(self, speed: f64) -> Result<Playing, DaemonError> {
        let (sender, messages) = mpsc::channel(WAITING_MESSAGES);
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = stop.clone();
        let clock = SystemClock::new(stop.clone());
        let thread = spawn("source", "source", move || match self {
            Self::Played(played) => play(played, speed, &sender, clock),
            Self::I2c { settings, .. } => chips::read(&settings, &sender, clock),
            Self::Serial { bridge, .. } => serial::play(*bridge, &sender, &stopped),
        })?;
        Ok(Playing {
            messages,
            thread,
            stop,
        })
    }
}

impl Played {
    fn next(&mut self) -> Option<Result<Reading, ReplayError>> {
        match self {
            Self::Simulator(simulator) => simulator.next().map(|entry| Ok(entry.reading)),
            Self::Replay { replay, .. } => Some(replay.next()?.map(|entry| entry.reading)),
        }
    }

    /// Whether the time of the last reading has nothing to do with those before.
    fn begins_stretch(&self) -> bool {
        match self {
            Self::Simulator(_) => false,
            Self::Replay { replay, .. } => replay.begins_stretch(),
        }
    }

    /// The rows skipped.
    fn skips(&self) -> Option<&Skips> {
        match self {
            Self::Simulator(_) => None,
            Self::Replay { replay, .. } => Some(replay.skips()),
        }
    }
}

/// Why most of a log could not be used, if so.
fn unusable(source: &Played) -> Option<String> {
    let skips = source.skips().filter(|skips| skips.are_most())?;
    skips.summary()
}

fn play(mut source: Played, speed: f64, out: &mpsc::Sender<Message>, mut clock: SystemClock) {
    let mut origin = None;
    let mut told = false;
    let last_words = loop {
        let next = source.next();
        if !told && let Some(first) = source.skips().and_then(Skips::first) {
            tracing::warn!("skipping rows that cannot be used; the first: {first}");
            told = true;
        }
        let reading = match next {
            Some(Ok(reading)) => reading,
            Some(Err(error)) => {
                break Some(Message::Broken(Trouble {
                    code: "log",
                    message: error.to_string(),
                }));
            }
            None => break Some(Message::End(unusable(&source))),
        };
        if source.begins_stretch() {
            tracing::warn!(
                t_s = reading.t_s,
                "the time of the log jumps: what was known of the board's motion is over"
            );
            // What lies between the two was never recorded, and is not waited for.
            origin = None;
            if out.blocking_send(Message::NewStretch).is_err() {
                break None;
            }
        }
        let (begun_s, first_s) = *origin.get_or_insert_with(|| (clock.now_s(), reading.t_s));
        // Each due time is counted from the first, so that sleeping too long never adds up.
        if !clock.wait_until(begun_s + (reading.t_s - first_s) / speed) {
            break None;
        }
        if out
            .blocking_send(Message::Reading(reading, Instant::now()))
            .is_err()
        {
            break None;
        }
    };
    if let Some(skips) = source.skips()
        && let Some(first) = skips.first()
    {
        let count = skips.count();
        tracing::warn!("skipped rows that cannot be used: {count} in all; the first: {first}");
    }
    if let Some(message) = last_words {
        // An error means that the daemon is about to end anyway.
        let _ = out.blocking_send(message);
    }
}
