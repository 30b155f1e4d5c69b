//! Carries out what the pipeline wants done: publish, calibrate, keep, log.
//!
//! A [`Daemon`] lasts from start to end, and its session from one reload to the next. One task takes the events and hands
//! out the actions. Whatever may take long is on a thread of its own: the source, a calibration, the disk that
//! calibrations are kept on, and a reload.

mod batch;
mod calibrator;
mod events;
mod inactivity;
mod mounting;
mod north;
pub mod record;
mod recorder;
mod reload;
mod remedy;
mod requests;
mod ring;
mod sensor_store;
mod session;
mod source_task;
mod store_writer;
mod thread;

use std::future::Future;
use std::io;
use std::path::PathBuf;
use std::pin::pin;
use std::time::{Duration, Instant};

use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use tokio::sync::{mpsc, oneshot};
use tokio::task::{JoinHandle, JoinSet};

use crate::condition::Report;
use crate::config::Config;
use crate::config::source::Settings;
use crate::pipeline::{Action, Event};
use crate::publish::control::status::{OutcomeSummary, StatusCounts};
use crate::publish::control::{Control, ControlCall};
use crate::publish::outputs;
use crate::publish::server::{BindError, BindFault, Publisher, Server};
use crate::recording::RecordingError;
use crate::service::{Service, sockets};
use crate::store::StoreError;
use inactivity::Inactivity;
pub use recorder::RecordError;
pub use reload::NewConfig;
use reload::Reload;
use sensor_store::RunningStore;
use session::{DISK_PATIENCE, Session, SourceState};
use source_task::SourceTask;

/// How many control requests wait for the pipeline; then their clients wait.
const WAITING_REQUESTS: usize = 8;

