//! Keeps a serial port open: opens it, loses it, and finds it again.

use std::collections::VecDeque;
use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::runtime::Builder;
use tokio::time::{sleep, timeout};
use tokio_serial::SerialStream;

use super::log_rows::LogRows;
use super::port;
use super::session::PortSession;
use super::settings::{Protocol, Settings};
use crate::condition::SourceFault;
use crate::frame::Mountings;
use crate::sensor::SourceEvent;

/// Interval at which `stop` is checked.
const LOOK: Duration = Duration::from_millis(50);
/// A bridge that has not looked at the port for this long was stopped or held up: bytes have waited.
const AWAY_S: f64 = 0.2;
/// Pauses before the port is tried again, the first, doubled each time up to the last.
const PAUSES: (Duration, Duration) = (Duration::from_millis(100), Duration::from_secs(3));
/// A device that takes nothing for this long does not listen.
const WRITE_PATIENCE: Duration = Duration::from_millis(100);

/// A device behind a serial line, whether it is there or not.
#[derive(Debug)]
pub struct Bridge {
    settings: Settings,
    board: Mountings,
    /// What is known of the device's log rows, while the port is closed.
    log_rows: LogRows,
    /// Origin of the readings' times.
    origin: Instant,
    state: BridgeState,
    waiting: VecDeque<SourceEvent>,
    /// What was said last to be wrong.
    trouble: Option<&'static str>,
    found: Protocol,
    last_s: f64,
    /// When the port was looked at last.
    looked_s: f64,
    bytes: Box<[u8; 4096]>,
}

/// A device as a bridge knows it: what its rows mean.
#[derive(Debug)]
pub struct KnownDevice {
    settings: Settings,
    log_rows: LogRows,
}

#[derive(Debug)]
enum BridgeState {
    Closed {
        retry: Instant,
        pause: Duration,
    },
    Open {
        stream: SerialStream,
        session: Box<PortSession>,
    },
}

impl Bridge {
    /// Opens nothing yet. Readings come out in the axes of chips that are mounted like `board`.
    pub fn new(settings: &Settings, board: Mountings) -> Self {
        let origin = Instant::now();
        Self {
            settings: settings.clone(),
            board,
            log_rows: LogRows::new(board),
            origin,
            state: BridgeState::Closed {
                retry: origin,
                pause: PAUSES.0,
            },
            waiting: VecDeque::new(),
            trouble: None,
            found: Protocol::Auto,
            last_s: 0.0,
            looked_s: 0.0,
            bytes: Box::new([0; 4096]),
        }
    }

    /// Goes on with what another one knows, if that had the same device.
    pub fn take_over(&mut self, known: KnownDevice) {
        if known.settings == self.settings {
            self.log_rows = known.log_rows.reopened(true).mounted(self.board);
        }
    }

    /// Sends events until it is told to stop, or `out` gives false. Returns what it knows of the device.
    pub fn run(
        mut self,
        stop: &AtomicBool,
        out: &mut dyn FnMut(SourceEvent) -> bool,
    ) -> KnownDevice {
        match Builder::new_current_thread().enable_all().build() {
            Ok(runtime) => {
                while let Some(event) = runtime.block_on(self.next(stop))
                    && out(event)
                {}
            }
            Err(error) => {
                let message = format!("cannot wait for a serial port: {error}");
                let code = "internal";
                out(SourceEvent::Broken(SourceFault { code, message }));
            }
        }
        KnownDevice {
            settings: self.settings,
            log_rows: match self.state {
                BridgeState::Open { session, .. } => session.into_log_rows(),
                BridgeState::Closed { .. } => self.log_rows,
            },
        }
    }

    /// Waits for the next event; `None` when it was told to stop. Needs a runtime.
    pub async fn next(&mut self, stop: &AtomicBool) -> Option<SourceEvent> {
        loop {
            if stop.load(Ordering::Relaxed) {
                return None;
            }
            if let Some(event) = self.waiting.pop_front() {
                return Some(event);
            }
            match &mut self.state {
                BridgeState::Closed { retry, .. } => {
                    let left = retry.saturating_duration_since(Instant::now());
                    if left.is_zero() {
                        self.open();
                    } else {
                        sleep(left.min(LOOK)).await;
                    }
                }
                BridgeState::Open { stream, .. } => {
                    let read = timeout(LOOK, stream.read(&mut self.bytes[..])).await;
                    self.take(read.ok()).await;
                }
            }
        }
    }

