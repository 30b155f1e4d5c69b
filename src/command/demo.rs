//! `headingd demo`: the daemon on a simulated board, watched by a client of its own.

mod timeline;

use std::path::{Path, PathBuf};

use serde_json::Value;
use tokio::io::{AsyncBufReadExt, AsyncWriteExt, BufReader};
use tokio::net::UnixStream;
use tokio::sync::Notify;

use super::runtime::{ENDS, Signals, runtime};
use super::{Failure, OrFail, number, print};
use crate::config::{Config, source};
use crate::daemon::Daemon;
use crate::logging::Log;
use crate::publish::server;
use crate::sensor::simulator::{self, Scenario, Simulator};
use crate::service::Service;
use crate::store;
use timeline::{Timeline, opening};

/// The client asks for everything.
const WATCH: &[u8] =
    b"?WATCH={\"enable\":true,\"json\":true,\"state\":true,\"calibration\":true};\n";

/// In accelerated time headings come in bursts: no client may lose any.
const BACKLOG: usize = 4096;

/// Show the daemon calibrate a simulated board
///
/// Runs the real daemon, with its socket, on a simulated HMC5843 with hard iron, a gyro and an
/// accelerometer. The board rests, makes two turns, and then moves about. The demo shows what a client reads
/// from the socket, beside the simulator's truth. The exit status is 0 if a calibration was accepted and the
/// headings after it are right within 1 degree RMS.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// How fast time goes, 0.1 to 1000 times real time
    #[arg(long, value_name = "N", default_value_t = 1.0, value_parser = number("a number", 0.1..=1000.0))]
    pub speed: f64,

    /// Number that fixes all noise
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,

    /// Where to put the socket; by default into a temporary folder
    #[arg(long, value_name = "PATH")]
    pub socket: Option<PathBuf>,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    Log::start("error");
    runtime()?.block_on(demo(args))
}

async fn demo(args: &Args) -> Result<(), Failure> {
    // Before there is anything that would be left behind.
    let mut signals = Signals::catch(&ENDS)?;
    // The folder is removed when this function ends.
    let (socket, _folder) = match &args.socket {
        Some(path) => (
            std::path::absolute(path).unwrap_or_else(|_| path.clone()),
            None,
        ),
        None => {
            let made = tempfile::Builder::new().prefix("headingd-").tempdir();
            let what = "cannot make a folder for the socket (choose a place with --socket)";
            let folder = made.or_fail(Failure::CANNOT_CREATE, what)?;
            (folder.path().join("heading.sock"), Some(folder))
        }
    };
    let config = config(args, &socket);
    let simulator = Simulator::new(config.simulator.clone());
    let opening = opening(&config, simulator.duration_s());
    let mut timeline = Timeline::new(&config, simulator);

    let daemon = Daemon::open(&config, Service::default())?;
    let lost = format!("cannot read from socket {}", socket.display());
    let client = UnixStream::connect(&socket).await;
    let client = client.or_fail(Failure::IO, &lost)?;
    print(&opening)?;
    let mut caught = None;
    let failed = Notify::new();
    let told = async {
        tokio::select! {
            signal = signals.received() => caught = Some(signal),
            () = failed.notified() => {}
        }
    };
    let watched = async {
        let watched = watch(client, &mut timeline, &lost).await;
        if watched.is_err() {
            failed.notify_one();
        }
        watched
    };
    let (ended, watched) = tokio::join!(daemon.run_until(told), watched);
    ended?;
    if let Some(signal) = caught {
        // As a shell has it.
        let status = u8::try_from(128 + signal.as_raw_value()).unwrap_or(Failure::SYSTEM);
        return Err(Failure::new(status, "stopped; nothing is left behind"));
    }
    watched?;
    print(&timeline.closing())?;
    timeline.judge()
}

fn config(args: &Args, socket: &Path) -> Config {
    Config {
        source: source::Settings {
            kind: Some(source::Kind::Simulator),
            speed: args.speed,
            ..source::Settings::default()
        },
        simulator: simulator::Settings {
            scenario: Scenario::Demo,
            seed: args.seed,
            ..simulator::Settings::default()
        },
        socket: server::Settings {
            socket: socket.to_owned(),
            backlog: BACKLOG,
            ..server::Settings::default()
        },
        // The calibration of a simulated board must not take the place of a real one's.
        store: store::Settings {
            directory: PathBuf::new(),
            ..store::Settings::default()
        },
        ..Config::default()
    }
}

async fn watch(stream: UnixStream, timeline: &mut Timeline, lost: &str) -> Result<(), Failure> {
    let (reader, mut writer) = stream.into_split();
    (writer.write_all(WATCH).await).or_fail(Failure::IO, lost)?;
    let mut lines = BufReader::new(reader).lines();
    while let Some(line) = (lines.next_line().await).or_fail(Failure::IO, lost)? {
        let message: Value = serde_json::from_str(&line).or_fail(Failure::IO, lost)?;
        print(&timeline.take(&message))?;
    }
    Ok(())
}
