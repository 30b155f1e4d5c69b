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
use crate::sensor::clock::{elapsed_s, since_boot};

/// Interval at which `stop` is checked.
const LOOK: Duration = Duration::from_millis(50);
/// If the port was not read for this long, the process was stopped or delayed, and bytes have waited.
const AWAY_S: f64 = 0.2;
/// Pauses before the port is tried again, the first, doubled each time up to the last.
const PAUSES: (Duration, Duration) = (Duration::from_millis(100), Duration::from_secs(3));
/// Write timeout.
const WRITE_PATIENCE: Duration = Duration::from_millis(100);

/// A device behind a serial line, whether it is there or not.
#[derive(Debug)]
pub struct Bridge {
    settings: Settings,
    /// What is known of the device's log rows.
    log_rows: LogRows,
    /// Origin of the readings' times, since boot.
    origin: Duration,
    /// The port, while it is open.
    port: Option<(SerialStream, PortSession)>,
    /// When to try to open it, and the pause after that.
    retry: Instant,
    pause: Duration,
    waiting: VecDeque<SourceEvent>,
    /// Code of the fault reported last; `None` once fields resume.
    trouble: Option<&'static str>,
    found: Protocol,
    last_s: f64,
    /// When the port was looked at last.
    looked_s: f64,
    bytes: Box<[u8; 4096]>,
}

impl Bridge {
    /// Opens nothing yet. Readings come out in the axes of chips that are mounted like `board`.
    pub fn new(settings: &Settings, board: Mountings) -> Self {
        Self {
            settings: settings.clone(),
            log_rows: LogRows::new(board),
            origin: since_boot(),
            port: None,
            retry: Instant::now(),
            pause: PAUSES.0,
            waiting: VecDeque::new(),
            trouble: None,
            found: Protocol::Auto,
            last_s: 0.0,
            looked_s: 0.0,
            bytes: Box::new([0; 4096]),
        }
    }

    /// Goes on with what the last one knows, if that had the same device.
    pub fn take_over(&mut self, last: Self) {
        if last.settings == self.settings {
            self.log_rows.take_over(last.log_rows);
        }
    }

    /// Sends events until it is told to stop, or `out` gives false, and closes the port.
    pub fn run(&mut self, stop: &AtomicBool, out: &mut dyn FnMut(SourceEvent) -> bool) {
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
        self.port = None;
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
            let left = self.retry.saturating_duration_since(Instant::now());
            if let Some((stream, _)) = &mut self.port {
                let read = timeout(LOOK, stream.read(&mut self.bytes[..])).await;
                let gone = self.take(read.ok());
                self.carry_out(gone).await;
            } else if left.is_zero() {
                self.open();
            } else {
                sleep(left.min(LOOK)).await;
            }
        }
    }

    fn open(&mut self) {
        match port::open(&self.settings) {
            Ok(stream) => {
                self.looked_s = self.now_s();
                let session = PortSession::new(&self.settings, self.looked_s);
                self.port = Some((stream, session));
            }
            Err(trouble) => {
                // After "unplugged" was reported, "no_device" says nothing new.
                if !(trouble.code == "no_device" && self.trouble == Some("unplugged")) {
                    self.complain(trouble);
                }
                self.retry = Instant::now() + self.pause;
                self.pause = (self.pause * 2).min(PAUSES.1);
            }
        }
    }

    /// Takes what a read came to; `None`: nothing came. Returns why the port is gone, if it is.
    fn take(&mut self, read: Option<io::Result<usize>>) -> Option<String> {
        let (now_s, now) = (self.now_s(), Instant::now());
        let (_, session) = self.port.as_mut()?;
        let away_s = now_s - self.looked_s;
        self.looked_s = now_s;
        if away_s > AWAY_S {
            session.resume(away_s);
        }
        match read {
            None => None,
            Some(Err(error)) => Some(error.to_string()),
            Some(Ok(0)) => Some("it has hung up".to_owned()),
            Some(Ok(count)) => {
                for reading in session.bytes(&self.bytes[..count], &mut self.log_rows, now_s) {
                    let Some(mut reading) = reading else {
                        tracing::warn!(
                            "the device has sent a header with other units or axes than those in which its earlier rows were read"
                        );
                        self.waiting.push_back(SourceEvent::NewStretch);
                        continue;
                    };
                    if reading.field_mgauss.is_some() && self.trouble.take().is_some() {
                        self.waiting.push_back(SourceEvent::Fault(None));
                    }
                    // Each port has its own clock, but times never decrease.
                    reading.t_s = reading.t_s.max(self.last_s);
                    self.last_s = reading.t_s;
                    let age = Duration::from_secs_f64((now_s - reading.t_s).max(0.0));
                    let taken = now.checked_sub(age).unwrap_or(now);
                    self.waiting.push_back(SourceEvent::Reading(reading, taken));
                }
                let protocol = session.decoder.protocol;
                if protocol != self.found && session.good > 0 {
                    self.found = protocol;
                    let (port, name) = (self.settings.port.display(), self.found.name());
                    tracing::info!("the device at {port} sends {name}");
                    if self.log_rows.lacks_header() {
                        tracing::warn!(
                            "no header has come from {port}: its rows count in milligauss, rad/s and m/s², by the axes of [mounting]. If its header says \
                             otherwise, headings are wrong: reset the device, and let it repeat the header"
                        );
                    }
                }
                None
            }
        }
    }

    /// Carries out what is due, and closes a port that is gone.
    async fn carry_out(&mut self, mut gone: Option<String>) {
        let Some((stream, session)) = &mut self.port else {
            return;
        };
        let due = session.due(self.looked_s);
        if let (None, Some(bytes)) = (&gone, due.send) {
            // What was not taken in time will be sent again.
            if let Ok(Err(error)) = timeout(WRITE_PATIENCE, stream.write_all(bytes)).await {
                gone = Some(error.to_string());
            }
        }
        if let Some(refused) = due.refused {
            tracing::warn!("{}: {refused}", self.settings.port.display());
        }
        if gone.is_some() || due.reopen {
            if session.frames.lost() > 0 {
                tracing::info!(
                    frames = session.frames.lost(),
                    "frames were lost on the way from {}",
                    self.settings.port.display()
                );
            }
            self.log_rows.reopen(gone.is_none());
            self.port = None;
            self.pause = PAUSES.0;
            self.retry = Instant::now() + self.pause;
        }
        let unplugged = gone.map(|why| SourceFault {
            code: "unplugged",
            message: format!(
                "the serial port {} is gone ({why}); plug the device in again",
                self.settings.port.display()
            ),
        });
        if let Some(trouble) = unplugged.or(due.trouble) {
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
        elapsed_s(self.origin)
    }
}
