//! The source thread: readings of a log or a simulated board, each at its own time.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use tokio::sync::mpsc;

use super::{DaemonError, serial, spawn};
use crate::condition::Trouble;
use crate::config::Config;
use crate::config::source::Kind;
use crate::reading::Reading;
use crate::recording::Header;
use crate::sensor::replay::{Replay, ReplayError};
use crate::sensor::serial::Bridge;
use crate::sensor::simulator::Simulator;

/// How many messages wait for the pipeline; then the source waits.
const WAITING_MESSAGES: usize = 64;

/// A source that sleeps looks this often whether it is to stop.
const LOOK: Duration = Duration::from_millis(50);

/// What the source thread says.
#[derive(Debug)]
pub(super) enum Message {
    /// A reading, and when it was handed out.
    Reading(Reading, Instant),
    /// Something is wrong with the source, which goes on trying; `None` when it works again.
    Trouble(Option<Trouble>),
    /// There is nothing left.
    End,
    /// The source cannot go on, and this is why.
    Broken(Trouble),
}

/// Where readings come from.
pub(super) enum Source {
    Simulator(Box<Simulator>),
    Replay {
        log: String,
        replay: Box<Replay>,
    },
    Serial {
        port: String,
        header: Box<Header>,
        bridge: Box<Bridge>,
    },
}

/// A source at work.
pub(super) struct Playing {
    pub(super) messages: mpsc::Receiver<Message>,
    pub(super) thread: JoinHandle<()>,
    stop: Arc<AtomicBool>,
}

impl Playing {
    /// Tells the thread to end, which it does at once or after [`LOOK`].
    pub(super) fn stop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        // The thread may be waiting for room.
        self.messages.close();
        while self.messages.try_recv().is_ok() {}
    }
}

impl Source {
    pub(super) fn open(config: &Config) -> Result<Self, DaemonError> {
        Ok(match config.source.kind {
            Kind::Simulator => {
                let simulator =
                    Simulator::new(config.simulator.clone()).map_err(DaemonError::Simulator)?;
                Self::Simulator(Box::new(simulator))
            }
            Kind::Replay => Self::Replay {
                log: config.source.log.display().to_string(),
                replay: Box::new(Replay::open(&config.source.log)?),
            },
            Kind::Serial => Self::Serial {
                port: config.serial.port.display().to_string(),
                header: Box::new(Header {
                    sensor: Some(config.serial.chip.name().to_owned()),
                    mountings: config.mounting,
                    truth: Vec::new(),
                }),
                bridge: Box::new(Bridge::new(&config.serial, config.mounting)),
            },
        })
    }

    /// As clients see it.
    pub(super) fn name(&self) -> String {
        match self {
            Self::Simulator(_) => "simulator".to_owned(),
            Self::Replay { log, .. } => log.clone(),
            Self::Serial { port, .. } => port.clone(),
        }
    }

    /// What the board says of itself.
    pub(super) fn header(&self) -> Header {
        match self {
            Self::Simulator(simulator) => simulator.header(),
            Self::Replay { replay, .. } => replay.header().clone(),
            Self::Serial { header, .. } => (**header).clone(),
        }
    }

    /// Starts to hand out readings, `speed` times as fast as they were taken.
    pub(super) fn play(self, speed: f64) -> Result<Playing, DaemonError> {
        let (sender, messages) = mpsc::channel(WAITING_MESSAGES);
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = stop.clone();
        let thread = spawn("source", "source", move || match self {
            Self::Serial { bridge, .. } => serial::play(*bridge, &sender, &stopped),
            paced => play(paced, speed, &sender, &stopped),
        })?;
        Ok(Playing {
            messages,
            thread,
            stop,
        })
    }

    fn next(&mut self) -> Option<Result<Reading, ReplayError>> {
        match self {
            Self::Simulator(simulator) => simulator.next().map(|entry| Ok(entry.reading)),
            Self::Replay { replay, .. } => Some(replay.next()?.map(|entry| entry.reading)),
            // It has a pace of its own.
            Self::Serial { .. } => None,
        }
    }

    /// How many rows were skipped, and the first one's error.
    fn skipped(&self) -> Option<(u64, String)> {
        match self {
            Self::Simulator(_) | Self::Serial { .. } => None,
            Self::Replay { replay, .. } => {
                let skips = replay.skips();
                Some((skips.count(), skips.first()?.to_string()))
            }
        }
    }
}

fn play(mut source: Source, speed: f64, out: &mpsc::Sender<Message>, stop: &AtomicBool) {
    let mut origin = None;
    let mut told = false;
    let last_words = loop {
        let next = source.next();
        if !told && let Some((_, first)) = source.skipped() {
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
            None => break Some(Message::End),
        };
        let (begun, first_s) = *origin.get_or_insert((Instant::now(), reading.t_s));
        // Each due time is counted from the first, so that sleeping too long never adds up.
        if !sleep_until(begun, (reading.t_s - first_s) / speed, stop) {
            break None;
        }
        if out
            .blocking_send(Message::Reading(reading, Instant::now()))
            .is_err()
        {
            break None;
        }
    };
    if let Some((count, first)) = source.skipped() {
        tracing::warn!("skipped rows that cannot be used: {count} in all; the first: {first}");
    }
    if let Some(message) = last_words {
        // An error means that the daemon is about to end anyway.
        let _ = out.blocking_send(message);
    }
}

/// Sleeps until this long after `begun`; false if it was told to stop.
fn sleep_until(begun: Instant, due_s: f64, stop: &AtomicBool) -> bool {
    loop {
        if stop.load(Ordering::Relaxed) {
            return false;
        }
        let left_s = due_s - begun.elapsed().as_secs_f64();
        if left_s <= 0.0 {
            return true;
        }
        thread::sleep(Duration::from_secs_f64(left_s.min(LOOK.as_secs_f64())));
    }
}