#[derive(Debug, thiserror::Error)]
pub enum DaemonError {
    #[error("{}", Settings::UNSET)]
    NoSource,
    #[error(transparent)]
    Replay(#[from] RecordingError),
    /// There was no reading, or most of them cannot be used; and why.
    #[error("{0}")]
    Unusable(String),
    #[error(transparent)]
    Bind(#[from] BindError),
    #[error(transparent)]
    Store(StoreError),
    #[error("the last calibrations and settings are lost: {0}")]
    NotKept(String),
    #[error("the last calibrations and settings may be lost: the store has not finished writing")]
    Unanswered,
    #[error("cannot go on serving on {}: {source}", path.display())]
    Serve { path: PathBuf, source: io::Error },
    #[error(transparent)]
    Record(RecordError),
    #[error("cannot start the thread of the {name}: {source}")]
    Thread {
        name: &'static str,
        source: io::Error,
    },
}

pub enum Notice {
    Stop,
    /// Go on with this configuration; if that is impossible, log why and go on as before.
    Reload(NewConfig),
    Summary,
}

/// A daemon with its sockets, its source and its calibration.
pub struct Daemon {
    session: Box<Session>,
    reload: Reload,
    /// Sessions that are over, but not all of what they kept is on disk.
    closing: JoinSet<Result<(), DaemonError>>,
    server: Serving,
    control: Option<Serving>,
    socket: PathBuf,
    requests: mpsc::Receiver<ControlCall>,
    publisher: Publisher,
    /// UDP, TCP and the pseudo terminal.
    outputs: JoinSet<()>,
    service: Service,
    inactivity: Inactivity,
    begun: Instant,
    /// Counts since `begun`. Dropped values are those of earlier sessions: the pipeline counts its own.
    counts: StatusCounts,
    reported: Option<Report>,
    /// What the last calibration has come to.
    concluded: Option<OutcomeSummary>,
    /// Empty between events; kept for its capacity.
    actions: Vec<Action>,
}

/// A socket that is served on. Dropped, it is closed.
struct Serving {
    stop: oneshot::Sender<()>,
    task: JoinHandle<io::Result<()>>,
}

impl Serving {
    fn start<F>(serve: impl FnOnce(oneshot::Receiver<()>) -> F) -> Self
    where
        F: Future<Output = io::Result<()>> + Send + 'static,
    {
        let (stop, stopped) = oneshot::channel();
        let task = tokio::spawn(serve(stopped));
        Self { stop, task }
    }

    async fn stop(self) -> io::Result<()> {
        // An error means that it has stopped already.
        let _ = self.stop.send(());
        self.task
            .await
            .unwrap_or_else(|failed| Err(io::Error::other(failed)))
    }
}

impl Daemon {
    /// Opens the source, claims the socket, and loads the calibration kept for this sensor. Clients can
    /// connect from now on. A store or a recording that does not work is logged, and headings are served without it; a store
    /// that another daemon has is an error. Needs a runtime.
    pub fn open(config: &Config, mut service: Service) -> Result<Self, DaemonError> {
        let source = SourceTask::open(config)?;
        let server = bind(config, &mut service, &source)?;
        let control = control(config, &mut service)?;
        Self::serving_on(source, server, control, config, service)
    }

    /// Serves on these sockets; the rest as [`Self::open`].
    fn serving_on(
        source: SourceTask,
        server: Server,
        control: Option<Control>,
        config: &Config,
        service: Service,
    ) -> Result<Self, DaemonError> {
        raise_file_limit();
        let (served, wanted) = (server.socket(), &config.socket.socket);
        tracing::info!("serving on socket {}", served.display());
        if served != *wanted {
            tracing::warn!(
                "the service manager has opened that socket: socket.socket = {wanted:?} has no effect; make its \
                 unit and the configuration agree"
            );
        }
        for name in service.sockets.names() {
            tracing::warn!(
                "the service manager has handed over a socket {name:?}, which nobody here serves on"
            );
        }
        let session = Session::open(source, config.clone(), &RunningStore::default())?;
        let publisher = server.publisher();
        let (sender, requests) = mpsc::channel(WAITING_REQUESTS);
        Ok(Self {
            session,
            reload: Reload::default(),
            closing: JoinSet::new(),
            // An error means that the other end is gone, which is a reason to stop as well.
            server: Serving::start(|stopped| server.run(async { drop(stopped.await) })),
            control: control.map(|control| {
                Serving::start(|stopped| control.run(sender, async { drop(stopped.await) }))
            }),
            socket: served,
            requests,
            outputs: outputs::open(&config.udp, &config.tcp, &config.pty, &publisher),
            publisher,
            service,
            inactivity: Inactivity::new(),
            begun: Instant::now(),
            counts: StatusCounts::default(),
            reported: None,
            concluded: None,
            actions: Vec::new(),
        })
    }

    /// Serves until the source is at its end and the last calibration on it is published, or until
    /// `shutdown` is ready. Then the socket is gone, and what was to be kept is on disk.
    pub async fn run_until(self, shutdown: impl Future<Output = ()>) -> Result<(), DaemonError> {
        let mut shutdown = pin!(shutdown);
        let notice = async || {
            (&mut shutdown).await;
            Notice::Stop
        };
        self.run(notice).await
    }

    /// The same, with every kind of notice. `notice` waits for the next one; it must be cancel safe.
    pub async fn run(mut self, notice: impl AsyncFnMut() -> Notice) -> Result<(), DaemonError> {
        let ended = self.serve(notice).await;
        self.service.stopping();
        self.handle(Event::End);
        let source = self.session.state.clone();
        // Clients that still wait for an answer are told that none will come.
        drop(self.requests);
        let served = async {
            match &ended {
                // A task that has ended cannot be waited for again.
                Err(DaemonError::Serve { .. }) => Ok(()),
                _ => self.server.stop().await,
            }
        };
        let controlled = async {
            if let Some(control) = self.control
                && let Err(error) = control.stop().await
            {
                tracing::error!("the control socket has failed: {error}");
            }
        };
        let closed = async {
            // Only whoever holds the store last can wait for the disk: the session, and not a reload.
            let reloaded = self.reload.close(DISK_PATIENCE).await;
            let unanswered = !reloaded && self.session.store.is_shared();
            let closed = self.session.close().await;
            match unanswered {
                true => Err(DaemonError::Unanswered),
                false => closed,
            }
        };
        let (served, (), closed) = tokio::join!(served, controlled, closed);
        self.outputs.shutdown().await;
        let closed_before = self.closing.join_all().await;
        let served = served.map_err(|source| DaemonError::Serve {
            path: self.socket,
            source,
        });
        let used = match source {
            SourceState::Over(Some(summary)) => Err(DaemonError::Unusable(summary)),
            _ => Ok(()),
        };
        let ends = [ended, served, closed, used].into_iter();
        let mut errors = ends.chain(closed_before).filter_map(Result::err);
        // The exit status can tell only of one.
        let first = errors.next();
        errors.for_each(|error| tracing::error!("{error}"));
        first.map_or(Ok(()), Err)
    }

    /// Serves until it is told to stop, or there is nothing more to serve.
    async fn serve(&mut self, mut notice: impl AsyncFnMut() -> Notice) -> Result<(), DaemonError> {
        self.start_session()?;
        loop {
            if self.session.is_over() {
                tracing::info!("the source is at its end");
                return Ok(());
            }
            let listening = self.session.listens();
            let mut fresh = false;
            tokio::select! {
                biased;
                notice = notice() => match notice {
                    Notice::Stop => return Ok(()),
                    Notice::Summary => self.log_summary(),
                    Notice::Reload(new) => self.begin_reload(new),
                },
                ended = &mut self.server.task => {
                    let ended = ended.unwrap_or_else(|failed| Err(io::Error::other(failed)));
                    let stopped = || io::Error::other("the server has stopped");
                    return Err(DaemonError::Serve {
                        path: self.socket.clone(),
                        source: ended.err().unwrap_or_else(stopped),
                    });
                }
                () = self.reload.prepared() => {}
                outcome = self.session.calibrator.outcome() => {
                    self.handle(Event::Calibrated(Box::new(outcome)));
                    self.inactivity.restart();
                }
                Some(call) = self.requests.recv() => self.answer(call),
                events = self.session.source.next(), if listening => {
                    self.inactivity.restart();
                    fresh = self.take(events);
                }
                () = self.inactivity.fires() => {
                    self.inactivity.restart();
                    self.take_silence();
                }
            }
            if self.reload.is_prepared() {
                // A calibration under way ends first, unless it takes too long: nobody wants to repeat its turn.
                if self.reload.replaces_session() && self.session.calibrator.is_busy() {
                    if self.reload.is_overdue() && self.session.calibrator.cancel() {
                        tracing::warn!(
                            "the calibration under way takes too long, and is given up: turn the board again"
                        );
                    }
                } else {
                    self.end_reload().await?;
                    self.inactivity.restart();
                }
            }
            self.tick(fresh);
        }
    }
}

/// Each client may need two files. The soft limit is low for the sake of programs that use select(2).
fn raise_file_limit() {
    let files = getrlimit(Resource::Nofile);
    let current = files.maximum;
    if let Err(error) = setrlimit(Resource::Nofile, Rlimit { current, ..files }) {
        tracing::warn!("cannot raise the limit of open files: {error}");
    }
}

/// Claims the socket for headings.
fn bind(config: &Config, service: &mut Service, source: &SourceTask) -> Result<Server, BindError> {
    let handed = service.sockets.take(sockets::HEADING);
    let stale = Duration::from_secs_f64(config.heading.stale_s);
    Server::bind(handed, &config.socket, &config.nmea, source.device(), stale)
}

/// The control socket. Headings are served without it, but not if another daemon has it: commands for this daemon would change the other.
fn control(config: &Config, service: &mut Service) -> Result<Option<Control>, BindError> {
    let handed = service.sockets.take(sockets::CONTROL);
    match Control::bind(handed, &config.control, &config.socket.socket) {
        Ok(control) => Ok(Some(control)),
        Err(error) if matches!(error.why, BindFault::Busy(_)) => Err(error),
        Err(error) => {
            tracing::error!(
                "{error}; headings are served, but headingd status and headingd calibration will not work"
            );
            Ok(None)
        }
    }
}

#[cfg(test)]
mod tests;
