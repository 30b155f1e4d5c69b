//! Recording into one log: the readings of a running service, of a daemon of its own, or of the source alone.

use std::fmt;
use std::future::Future;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::Duration;

use tokio::time::timeout;

use super::recorder::{RecordError, Recorder};
use super::service_client::ServiceClient;
use super::source_task::SourceTask;
use super::{Daemon, DaemonError};
use crate::config::source::Kind;
use crate::config::{Config, record};
use crate::publish::server::BindFault;
use crate::sensor::SourceEvent;
use crate::service::Service;

/// At the end a disk that hangs is waited for this long.
const PATIENCE: Duration = Duration::from_secs(1);

pub struct Recording {
    config: Config,
    origin: ReadingsFrom,
}

impl Recording {
    /// Finds the readings: those of the service on the configuration's socket, or else of the configuration's source.
    /// Then headings are served meanwhile, as by the daemon; where there can be no socket it says so and records all
    /// the same. Without a source a service must be there.
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
                let origin = ReadingsFrom::Service(Box::new(client));
                return Ok(Self { config, origin });
            }
            Err(service) if service.connected => return Err(service.into()),
            Err(service) => service,
        };
        let source = match SourceTask::open(&config) {
            Err(DaemonError::NoSource) => return Err(DaemonError::NothingToRecord { service }),
            opened => opened?,
        };
        let mut sockets = Service::default();
        let origin = match super::bind(&config, &mut sockets, &source) {
            Err(error) if matches!(error.why, BindFault::Busy(_)) => return Err(service.into()),
            // A service may be there: two readers of the same chips would disturb each other.
            Err(error) if matches!(error.why, BindFault::Unsure(_)) => return Err(error.into()),
            Err(error) => {
                tracing::warn!("{error}; recording without a socket");
                ReadingsFrom::Source(Box::new(source))
            }
            Ok(server) => {
                let daemon = Daemon::serving_on(source, server, &config, sockets)?;
                ReadingsFrom::Daemon(Box::new(daemon))
            }
        };
        Ok(Self { config, origin })
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
            ReadingsFrom::Source(source) => source.header.clone(),
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
            ReadingsFrom::Source(source) => {
                from_source(*source, self.config.source.pace(), recorder, stop).await
            }
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

/// Where the readings come from, for people.
impl fmt::Display for Recording {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let source = match &self.origin {
            ReadingsFrom::Service(client) => {
                return write!(f, "the service at {}", client.socket.display());
            }
            ReadingsFrom::Daemon(daemon) => &daemon.session.source,
            ReadingsFrom::Source(source) => source,
        };
        match self.config.source.kind {
            Some(Kind::Simulator) => f.write_str("a simulated board"),
            Some(Kind::Replay) => write!(f, "the log {}", source.name),
            _ => f.write_str(&source.name),
        }
    }
}

enum ReadingsFrom {
    Daemon(Box<Daemon>),
    Service(Box<ServiceClient>),
    Source(Box<SourceTask>),
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

/// Records straight from the source, without serving headings.
async fn from_source(
    mut source: SourceTask,
    speed: f64,
    mut recorder: Recorder,
    shutdown: impl Future<Output = ()>,
) -> Result<(), DaemonError> {
    source.start(speed)?;
    let listen = async {
        loop {
            for event in source.next().await {
                match event {
                    SourceEvent::Reading(reading, _) => recorder.take(reading),
                    // The log that is written has the times of the one that is read.
                    SourceEvent::NewStretch => {}
                    SourceEvent::Fault(Some(fault)) => tracing::warn!("{}", fault.message),
                    SourceEvent::Fault(None) => tracing::info!("there are readings again"),
                    SourceEvent::End(None) => return Ok(()),
                    SourceEvent::End(Some(summary)) => return Err(DaemonError::Unusable(summary)),
                    SourceEvent::Broken(fault) => {
                        tracing::error!("{}", fault.message);
                        return Ok(());
                    }
                }
            }
        }
    };
    let heard = tokio::select! {
        () = shutdown => Ok(()),
        heard = listen => heard,
    };
    source.stop().await;
    recorder.close(PATIENCE).await;
    heard
}
