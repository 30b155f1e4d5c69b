//! Carries out what the pipeline wants done: publish, calibrate, keep, log.
//!
//! One task takes the events and hands out the actions. Whatever may take long is on a thread of its own: the
//! source, a calibration, and the disk that calibrations are kept on.

mod calibrator;
mod chips;
mod course;
mod journey;
mod keeper;
mod listener;
pub mod open_files;
pub mod record;
mod recorder;
mod ring;
mod serial;
pub mod signals;
mod silence;
mod source;
mod tally;
pub mod time_of_day;

use std::future::Future;
use std::io;
use std::path::PathBuf;
use std::pin::pin;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use tokio::sync::{mpsc, oneshot};

use crate::check::Fault;
use crate::config::Config;
use crate::config::source::Settings;
use crate::publish::control::Control;
use crate::publish::gpsd::Device;
use crate::publish::outputs::Outputs;
use crate::publish::server::{BindError, Server};
use crate::sensor::replay::ReplayError;
use crate::service::{Service, sockets};
use crate::store::StoreError;
use course::{Course, Parts};
use journey::Lasting;
pub use listener::ListenError;
use open_files::Shortage;
pub use recorder::RecordError;
use source::Source;

/// A sensor that a log does not name is kept under this name.
const UNNAMED_SENSOR: &str = "unknown";

/// How many orders wait for the pipeline; then whoever asks waits.
const WAITING_ORDERS: usize = 8;

/// A source that hangs in a read is waited for this long at the end, and then left to the end of the process.
const SOURCE_PATIENCE: Duration = Duration::from_millis(200);

/// What is still to be written is waited for this long at the end: a stop takes less than a second.
const DISK_PATIENCE: Duration = Duration::from_millis(600);

