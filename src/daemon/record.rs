//! A recording by itself: the daemon with another place for its readings, a running service's, or the source alone.

use std::future::Future;
use std::path::Path;

use super::listener::Listener;
use super::recorder::{Recorder, Target};
use super::source::{Message, Source};
use super::{Daemon, DaemonError};
use crate::config::{Config, record};
use crate::publish::server::BindError;
use crate::service::Service;

/// Records the source into one log until it is at its end, the log cannot be written, or `shutdown` is ready.
/// Headings are served meanwhile, as by the daemon. Where there can be no socket it says so and records all
/// the same; where another daemon serves, that one has the source, and hands its readings on.
pub async fn record(
    config: &Config,
    out: &Path,
    shutdown: impl Future<Output = ()>,
) -> Result<(), DaemonError> {
    // One recording is enough.
    let config = &Config {
        record: record::Settings::default(),
        ..config.clone()
    };
    let origin = match Daemon::open(config, Service::default()) {
        Err(DaemonError::Bind(BindError::Busy { path })) => {
            let listener = Listener::connect(&path).await?;
            tracing::info!(
                "recording the readings of the service at {}",
                path.display()
            );
            Origin::Service(Box::new(listener))
        }
        // Two that read the same chips would spoil both.
        Err(DaemonError::Bind(error)) if !matches!(error, BindError::Unsure { .. }) => {
            tracing::warn!("{error}; recording without a socket");
            Origin::Source(Source::open(config)?)
        }
        opened => Origin::Daemon(Box::new(opened?)),
    };
    let header = match &origin {
        Origin::Daemon(daemon) => daemon.parts.source.header(),
        Origin::Service(listener) => listener.header().clone(),
        Origin::Source(source) => source.header(),
    };
    let (recorder, mut ending) = Recorder::start(Target::File(out.to_owned()), header)?;
    let mut ended = None;
    let stop = async {
        tokio::select! {
            () = shutdown => {}
            end = &mut ending => ended = Some(end),
        }
    };
    match origin {
        Origin::Daemon(mut daemon) => {
            daemon.parts.recorder = Some(recorder);
            daemon.run_until(stop).await?;
        }
        Origin::Service(listener) => from_service(*listener, recorder, stop).await?,
        Origin::Source(source) => alone(source, config.source.pace(), recorder, stop).await?,
    }
    let end = match ended {
        Some(end) => end,
        None => ending.await,
    };
    // An error means that the thread panicked, which has been said.
    end.unwrap_or(Ok(())).map_err(DaemonError::Record)
}

/// Where the readings come from.
enum Origin {
    Daemon(Box<Daemon>),
    Service(Box<Listener>),
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
                Message::Trouble(Some(trouble)) => tracing::warn!("{}", trouble.message),
                Message::Trouble(None) => tracing::info!("there are readings again"),
                Message::End => break,
                Message::Broken(trouble) => {
                    tracing::error!("{}", trouble.message);
                    break;
                }
            }
        }
    };
    tokio::select! {
        () = shutdown => {}
        () = listen => {}
    }
    playing.stop();
    super::join_for("source", playing.thread, super::SOURCE_PATIENCE);
    recorder.close();
    Ok(())
}
