//! The source on a thread of its own: real chips and boards, or readings of a log or a simulated board, each at its time.

use std::future::pending;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use tokio::sync::mpsc;
use tokio::sync::mpsc::error::TrySendError;

use super::DaemonError;
use super::batch::{Batch, Events};
use super::thread::Thread;
use crate::condition::SourceFault;
use crate::config::Config;
use crate::config::source::Kind;
use crate::date;
use crate::publish::gpsd::Device;
use crate::reading::Reading;
use crate::recording::{Header, RecordingError};
use crate::sensor::SourceEvent;
use crate::sensor::bus::LinuxBus;
use crate::sensor::clock::{Clock, SystemClock};
use crate::sensor::i2c::{self, Chips};
use crate::sensor::replay::Replay;
use crate::sensor::serial::Bridge;
use crate::sensor::simulator::Simulator;
use crate::wall_clock;

/// How many messages wait for the pipeline; then the source waits.
const WAITING_MESSAGES: usize = 64;

/// How long to wait for a source that hangs in a read; then it is left to the end of the process.
const PATIENCE: Duration = Duration::from_millis(200);

/// If a wait is longer than wanted by this, seconds, the lost time is not made up: the machine was suspended.
const MOST_LATE_S: f64 = 1.0;

/// A source that is open, and from its start to its stop at work.
pub(super) struct SourceTask {
    /// As clients see it.
    pub(super) name: String,
    /// What the board says of itself.
    pub(super) header: Header,
    /// Speed of its line in bits a second, if it has one.
    pub(super) bps: Option<u32>,
    opened: Option<Source>,
    running: Option<RunningSource>,
    /// The bridge of a serial source that was stopped: what it knows of its device outlives a reload.
    last: Option<Box<Bridge>>,
}

enum Source {
    Simulator(Box<Simulator>),
    Replay(Box<Replay>),
    I2c(i2c::Settings),
    Serial(Box<Bridge>),
}

struct RunningSource {
    events: mpsc::Receiver<Events>,
    stop: Arc<AtomicBool>,
    /// Its outcome is a serial bridge, at its end.
    thread: Thread<Option<Box<Bridge>>>,
}

impl SourceTask {
    /// The source as `DEVICE` names it.
    pub(super) fn device(&self) -> Device {
        Device {
            path: self.name.clone(),
            activated: wall_clock::now().map(date::rfc3339),
            sensor: self.header.sensor.clone(),
            bps: self.bps,
        }
    }

    /// Opens a log, or makes a simulated board. Chips and boards that are missing now may come yet.
    pub(super) fn open(config: &Config) -> Result<Self, DaemonError> {
        let mut header = Header::default();
        let mut bps = None;
        let (name, source) = match config.source.kind.ok_or(DaemonError::NoSource)? {
            Kind::Simulator => {
                let simulator = Simulator::new(config.simulator.clone());
                header = simulator.header();
                let source = Source::Simulator(Box::new(simulator));
                ("simulator".to_owned(), source)
            }
            Kind::Replay => {
                let replay = Replay::open(&config.source.log)?;
                header = replay.header().clone();
                let name = config.source.log.display().to_string();
                (name, Source::Replay(Box::new(replay)))
            }
            Kind::I2c => {
                header.sensor = Some(config.i2c.sensor().to_owned());
                header.mountings = config.i2c.board.mountings(&config.mounting.chips());
                let name = config.i2c.path().display().to_string();
                (name, Source::I2c(config.i2c.clone()))
            }
            Kind::Serial => {
                header.sensor = Some(config.serial.chip.word().to_owned());
                header.mountings = config.mounting.chips();
                bps = Some(config.serial.baud);
                let bridge = Bridge::new(&config.serial, config.mounting.chips());
                let name = config.serial.port.display().to_string();
                (name, Source::Serial(Box::new(bridge)))
            }
        };
        Ok(Self {
            name,
            header,
            bps,
            opened: Some(source),
            running: None,
            last: None,
        })
    }

    /// Goes on with what the source before knows, which has been stopped.
    pub(super) fn take_over(&mut self, before: &mut Self) {
        if let (Some(Source::Serial(bridge)), Some(last)) = (&mut self.opened, before.last.take()) {
            bridge.take_over(*last);
        }
    }

    /// Starts to send events; logs and simulations go `speed` times as fast as real time.
    pub(super) fn start(&mut self, speed: f64) -> Result<(), DaemonError> {
        let Some(source) = self.opened.take() else {
            return Ok(());
        };
        let (sender, events) = mpsc::channel(WAITING_MESSAGES);
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = stop.clone();
        let thread = Thread::start("source", move || run(source, speed, sender, stopped))?;
        self.running = Some(RunningSource {
            events,
            stop,
            thread,
        });
        Ok(())
    }

    /// Waits for the next events. Nothing is lost when the wait is given up.
    pub(super) async fn next(&mut self) -> Events {
        let Some(running) = &mut self.running else {
            return pending().await;
        };
        let panicked = || {
            vec![SourceEvent::Broken(SourceFault {
                code: "internal",
                message: "the thread of the source panicked".to_owned(),
            })]
        };
        running.events.recv().await.unwrap_or_else(panicked)
    }

