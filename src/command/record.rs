//! `headingd record`: raw readings of any source into a log.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use super::runtime::{ENDS, Signals, outlive_file_limits, runtime};
use super::{Failure, config_file, number, overwrite, tell};
use crate::config::source::Kind;
use crate::daemon::record::Recording;
use crate::logging::Log;

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
        let recording = Recording::open(&config).await?;
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
