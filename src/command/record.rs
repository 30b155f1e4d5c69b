//! `headingd record`: raw readings of any source into a log.

use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::thread;
use std::time::{Duration, Instant};

use tokio::sync::mpsc::{self, Sender};

use super::control::connect;
use super::headings::Headings;
use super::runtime::{ENDS, Signals, outlive_file_limits, runtime};
use super::{Failure, config_file, number, overwrite, tell};
use crate::config::Config;
use crate::config::source::Kind;
use crate::daemon::DaemonError;
use crate::daemon::record::Recording;
use crate::logging::Log;
use crate::publish::raw::{Object, Row};

/// Raw readings, and the condition, which tells why none come.
const WATCH: &str = r#"{"enable":true,"json":false,"state":true,"readings":true}"#;

/// How many readings of a service wait for the recording; then the service's wait, and it leaves some out.
const WAITING: usize = 64;

/// Record raw readings into a log, until told to stop
///
/// Where a service runs, records that service's raw readings and does not disturb it: of the configuration only the
/// socket's path is used. Otherwise reads the configured source as the daemon does, and serves headings meanwhile;
/// `record` itself neither reads nor keeps calibrations. Says with the first reading where they come from, and
/// at the end how many there were; none is a failure.
/// "headingd replay" and "headingd calibrate" read the log.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Example: headingd record --out turn.csv --duration 60")]
pub struct Args {
    /// The log to write; an existing one is replaced by the first reading. "-" is standard output
    #[arg(long, value_name = "LOG")]
    pub out: PathBuf,
    /// The configuration file [default: $HEADINGD_CONFIG, else /etc/headingd/headingd.toml, if there is one]
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Stop after so many seconds, 0.1 to 10000000
    #[arg(long, value_name = "S", value_parser = number("a number of seconds", 0.1..=1e7))]
    pub duration: Option<f64>,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    let config = config_file::load_for_client(args.config.as_deref())?;
    let replayed = config.source.kind == Some(Kind::Replay);
    let log = replayed.then_some(config.source.log.as_path());
    overwrite::refuse(&args.out, log, args.config.as_deref(), &config)?;
    let log = Log::start(&config.log.filter);
    runtime()?.block_on(log.tell_left_out(async {
        outlive_file_limits()?;
        let mut signals = Signals::catch(&ENDS)?;
        let longest = args.duration.map_or(Duration::MAX, Duration::from_secs_f64);
        let told = async {
            // An error means that the time is over.
            let _ = tokio::time::timeout(longest, signals.received()).await;
        };
        let recording = open(&config)?;
        let into = match args.out.to_str() {
            Some("-") => "standard output".into(),
            _ => args.out.to_string_lossy(),
        };
        let there = args.out.is_file();
        let replaced = if there { ", which is replaced" } else { "" };
        let from = recording.from.clone();
        let said = format!("recording {from} into {into}{replaced}");
        let begun = Instant::now();
        let (readings, ended) = recording.run(&args.out, move || tell(said), told).await;
        let summary = format!(
            "{readings} readings in {:.1} s",
            begun.elapsed().as_secs_f64()
        );
        match ended {
            Ok(()) if readings == 0 => {
                let log = if there { "stays as it was" } else { "is empty" };
                Err(Failure::new(
                    Failure::IO,
                    format!("{summary}: nothing came from {from}, and the log {log}"),
                ))
            }
            // Not even the log could be made.
            Err(error) if readings == 0 => Err(error.into()),
            ended => {
                tell(summary);
                Ok(ended?)
            }
        }
    }))
}

/// Finds the readings: those of the service on the configuration's socket, or else of the configuration's source. Needs a runtime.
fn open(config: &Config) -> Result<Recording, Failure> {
    let socket = &config.socket.socket;
    // Ask the service first: a pipe that is opened twice splits its rows between both readers.
    let no_service = match connect(socket) {
        Ok(stream) => return of_service(socket, stream),
        Err(error) => error,
    };
    Recording::open(config).map_err(|error| match error {
        DaemonError::NoSource => {
            let socket = socket.display();
            let message = format!(
                "cannot record from a service at {socket}: {no_service}; and without a service, a source is needed: {error}"
            );
            Failure::new(Failure::CONFIG, message)
        }
        error => error.into(),
    })
}

/// Asks the service that has taken this connection for its readings. One that gives none counts as unavailable.
fn of_service(socket: &Path, stream: UnixStream) -> Result<Recording, Failure> {
    let unavailable = |failure: Failure| Failure::new(Failure::UNAVAILABLE, failure);
    let mut service = Headings::greet(socket, stream, WATCH).map_err(unavailable)?;
    let header = service.board().map_err(unavailable)?;
    let (rows, received) = mpsc::channel(WAITING);
    // Ends with the command at the latest.
    thread::spawn(move || listen(service, &rows));
    Ok(Recording::of_service(socket, header, received))
}

/// Hands out readings until the service hangs up, at the end of its source or its own, or reads another board. Logs that, and faults
/// of the source.
fn listen(mut service: Headings, rows: &Sender<Row>) {
    let mut told = None;
    loop {
        match service.raw_in_time() {
            Ok(Object::Reading(row)) => {
                // The recording has ended.
                let Ok(()) = rows.blocking_send(row) else {
                    return;
                };
            }
            Ok(Object::State { cal_state, message }) => {
                let fault = (cal_state == "fault").then_some(message);
                if fault != told {
                    match &fault {
                        Some(message) => tracing::warn!("{message}"),
                        None => tracing::info!("there are readings again"),
                    }
                    told = fault;
                }
            }
            // A service whose source is silent has nothing to send.
            Ok(_) => {}
            Err(failure) => {
                tracing::warn!("the recording ends: {failure}");
                return;
            }
        }
    }
}
