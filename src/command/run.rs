//! `headingd run`: the daemon.

use std::io::{self, IsTerminal};
use std::path::{Path, PathBuf};

use tokio::signal::unix::SignalKind;

use super::failure::log_status;
use super::runtime::{ENDS, Signals, outlive_file_limits, runtime};
use super::{Failure, config_file};
use crate::config::Config;
use crate::daemon::{Daemon, DaemonError, NewConfig, Notice};
use crate::logging::Log;
use crate::service::Service;

/// Run the daemon: read the sensors, calibrate, and serve headings
///
/// Runs in the foreground until SIGTERM or SIGINT, or until a replayed log or a simulation ends. The log goes
/// to standard error, or under systemd to the journal; the variable RUST_LOG overrides log.filter of the configuration.
///
/// SIGHUP reads the configuration again. Clients stay connected, and the log names what changes only with a restart.
/// A file with a fault changes nothing. SIGUSR1 logs a summary.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// The configuration file; "headingd config show" prints all settings [default: $HEADINGD_CONFIG, else /etc/headingd/headingd.toml]
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
}

impl From<DaemonError> for Failure {
    fn from(error: DaemonError) -> Self {
        let status = match &error {
            DaemonError::Replay(error) => log_status(error),
            DaemonError::Unusable(_) => Self::DATA,
            DaemonError::NoSource => Self::CONFIG,
            DaemonError::Bind(_) | DaemonError::Store(_) => Self::UNAVAILABLE,
            DaemonError::Serve { .. } | DaemonError::NotKept(_) => Self::IO,
            DaemonError::Record(error) if error.at_start => Self::CANNOT_CREATE,
            DaemonError::Record(_) | DaemonError::Unanswered => Self::IO,
            DaemonError::Thread { .. } => Self::SYSTEM,
        };
        Self::new(status, error)
    }
}

pub fn run(args: &Args) -> Result<(), Failure> {
    serve(args).inspect_err(|failure| Service::failed(&failure.message))
}

fn serve(args: &Args) -> Result<(), Failure> {
    let path = config_file::path(args.config.as_deref());
    let config = config_file::read(&path)?;
    let log = Log::start(&config.log.filter);
    tell_retired(&path, &config);
    // Before there is a thread.
    let service = Service::from_env();
    let on_terminal = io::stderr().is_terminal();
    runtime()?.block_on(async {
        outlive_file_limits()?;
        // Before the socket is there: whoever sees it may send a signal.
        let mut signals = Signals::catch(&[&ENDS[..], &[SignalKind::user_defined1()]].concat())?;
        let daemon = Daemon::open(&config, service).map_err(|error| match error {
            DaemonError::NoSource => {
                Failure::new(Failure::CONFIG, format!("{}: {error}", path.display()))
            }
            error => error.into(),
        })?;
        let order = async || {
            let kind = signals.received().await;
            // A hangup reloads, unless the terminal from which the daemon was started has gone.
            let terminal_gone = on_terminal && !io::stderr().is_terminal();
            if kind == SignalKind::user_defined1() {
                Notice::Summary
            } else if kind != SignalKind::hangup() || terminal_gone {
                tracing::info!("told to stop");
                Notice::Stop
            } else {
                let (path, log) = (path.clone(), log.clone());
                Notice::Reload(NewConfig {
                    load: Box::new(move || {
                        let config = config_file::read(&path).map_err(|failure| failure.message)?;
                        tell_retired(&path, &config);
                        Ok(config)
                    }),
                    applied: Box::new(move |config| log.set(&config.log.filter)),
                })
            }
        };
        Ok(log.tell_left_out(daemon.run(order)).await?)
    })
}

/// Warns of keys that no longer exist: they have no effect.
fn tell_retired(path: &Path, config: &Config) {
    for sentence in &config.retired {
        tracing::warn!("{}: {sentence}", path.display());
    }
}
