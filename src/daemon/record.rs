//! Recording into one log: the readings of a running service, or of a daemon of its own.

use std::future::Future;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::Duration;

use tempfile::TempDir;
use tokio::time::timeout;

use super::recorder::{RecordError, Recorder};
use super::service_client::ServiceClient;
use super::source_task::SourceTask;
use super::{Daemon, DaemonError};
use crate::config::source::Kind;
use crate::config::{Config, record};
use crate::publish::server::BindFault;
use crate::service::Service;

/// At the end a disk that hangs is waited for this long.
const PATIENCE: Duration = Duration::from_secs(1);

pub struct Recording {
    /// Where the readings come from, for people.
    pub from: String,
    origin: ReadingsFrom,
    /// Holds the socket if it cannot be where it is configured. Dropping it removes the folder.
    _folder: Option<TempDir>,
}

impl Recording {
    /// Finds the readings: those of the service on the configuration's socket, or else of the configuration's source. In the second case it
    /// serves headings as the daemon does; if the configured socket cannot be bound, on one in a temporary folder. Without a source a
    /// service must be there.
    pub async fn open(config: &Config) -> Result<Self, DaemonError> {
        // One recording is enough. It needs no calibrations, and the store belongs to the service.
        let mut config = Config {
            record: record::Settings::default(),
            ..config.clone()
        };
        config.store.directory = PathBuf::new();
        // Ask the service first: a pipe that is opened twice splits its rows between both readers.
        let service = match ServiceClient::connect(&config.socket.socket).await {
            Ok(client) => {
                return Ok(Self {
                    from: format!("the service at {}", config.socket.socket.display()),
                    origin: ReadingsFrom::Service(Box::new(client)),
                    _folder: None,
                });
            }
            Err(service) if service.connected => return Err(service.into()),
            Err(service) => service,
        };
        let source = match SourceTask::open(&config) {
            Err(DaemonError::NoSource) => return Err(DaemonError::NothingToRecord { service }),
            opened => opened?,
        };
        let mut sockets = Service::default();
        let mut folder = None;
        let server = match super::bind(&config, &mut sockets, &source) {
            // A service is there, or may be: two readers of the same chips would disturb each other.
            Err(error) if matches!(error.why, BindFault::Busy(_) | BindFault::Unsure(_)) => {
                return Err(error.into());
            }
            Err(error) => {
                let Ok(made) = tempfile::Builder::new().prefix("headingd-").tempdir() else {
                    return Err(error.into());
                };
                tracing::warn!("{error}; recording with a socket in a temporary folder");
                config.socket.socket = made.path().join("heading.sock");
                config.control.socket = PathBuf::new();
                folder = Some(made);
                super::bind(&config, &mut sockets, &source)?
            }
            Ok(server) => server,
        };
        // A recording needs no control socket, and another daemon may have it.
        let control = super::control(&config, &mut sockets).unwrap_or_else(|error| {
            tracing::warn!("recording without a control socket: {error}");
            None
        });
        let from = match config.source.kind {
            Some(Kind::Simulator) => "a simulated board".to_owned(),
            Some(Kind::Replay) => format!("the log {}", source.name),
            _ => source.name.clone(),
        };
        let daemon = Daemon::serving_on(source, server, control, &config, sockets)?;
        Ok(Self {
            from,
            origin: ReadingsFrom::Daemon(Box::new(daemon)),
            _folder: folder,
        })
    }

    /// Records into one log until the readings are at their end, the log cannot be written, or `shutdown` is ready; calls
    /// `begun` with the first reading. How many readings are in the log then, and how it ended.
    pub async fn run(
        self,
        out: &Path,
        begun: impl FnOnce() + Send + 'static,
        shutdown: impl Future<Output = ()>,
    ) -> (u64, Result<(), DaemonError>) {
        let header = match &self.origin {
            ReadingsFrom::Daemon(daemon) => daemon.session.source.header.clone(),
            ReadingsFrom::Service(client) => client.header.clone(),
        };
        let (mut recorder, mut ending) = match Recorder::file(out, header) {
            Ok(started) => started,
            Err(error) => return (0, Err(error)),
        };
        recorder.begun = Some(Box::new(begun));
        let mut early = None;
        let stop = async {
            tokio::select! {
                () = shutdown => {}
                end = &mut ending => early = Some(end),
            }
        };
        let heard = match self.origin {
            ReadingsFrom::Daemon(mut daemon) => {
                daemon.session.recorder = Some(recorder);
                daemon.run_until(stop).await
            }
            ReadingsFrom::Service(client) => from_service(*client, recorder, stop).await,
        };
        let end = match early {
            Some(end) => end,
            None => timeout(PATIENCE, ending).await.unwrap_or_else(|_| {
                let hangs = RecordError::of(false, out)(ErrorKind::TimedOut.into());
                Ok((0, Err(hangs)))
            }),
        };
        // An error means that the thread panicked, which has been logged.
        let (written, end) = end.unwrap_or((0, Ok(())));
        (written, end.map_err(DaemonError::Record).and(heard))
    }
}

enum ReadingsFrom {
    Daemon(Box<Daemon>),
    Service(Box<ServiceClient>),
}

async fn from_service(
    mut client: ServiceClient,
    mut recorder: Recorder,
    shutdown: impl Future<Output = ()>,
) -> Result<(), DaemonError> {
    let ended = tokio::select! {
        () = shutdown => Ok(()),
        ended = client.record(&mut recorder) => ended,
    };
    client.conclude();
    recorder.close(PATIENCE).await;
    Ok(ended?)
}
