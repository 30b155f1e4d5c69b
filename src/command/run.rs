//! `headingd run`: the daemon.

use std::io::{self, IsTerminal};
use std::path::PathBuf;

use tokio::runtime::{Builder, Runtime};
use tokio::signal::unix::SignalKind;
use tracing_subscriber::EnvFilter;

use super::{Failure, load_config};
use crate::daemon::signals::Signals;
use crate::daemon::{Daemon, DaemonError, Ended};
use crate::sensor::replay::ReplayError;

/// The environment variable that takes the place of `log.filter`.
const FILTER_VARIABLE: &str = "RUST_LOG";

/// Run the daemon: read the sensors, calibrate, and serve headings
///
/// Runs in the foreground until SIGTERM or SIGINT, or until a replayed log or a simulation ends. The log goes
/// to standard error; the variable RUST_LOG overrides log.filter of the configuration.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// The configuration file; "headingd config show" prints all settings
    #[arg(long, value_name = "FILE")]
    pub config: PathBuf,
}

impl From<DaemonError> for Failure {
    fn from(error: DaemonError) -> Self {
        let status = match &error {
            DaemonError::Replay(ReplayError::BadData(_)) => Self::DATA,
            DaemonError::Replay(_) => Self::NO_INPUT,
            DaemonError::Simulator(_) => Self::CONFIG,
            DaemonError::Bind(_) | DaemonError::Listen(_) => Self::UNAVAILABLE,
            DaemonError::Serve { .. } => Self::IO,
            DaemonError::Record(error) if error.is_at_start() => Self::CANNOT_CREATE,
            DaemonError::Record(_) => Self::IO,
            DaemonError::Thread { .. } => Self::SYSTEM,
        };
        Self::new(status, error)
    }
}

/// Runs the command.
pub fn run(args: &Args) -> Result<(), Failure> {
    let config = load_config(&args.config)?;
    start_log(&config.log.filter);
    runtime()?.block_on(async {
        // Before the socket is there: whoever sees it may send a signal.
        let mut signals = catch(&[
            SignalKind::terminate(),
            SignalKind::interrupt(),
            // The terminal it was started from has gone.
            SignalKind::hangup(),
        ])?;
        let daemon = Daemon::open(&config)?;
        let told = async {
            signals.received().await;
        };
        match daemon.run(told).await? {
            Ended::Told => tracing::info!("told to stop"),
            Ended::Source => {}
        }
        Ok(())
    })
}

/// Starts to log to standard error, with this filter unless the environment has another.
pub(super) fn start_log(filter: &str) {
    let wanted = std::env::var(FILTER_VARIABLE)
        .ok()
        .filter(|text| !text.is_empty());
    let parsed = wanted.map(|text| EnvFilter::try_new(&text).map_err(|error| (text, error)));
    let (chosen, wrong) = match parsed {
        Some(Ok(chosen)) => (chosen, None),
        Some(Err(wrong)) => (EnvFilter::new(filter), Some(wrong)),
        None => (EnvFilter::new(filter), None),
    };
    tracing_subscriber::fmt()
        .with_env_filter(chosen)
        .with_writer(io::stderr)
        .with_ansi(io::stderr().is_terminal())
        .with_target(false)
        .init();
    if let Some((text, error)) = wrong {
        tracing::warn!(
            "{FILTER_VARIABLE} is {text:?}, which is no filter: {error}; using {filter:?}"
        );
    }
}

/// The daemon's runtime: one thread for everything that waits.
pub(super) fn runtime() -> Result<Runtime, Failure> {
    let built = Builder::new_current_thread().enable_all().build();
    built.map_err(|error| Failure::new(Failure::SYSTEM, format!("cannot start: {error}")))
}

/// Catches these signals.
pub(super) fn catch(kinds: &[SignalKind]) -> Result<Signals, Failure> {
    Signals::catch(kinds)
        .map_err(|error| Failure::new(Failure::SYSTEM, format!("cannot catch signals: {error}")))
}