    /// One that sends what the test does, and has no thread.
    #[cfg(test)]
    pub(super) fn fed(name: &str) -> (mpsc::Sender<Events>, Self) {
        let (sender, events) = mpsc::channel(WAITING_MESSAGES);
        let running = RunningSource {
            events,
            stop: Arc::default(),
            thread: Thread::start("test", || None).unwrap(),
        };
        let task = Self {
            name: name.to_owned(),
            header: Header::default(),
            bps: None,
            opened: None,
            running: Some(running),
            last: None,
        };
        (sender, task)
    }

    /// Stops it. One that hangs is left behind.
    pub(super) async fn stop(&mut self) {
        if let Some(running) = self.running.take() {
            running.stop.store(true, Ordering::Relaxed);
            // The thread may be waiting for room.
            drop(running.events);
            self.last = running.thread.end(PATIENCE).await.flatten();
        }
    }
}

/// Sends the source's events until it is stopped, or nobody listens. Returns the bridge of a serial source, for the next session.
fn run(
    source: Source,
    speed: f64,
    sender: mpsc::Sender<Events>,
    stop: Arc<AtomicBool>,
) -> Option<Box<Bridge>> {
    let mut clock = SystemClock::new(stop.clone());
    let mut at_once = |event| send(&sender, vec![event]);
    let end = match source {
        Source::Simulator(mut simulator) => {
            let next = || simulator.next().map(|entry| Ok((entry.reading, false)));
            play(next, speed, &mut clock, &mut at_once)
        }
        Source::Replay(replay) => replay_log(*replay, speed, &mut clock, &mut at_once),
        Source::I2c(settings) => {
            let mut batch = Batch::default();
            let mut bus = LinuxBus::new(settings.bus);
            let mut in_batches = |event| match batch.take(event) {
                Some(events) => send(&sender, events),
                None => true,
            };
            Chips::new(&settings).run(&mut bus, &mut clock, &mut in_batches);
            None
        }
        Source::Serial(mut bridge) => {
            bridge.run(&stop, &mut at_once);
            return Some(bridge);
        }
    };
    if let Some(end) = end {
        // After a stop or a reload nobody takes it.
        let _ = send(&sender, vec![end]);
    }
    None
}

/// Sends events; false if nobody listens. First without blocking, which takes far more code.
fn send(out: &mpsc::Sender<Events>, events: Events) -> bool {
    match out.try_send(events) {
        Err(TrySendError::Full(events)) => out.blocking_send(events).is_ok(),
        sent => sent.is_ok(),
    }
}

/// Plays a log like [`play`], and logs which of its rows are skipped.
fn replay_log(
    mut replay: Replay,
    speed: f64,
    clock: &mut SystemClock,
    out: &mut dyn FnMut(SourceEvent) -> bool,
) -> Option<SourceEvent> {
    let mut told = false;
    let next = || {
        let entry = replay.next();
        if !told && let Some(first) = replay.skips().first() {
            tracing::warn!("skipping rows that cannot be used; the first: {first}");
            told = true;
        }
        Some(entry?.map(|entry| (entry.reading, replay.begins_stretch())))
    };
    let end = play(next, speed, clock, out);
    let skips = replay.skips();
    if let Some(summary) = skips.summary() {
        tracing::warn!("{summary}");
    }
    match end {
        Some(SourceEvent::End(_)) => Some(SourceEvent::End(replay.unusable())),
        end => end,
    }
}

/// Sends readings, each at its time, and says where a stretch begins. Returns the event that ends them; `None` if it is stopped,
/// or if nobody listens.
fn play(
    mut next: impl FnMut() -> Option<Result<(Reading, bool), RecordingError>>,
    speed: f64,
    clock: &mut SystemClock,
    out: &mut dyn FnMut(SourceEvent) -> bool,
) -> Option<SourceEvent> {
    let mut origin = None;
    loop {
        let (reading, new_stretch) = match next() {
            None => return Some(SourceEvent::End(None)),
            Some(Ok(entry)) => entry,
            Some(Err(error)) => {
                return Some(SourceEvent::Broken(SourceFault {
                    code: "log",
                    message: error.to_string(),
                }));
            }
        };
        if new_stretch {
            tracing::warn!(
                t_s = reading.t_s,
                "a new stretch of the log begins: what was known of the board's motion is over"
            );
            // What lies between the two was never recorded, and is not waited for.
            origin = None;
            if !out(SourceEvent::NewStretch) {
                return None;
            }
        }
        let now_s = clock.now_s();
        let (begun_s, first_s) = *origin.get_or_insert((now_s, reading.t_s));
        // Each due time is counted from the first, so that sleeping too long never adds up.
        let due_s = begun_s + (reading.t_s - first_s) / speed;
        if !clock.wait_until(due_s) {
            return None;
        }
        if clock.now_s() - due_s.max(now_s) > MOST_LATE_S {
            origin = None;
        }
        if !out(SourceEvent::Reading(reading, Instant::now())) {
            return None;
        }
    }
}