/// Why the daemon cannot start or go on.
#[derive(Debug, thiserror::Error)]
pub enum DaemonError {
    /// Nobody has said where the readings come from.
    #[error("{}", Settings::UNSET)]
    NoSource,
    /// There is neither a service to listen to nor a source.
    #[error(
        "{service}; and without a service, a source is needed: {}",
        Settings::UNSET
    )]
    NothingToRecord {
        /// Why there is no service.
        service: ListenError,
    },
    /// The log to replay cannot be used.
    #[error(transparent)]
    Replay(#[from] ReplayError),
    /// Most rows of the log were skipped.
    #[error("most of the log cannot be used: {0}")]
    Unusable(String),
    /// The simulated board cannot be made.
    #[error("cannot simulate a board: [simulator] {}", .0.iter().map(Fault::to_string).collect::<Vec<_>>().join("; "))]
    Simulator(Vec<Fault>),
    /// The socket cannot be served on.
    #[error(transparent)]
    Bind(#[from] BindError),
    /// A service has the source that was to be recorded, and does not hand out its readings.
    #[error(transparent)]
    Listen(#[from] ListenError),
    /// Another daemon has the store.
    #[error(transparent)]
    Store(StoreError),
    /// The socket was claimed, but then could not be served on.
    #[error("cannot go on serving on {}: {source}", path.display())]
    Serve {
        /// The socket.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The readings cannot be recorded any more.
    #[error(transparent)]
    Record(RecordError),
    /// The system gives no thread.
    #[error("cannot start the thread of the {task}: {source}")]
    Thread {
        /// What the thread was for.
        task: &'static str,
        /// What the system said.
        source: io::Error,
    },
    /// The system gives no timer.
    #[error("cannot set up the timer that notices silence: {0}")]
    Timer(io::Error),
}

/// Why the daemon came to its end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ended {
    /// The log or the simulation is over.
    Source,
    /// It was told to.
    Told,
}

/// What a running daemon is told.
#[derive(Debug)]
pub enum Notice {
    /// To end.
    Stop,
    /// To go on with this configuration, or to say why it cannot be had and to go on as before.
    Reload(Result<Box<Config>, String>),
    /// To log how it is.
    Summary,
}

/// A daemon that has its source, its socket and its calibration, and can start.
pub struct Daemon {
    config: Config,
    server: Server,
    control: Option<Control>,
    outputs: Outputs,
    service: Service,
    parts: Parts,
}

impl Daemon {
    /// Opens the source, claims the socket, and loads the calibration kept for this sensor. Clients can
    /// connect from now on. A store or a recording that does not work is logged; headings are served without it.
    /// Needs a runtime.
    pub fn open(config: &Config, mut service: Service) -> Result<Self, DaemonError> {
        let source = Source::open(config)?;
        let device = Device {
            path: source.name(),
            activated: time_of_day::rfc3339(Instant::now()),
            sensor: source.header().sensor,
            bps: source.bps(),
        };
        let stale = Duration::from_secs_f64(config.heading.stale_s);
        let mut settings = config.socket.clone();
        // What clients have no files for is kept for the control socket, a reload and the disk.
        if let Some(short) = Shortage::of(settings.max_clients, open_files::limit()) {
            tracing::warn!("{short}");
            settings.max_clients = short.clients;
        }
        let server = match service.sockets.take(sockets::HEADING) {
            Some(listener) => Server::inherit(listener, &settings, &config.nmea, device, stale)?,
            None => Server::bind(&settings, &config.nmea, device, stale)?,
        };
        let (served, wanted) = (server.socket(), &config.socket.socket);
        tracing::info!("serving on socket {}", served.display());
        if served != *wanted {
            tracing::warn!(
                "the service manager has opened that socket: socket.socket = {wanted:?} has no effect; make its \
                 unit and the configuration agree"
            );
        }
        let control = control(config, &mut service);
        for name in service.sockets.names() {
            tracing::warn!(
                "the service manager has handed over a socket {name:?}, which nobody here serves on"
            );
        }
        let parts = Parts::open(source, config, None)?;
        let publisher = server.publisher();
        Ok(Self {
            outputs: Outputs::open(&config.udp, &config.tcp, &config.pty, &publisher),
            parts,
            config: config.clone(),
            server,
            control,
            service,
        })
    }

    /// Serves until the source is at its end and the last calibration on it is published, or until
    /// `shutdown` is ready. Then the socket is gone, and what was to be kept is on disk.
    pub async fn run_until(self, shutdown: impl Future<Output = ()>) -> Result<Ended, DaemonError> {
        let mut shutdown = pin!(shutdown);
        let notice = async || {
            (&mut shutdown).await;
            Notice::Stop
        };
        self.run(notice).await
    }

    /// The same, with other notices than the last one too. `notice` waits for the next; nothing may be lost when
    /// the wait is given up.
    pub async fn run(self, mut notice: impl AsyncFnMut() -> Notice) -> Result<Ended, DaemonError> {
        let socket = self.config.socket.socket.clone();
        let publisher = self.server.publisher();
        let (stop_server, server_stopped) = oneshot::channel::<()>();
        let mut serving = tokio::spawn(self.server.run(async {
            // An error means that the other end is gone, which is a reason to stop as well.
            let _ = server_stopped.await;
        }));
        let (sender, mut orders) = mpsc::channel(WAITING_ORDERS);
        let (stop_control, control_stopped) = oneshot::channel::<()>();
        let controlling = self.control.map(|control| {
            tokio::spawn(control.run(sender, async {
                let _ = control_stopped.await;
            }))
        });
        let lasting = Lasting::new(publisher, self.service).map_err(DaemonError::Timer)?;
        let mut course = Course::start(self.parts, self.config, lasting)?;
        let ended = loop {
            let notice = tokio::select! {
                biased;
                notice = notice() => notice,
                _ = &mut serving => break None,
                () = course.journey.make(&mut course.playing.messages, &mut orders) => break Some(Ended::Source),
            };
            match notice {
                Notice::Stop => break Some(Ended::Told),
                Notice::Summary => course.journey.log_summary(),
                Notice::Reload(wanted) => course = course.reload(wanted)?,
            }
        };
        course.journey.lasting.service.stopping();
        course.playing.stop();
        // An error means that the server has stopped already.
        let _ = stop_server.send(());
        // Whoever still waits for an answer is told that there is none to come.
        drop(orders);
        let _ = stop_control.send(());
        let served = match ended {
            Some(_) => serving
                .await
                .unwrap_or_else(|failed| Err(io::Error::other(failed))),
            None => Err(io::Error::other("the server has stopped")),
        };
        if let Some(controlling) = controlling {
            let ended = controlling.await.map_err(io::Error::other);
            if let Err(error) = ended.and_then(|ended| ended) {
                tracing::error!("the control socket has failed: {error}");
            }
        }
        let unusable = course.journey.take_unusable();
        self.outputs.close().await;
        course.end();
        served.map_err(|source| DaemonError::Serve {
            path: socket,
            source,
        })?;
        match unusable {
            Some(summary) => Err(DaemonError::Unusable(summary)),
            None => Ok(ended.unwrap_or(Ended::Told)),
        }
    }
}

/// The control socket. Headings are served without it.
fn control(config: &Config, service: &mut Service) -> Option<Control> {
    let bound = match service.sockets.take(sockets::CONTROL) {
        Some(listener) => Control::inherit(listener, &config.control, &config.socket.socket),
        None => Control::bind(&config.control, &config.socket.socket),
    };
    bound
        .inspect_err(|error| {
            tracing::error!(
                "{error}; headings are served, but headingd status and headingd calibration will not work"
            );
        })
        .ok()
}

/// Joins a thread if it ends in time, and says whether it has ended.
fn join_for(name: &str, thread: JoinHandle<()>, patience: Duration) -> bool {
    let begun = Instant::now();
    while !thread.is_finished() {
        if begun.elapsed() > patience {
            tracing::warn!("the thread of the {name} hangs; ending without it");
            return false;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    if thread.join().is_err() {
        tracing::error!("the thread of the {name} panicked");
    }
    true
}

/// A thread with a name; `task` completes "cannot start the thread of the …".
fn spawn(
    name: &'static str,
    task: &'static str,
    work: impl FnOnce() + Send + 'static,
) -> Result<JoinHandle<()>, DaemonError> {
    std::thread::Builder::new()
        .name(name.to_owned())
        .spawn(work)
        .map_err(|source| DaemonError::Thread { task, source })
}
