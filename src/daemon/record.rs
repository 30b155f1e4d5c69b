//! A recording by itself: the daemon with another place for its readings, a running service's, or the source alone.

use std::fmt;
use std::future::Future;
use std::path::{Path, PathBuf};

use super::listener::Listener;
use super::recorder::{Recorder, Target};
use super::source::{Message, Source};
use super::{Daemon, DaemonError};
use crate::config::source::Kind;
use crate::config::{Config, record};
use crate::publish::server::BindError;
use crate::service::Service;

/// A recording that can begin.
pub struct Recording {
    config: Config,
    origin: Origin,
}

impl Recording {
    /// Finds the readings: those of the service on the configuration's socket, or else of the configuration's source.
    /// Then headings are served meanwhile, as by the daemon; where there can be no socket it says so and records all
    /// the same. Without a source a service must be there.
    pub async fn open(config: &Config) -> Result<Self, DaemonError> {
        // One recording is enough.
        let config = Config {
            record: record::Settings::default(),
            ..config.clone()
        };
        let origin = match Daemon::open(&config, Service::default()) {
            Err(DaemonError::Bind(BindError::Busy { path, .. })) => Origin::Service {
                listener: Box::new(Listener::connect(&path).await?),
                path,
            },
            Err(DaemonError::NoSource) => {
                let path = config.socket.socket.clone();
                let connected = Listener::connect(&path).await;
                Origin::Service {
                    listener: Box::new(
                        connected.map_err(|service| DaemonError::NothingToRecord { service })?,
                    ),
                    path,
                }
            }
            // Two that read the same chips would spoil both.
            Err(DaemonError::Bind(error)) if !matches!(error, BindError::Unsure { .. }) => {
                tracing::warn!("{error}; recording without a socket");
                Origin::Source(Source::open(&config)?)
            }
            opened => Origin::Daemon(Box::new(opened?)),
        };
        Ok(Self { config, origin })
    }

    /// Records into one log until the readings are at their end, the log cannot be written, or `shutdown` is ready.
    /// How many readings are in the log then, and how it ended.
    pub async fn run(
        self,
        out: &Path,
        shutdown: impl Future<Output = ()>,
    ) -> (u64, Result<(), DaemonError>) {
        let header = match &self.origin {
            Origin::Daemon(daemon) => daemon.parts.source.header(),
            Origin::Service { listener, .. } => listener.header().clone(),
            Origin::Source(source) => source.header(),
        };
        let target = Target::File(out.to_owned());
        let (recorder, mut ending) = match Recorder::start(target, header) {
            Ok(started) => started,
            Err(error) => return (0, Err(error)),
        };
        let mut early = None;
        let stop = async {
            tokio::select! {
                () = shutdown => {}
                end = &mut ending => early = Some(end),
            }
        };
        let heard = match self.origin {
            Origin::Daemon(mut daemon) => {
                daemon.parts.recorder = Some(recorder);
                daemon.run_until(stop).await.map(|_| ())
            }
            Origin::Service { listener, .. } => from_service(*listener, recorder, stop).await,
            Origin::Source(source) => {
                alone(source, self.config.source.pace(), recorder, stop).await
            }
        };
        let end = match early {
            Some(end) => end,
            None => ending.await,
        };
        // An error means that the thread panicked, which has been said.
        let (written, end) = end.unwrap_or((0, Ok(())));
        (written, end.map_err(DaemonError::Record).and(heard))
    }
}

/// Where the readings come from, for people.
impl fmt::Display for Recording {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let source = match &self.origin {
            Origin::Service { path, .. } => {
                return write!(f, "the service at {}", path.display());
            }
            Origin::Daemon(daemon) => &daemon.parts.source,
            Origin::Source(source) => source,
        };
        match self.config.source.kind {
            Some(Kind::Simulator) => f.write_str("a simulated board"),
            Some(Kind::Replay) => write!(f, "the log {}", source.name()),
            _ => f.write_str(&source.name()),
        }
    }
}

/// Where the readings come from.
enum Origin {
    Daemon(Box<Daemon>),
    Service {
        listener: Box<Listener>,
        path: PathBuf,
    },
    Source(Source),
}

async fn from_service(
    mut listener: Listener,
    mut recorder: Recorder,
    shutdown: impl Future<Output = ()>,
) -> Result<(), DaemonError> {
    let ended = tokio::select! {
        () = shutdown => Ok(()),
        ended = listener.record(&mut recorder) => ended,
    };
    listener.conclude();
    recorder.close();
    Ok(ended?)
}

/// The source and the recorder, and nothing between them.
async fn alone(
    source: Source,
    speed: f64,
    mut recorder: Recorder,
    shutdown: impl Future<Output = ()>,
) -> Result<(), DaemonError> {
    let mut playing = source.start(speed)?;
    let listen = async {
        while let Some(message) = playing.messages.recv().await {
            match message {
                Message::Reading(reading, _) => recorder.take(reading),
                Message::Readings(readings) => {
                    for (reading, _) in readings {
                        recorder.take(reading);
                    }
                }
                // The log that is written has the times of the one that is read.
                Message::NewStretch => {}
                Message::Trouble(Some(trouble)) => tracing::warn!("{}", trouble.message),
                Message::Trouble(None) => tracing::info!("there are readings again"),
                Message::End(None) => break,
                Message::End(Some(summary)) => return Err(DaemonError::Unusable(summary)),
                Message::Broken(trouble) => {
                    tracing::error!("{}", trouble.message);
                    break;
                }
            }
        }
        Ok(())
    };
    let heard = tokio::select! {
        () = shutdown => Ok(()),
        heard = listen => heard,
    };
    playing.stop();
    super::join_for("source", playing.thread, super::SOURCE_PATIENCE);
    recorder.close();
    heard
}