    fn open(&mut self) {
        match port::open(&self.settings) {
            Ok(stream) => {
                self.looked_s = self.now_s();
                let log_rows = std::mem::replace(&mut self.log_rows, LogRows::new(self.board));
                let session = PortSession::new(&self.settings, log_rows, self.looked_s);
                self.state = BridgeState::Open {
                    stream,
                    session: Box::new(session),
                };
            }
            Err(trouble) => {
                // That it is not there is no news after it was unplugged.
                if !(trouble.code == "no_device" && self.trouble == Some("unplugged")) {
                    self.complain(trouble);
                }
                if let BridgeState::Closed { retry, pause } = &mut self.state {
                    *retry = Instant::now() + *pause;
                    *pause = (*pause * 2).min(PAUSES.1);
                }
            }
        }
    }

    /// What a read came to, and what the time asks for; `None`: nothing came.
    async fn take(&mut self, read: Option<io::Result<usize>>) {
        let now_s = self.now_s();
        let BridgeState::Open { stream, session } = &mut self.state else {
            return;
        };
        let away_s = now_s - self.looked_s;
        self.looked_s = now_s;
        if away_s > AWAY_S {
            session.resume();
        }
        let mut gone = None;
        match read {
            None => {}
            Some(Ok(0)) => gone = Some("it has hung up".to_owned()),
            Some(Ok(count)) => {
                let (waiting, origin) = (&mut self.waiting, self.origin);
                let (trouble, last_s) = (&mut self.trouble, &mut self.last_s);
                session.bytes(&self.bytes[..count], now_s, |reading| {
                    let Some(mut reading) = reading else {
                        tracing::warn!(
                            "the device has sent a header: its rows before were read in other units"
                        );
                        return waiting.push_back(SourceEvent::NewStretch);
                    };
                    if reading.field_mgauss.is_some() && trouble.take().is_some() {
                        waiting.push_back(SourceEvent::Fault(None));
                    }
                    // Each port has a clock of its own.
                    reading.t_s = reading.t_s.max(*last_s);
                    *last_s = reading.t_s;
                    let taken = origin + Duration::from_secs_f64(reading.t_s);
                    waiting.push_back(SourceEvent::Reading(reading, taken));
                });
                if session.protocol() != self.found && session.protocol() != Protocol::Auto {
                    self.found = session.protocol();
                    let (port, name) = (self.settings.port.display(), self.found.name());
                    tracing::info!("the device at {port} sends {name}");
                }
            }
            Some(Err(error)) => gone = Some(error.to_string()),
        }
        let orders = session.orders(now_s);
        if let (None, Some(bytes)) = (&gone, orders.send) {
            // What was not taken in time will be sent again.
            if let Ok(Err(error)) = timeout(WRITE_PATIENCE, stream.write_all(bytes)).await {
                gone = Some(error.to_string());
            }
        }
        if let Some(refused) = orders.refused {
            tracing::warn!("{}: {refused}", self.settings.port.display());
        }
        if gone.is_some() || orders.reopen {
            if session.lost() > 0 {
                tracing::info!(
                    frames = session.lost(),
                    "frames were lost on the way from {}",
                    self.settings.port.display()
                );
            }
            let closed = BridgeState::Closed {
                retry: Instant::now() + PAUSES.0,
                pause: PAUSES.0,
            };
            if let BridgeState::Open { session, .. } = std::mem::replace(&mut self.state, closed) {
                self.log_rows = session.into_log_rows().reopened(gone.is_none());
            }
        }
        let unplugged = gone.map(|why| SourceFault {
            code: "unplugged",
            message: format!(
                "the serial port {} is gone ({why}); plug the device in again",
                self.settings.port.display()
            ),
        });
        if let Some(trouble) = unplugged.or(orders.trouble) {
            self.complain(trouble);
        }
    }

    fn complain(&mut self, trouble: SourceFault) {
        if self.trouble != Some(trouble.code) {
            self.trouble = Some(trouble.code);
            self.waiting.push_back(SourceEvent::Fault(Some(trouble)));
        }
    }

    fn now_s(&self) -> f64 {
        self.origin.elapsed().as_secs_f64()
    }
}
