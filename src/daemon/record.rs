//! A recording by itself: the daemon with another place for its readings, or the source alone.

use std::future::Future;
use std::path::Path;

use super::recorder::{Recorder, Target};
use super::source::{Message, Source};
use super::{Daemon, DaemonError};
use crate::config::{Config, record};
use crate::publish::server::BindError;
use crate::service::Service;

/// Records the source into one log until it is at its end, the log cannot be written, or `shutdown` is ready.
/// Headings are served meanwhile, as by the daemon. Where there can be no socket it says so and records all
/// the same; where another daemon serves, that one has the source.
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
    let daemon = match Daemon::open(config, Service::default()) {
        Err(DaemonError::Bind(error @ BindError::Busy { .. })) => {
            return Err(DaemonError::Serving(error));
        }
        Err(DaemonError::Bind(error)) => {
            tracing::warn!("{error}; recording without a socket");
            None
        }
        opened => Some(opened?),
    };
    let source = match &daemon {
        Some(daemon) => daemon.parts.source.header(),
        None => Source::open(config)?.header(),
    };
    let (recorder, mut ending) = Recorder::start(Target::File(out.to_owned()), source)?;
    let mut ended = None;
    let stop = async {
        tokio::select! {
            () = shutdown => {}
            end = &mut ending => ended = Some(end),
        }
    };
    match daemon {
        Some(mut daemon) => {
            daemon.parts.recorder = Some(recorder);
            daemon.run_until(stop).await?;
        }
        None => alone(config, recorder, stop).await?,
    }
    let end = match ended {
        Some(end) => end,
        None => ending.await,
    };
    // An error means that the thread panicked, which has been said.
    end.unwrap_or(Ok(())).map_err(DaemonError::Record)
}

/// The source and the recorder, and nothing between them.
async fn alone(
    config: &Config,
    mut recorder: Recorder,
    shutdown: impl Future<Output = ()>,
) -> Result<(), DaemonError> {
    let mut playing = Source::open(config)?.start(config.source.pace())?;
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
