//! A reload: the next session is opened on a thread of its own while the present one goes on, and takes its place when it
//! is ready.

use std::time::{Duration, Instant};

use super::north::North;
use super::sensor_store::RunningStore;
use super::session::Session;
use super::source_task::SourceTask;
use super::thread::Thread;
use super::{Daemon, DaemonError};
use crate::calibration::policy::CalibrationOrigin;
use crate::config::{Change, Config};
use crate::pipeline::Event;

/// A reload waits this long for calibrations: many times what one takes with the usual settings, on a busy board too.
const PATIENCE: Duration = Duration::from_secs(2);

/// A configuration to go on with.
pub struct NewConfig {
    /// Reads it; may block.
    pub load: Box<dyn FnOnce() -> Result<Config, String> + Send>,
    /// Called with it as soon as it is known to be usable, before it takes effect.
    pub applied: Box<dyn FnOnce(&Config) + Send>,
}

/// The reload under way, and what follows it.
#[derive(Default)]
pub(super) struct Reload {
    /// It opens the next session, which may hold the store.
    thread: Option<Thread<Result<PreparedReload, String>>>,
    /// What has come of it, and when a calibration under way is given up, so that the reload can end.
    prepared: Option<(Result<PreparedReload, String>, Instant)>,
    next: Option<NewConfig>,
}

struct PreparedReload {
    change: Change,
    /// None if the running session can stay.
    session: Option<Box<Session>>,
}

impl Reload {
    pub(super) fn is_busy(&self) -> bool {
        self.thread.is_some() || self.is_prepared()
    }

    /// Whether it is time for [`Daemon::end_reload`].
    pub(super) fn is_prepared(&self) -> bool {
        self.prepared.is_some()
    }

    /// Whether another session takes the place of the running one.
    pub(super) fn replaces_session(&self) -> bool {
        matches!(&self.prepared, Some((Ok(prepared), _)) if prepared.session.is_some())
    }

    /// Whether the reload has waited long enough for a calibration.
    pub(super) fn is_overdue(&self) -> bool {
        let deadline = self.prepared.as_ref().map(|(_, deadline)| *deadline);
        deadline.is_some_and(|deadline| Instant::now() >= deadline)
    }

    /// Waits for the next session; for ever, if none is being prepared. Nothing is lost when the wait is given up.
    pub(super) async fn prepared(&mut self) {
        let Some(thread) = &mut self.thread else {
            return std::future::pending().await;
        };
        let prepared = thread.outcome().await;
        self.thread = None;
        let panicked = || Err("the thread of the reload panicked".to_owned());
        let deadline = Instant::now() + PATIENCE;
        self.prepared = Some((prepared.unwrap_or_else(panicked), deadline));
    }

    /// Waits up to `patience` for the reload under way, whose session never starts, to release the store; returns whether it did.
    pub(super) async fn close(self, patience: Duration) -> bool {
        drop(self.prepared);
        match self.thread {
            Some(thread) => thread.end(patience).await.is_some(),
            None => true,
        }
    }
}

impl Daemon {
    /// Begins a reload. While one is under way, the newest request waits, in place of older ones.
    pub(super) fn begin_reload(&mut self, new: NewConfig) {
        if self.reload.is_busy() {
            self.reload.next = Some(new);
            return;
        }
        self.service.reloading();
        let session = &self.session;
        let (config, running) = (session.config.clone(), session.store.running());
        match Thread::start("reload", move || prepare(new, &config, &running)) {
            Ok(thread) => self.reload.thread = Some(thread),
            Err(error) => self.not_reloaded(&error.to_string()),
        }
    }

    fn not_reloaded(&mut self, why: &str) {
        tracing::error!("not reloaded, all goes on as before: {why}");
        self.service.ready();
    }

    /// Goes on with the next session, once it is prepared, or as before if it cannot be had. What stands in the way is logged.
    pub(super) async fn end_reload(&mut self) -> Result<(), DaemonError> {
        match self.reload.prepared.take().map(|(prepared, _)| prepared) {
            None => return Ok(()),
            Some(Err(message)) => self.not_reloaded(&message),
            Some(Ok(PreparedReload {
                change,
                session: None,
            })) => {
                match &change.now[..] {
                    [] if !change.at_start.is_empty() => {
                        tracing::info!("reloaded: nothing changes without a restart");
                    }
                    [] => tracing::info!("reloaded: nothing has changed"),
                    keys => {
                        tracing::info!("reloaded: {}; headings go on as before", keys.join(", "));
                    }
                }
                if change.now.iter().any(|key| is_north(key)) {
                    let mut north = North::new(&change.config);
                    north.take_over(&mut self.session.north);
                    north.start();
                    self.session.north = north;
                    self.handle(Event::Place(None));
                }
                self.session.config = change.config;
                self.service.ready();
            }
            Some(Ok(PreparedReload {
                change,
                session: Some(mut session),
            })) => {
                // Both may have the same device.
                self.session.source.stop().await;
                // The new session starts from what is kept, so what this one has learnt is kept first.
                self.handle(Event::End);
                let goes_on = session.take_over(&mut self.session);
                let started = self.session.pipeline.wanted() == Some(CalibrationOrigin::Start);
                self.counts.values_dropped = self.counts().values_dropped;
                let last = std::mem::replace(&mut self.session, session);
                if last.store.history().identity != self.history().identity {
                    self.concluded = None;
                }
                // Those that have ended are forgotten: a daemon may reload for years.
                while let Some(closed) = self.closing.try_join_next() {
                    if let Ok(Err(error)) = closed {
                        tracing::error!("{error}");
                    }
                }
                self.closing.spawn(async move {
                    let closed = last.close().await;
                    // What goes on in the new session's store is not lost.
                    if goes_on { Ok(()) } else { closed }
                });
                self.publisher.device(self.session.source.device());
                self.start_session()?;
                // The new source may be silent for seconds, and the last sign of life may be old: the watchdog begins anew.
                self.service.ping(Instant::now());
                if started {
                    self.handle(Event::Start);
                }
                tracing::info!("reloaded: {}", change.now.join(", "));
            }
        }
        if let Some(next) = self.reload.next.take() {
            self.begin_reload(next);
        }
        Ok(())
    }

    /// Starts the source, and tells clients of it.
    pub(super) fn start_session(&mut self) -> Result<(), DaemonError> {
        let session = &mut self.session;
        self.publisher.board(&session.source.header);
        session.start()?;
        let policy = session.store.history().policy;
        self.handle(Event::Policy(policy));
        Ok(())
    }
}

/// Whether this key says where true north is: that changes while the session goes on.
fn is_north(key: &str) -> bool {
    key.starts_with("true_north.")
}

/// Opens the wanted session, if it differs from the running one.
fn prepare(
    new: NewConfig,
    config: &Config,
    running: &RunningStore,
) -> Result<PreparedReload, String> {
    let wanted = (new.load)()?;
    let change = config.change(&wanted)?;
    if !change.at_start.is_empty() {
        tracing::warn!(
            "changes only with a restart: {}",
            change.at_start.join(", ")
        );
    }
    let config = &change.config;
    let needs_no_session = |key: &String| key.starts_with("log.") || is_north(key);
    let session = if change.now.iter().all(needs_no_session) {
        None
    } else {
        let opened = SourceTask::open(config)
            .and_then(|source| Session::open(source, config.clone(), running));
        Some(opened.map_err(|error| error.to_string())?)
    };
    (new.applied)(config);
    Ok(PreparedReload { change, session })
}
