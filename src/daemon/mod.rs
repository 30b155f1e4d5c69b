//! Carries out what the pipeline wants done: publish, calibrate, keep, log.
//!
//! One task takes the events and hands out the actions. Whatever may take long is on a thread of its own: the
//! source, a calibration, and the disk that calibrations are kept on.

mod calibrator;
mod chips;
mod journey;
mod keeper;
mod listener;
pub mod record;
mod recorder;
mod ring;
mod serial;
pub mod signals;
mod source;
mod time_of_day;

use std::future::Future;
use std::io;
use std::path::PathBuf;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use tokio::sync::oneshot;

use crate::check::Fault;
use crate::config::Config;
use crate::pipeline::Pipeline;
use crate::publish::gpsd::Device;
use crate::publish::server::{BindError, Server};
use crate::sensor::replay::ReplayError;
use crate::store::Identity;
use journey::Journey;
use keeper::Keeper;
pub use listener::ListenError;
pub use recorder::RecordError;
use recorder::Recorder;
use source::Source;

/// A sensor that a log does not name is kept under this name.
const UNNAMED_SENSOR: &str = "unknown";

/// A source that hangs in a read is waited for this long at the end, and then left to the end of the process.
const SOURCE_PATIENCE: Duration = Duration::from_millis(300);

/// Why the daemon cannot start or go on.
#[derive(Debug, thiserror::Error)]
pub enum DaemonError {
    /// The log to replay cannot be used.
    #[error(transparent)]
    Replay(#[from] ReplayError),
    /// The simulated board cannot be made.
    #[error("cannot simulate a board: [simulator] {}", .0.iter().map(Fault::to_string).collect::<Vec<_>>().join("; "))]
    Simulator(Vec<Fault>),
    /// The socket cannot be served on.
    #[error(transparent)]
    Bind(#[from] BindError),
    /// A service has the source that was to be recorded, and does not hand out its readings.
    #[error(transparent)]
    Listen(#[from] ListenError),
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
}

/// Why the daemon came to its end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ended {
    /// The log or the simulation is over.
    Source,
    /// It was told to.
    Told,
}

/// A daemon that has its source, its socket and its calibration, and can start.
pub struct Daemon {
    source: Source,
    server: Server,
    socket: PathBuf,
    keeper: Keeper,
    pipeline: Pipeline,
    speed: f64,
    live: bool,
    recorder: Option<Recorder>,
}

impl Daemon {
    /// Opens the source, claims the socket, and loads the calibration kept for this sensor. Clients can
    /// connect from now on. A store or a recording that does not work is logged; headings are served without it.
    /// Needs a runtime.
    pub fn open(config: &Config) -> Result<Self, DaemonError> {
        let source = Source::open(config)?;
        let device = Device {
            path: source.name(),
            activated: None,
        };
        let stale = Duration::from_secs_f64(config.heading.stale_s);
        let server = Server::bind(&config.socket, device, stale)?;
        // A log and the simulated board say themselves how their chips are mounted.
        let header = source.header();
        let identity = Identity {
            sensor: header.sensor.unwrap_or_else(|| UNNAMED_SENSOR.to_owned()),
            mag_axes: header.mountings.mag,
        };
        let live = config.source.kind.is_live();
        let speed = config.source.pace();
        tracing::info!(
            "{} from {}, {speed} times real time, on socket {}",
            identity.sensor,
            source.name(),
            config.socket.socket.display()
        );
        server.publisher().board(&source.header());
        let recorder = Recorder::ring(&config.record, source.header())?;
        let (keeper, calibration) = Keeper::open(config.store.directory(), identity)?;
        Ok(Self {
            pipeline: Pipeline::new(config.setup(header.mountings), calibration),
            source,
            server,
            socket: config.socket.socket.clone(),
            keeper,
            speed,
            live,
            recorder,
        })
    }

    /// Serves until the source is at its end and the last calibration on it is published, or until
    /// `shutdown` is ready. Then the socket is gone, and what was to be kept is on disk.
    pub async fn run(self, shutdown: impl Future<Output = ()>) -> Result<Ended, DaemonError> {
        let publisher = self.server.publisher();
        let (stop_server, server_stopped) = oneshot::channel::<()>();
        let mut serving = tokio::spawn(self.server.run(async {
            // An error means that the other end is gone, which is a reason to stop as well.
            let _ = server_stopped.await;
        }));
        let mut playing = self.source.start(self.speed)?;
        let mut journey = Journey::new(
            self.pipeline,
            publisher,
            self.keeper,
            self.recorder,
            self.speed,
            self.live,
        );
        let ended = tokio::select! {
            biased;
            () = shutdown => Some(Ended::Told),
            _ = &mut serving => None,
            () = journey.make(&mut playing.messages) => Some(Ended::Source),
        };
        playing.stop();
        // An error means that the server has stopped already.
        let _ = stop_server.send(());
        let served = match ended {
            Some(_) => serving
                .await
                .unwrap_or_else(|failed| Err(io::Error::other(failed))),
            None => Err(io::Error::other("the server has stopped")),
        };
        join_for("source", playing.thread, SOURCE_PATIENCE);
        journey.close();
        served.map_err(|source| DaemonError::Serve {
            path: self.socket,
            source,
        })?;
        Ok(ended.unwrap_or(Ended::Told))
    }
}

/// Joins a thread if it ends in time.
fn join_for(name: &str, thread: JoinHandle<()>, patience: Duration) {
    let begun = Instant::now();
    while !thread.is_finished() {
        if begun.elapsed() > patience {
            return;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    if thread.join().is_err() {
        tracing::error!("the thread of the {name} panicked");
    }
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
