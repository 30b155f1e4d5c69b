//! `headingd report`: a page with figures, of a log or of a running daemon.

use std::future::pending;
use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use rustix::fs::{Access, access};
use tempfile::tempfile_in;

use super::control::{daemon_status, exchange};
use super::headings::{DaemonSockets, Headings};
use super::read_log::{read_log_on, tell_skips};
use super::runtime::runtime;
use super::{Failure, OrFail, config_file, number, overwrite, progress, tell, write_out};
use crate::calibration::model::Calibration;
use crate::config::Config;
use crate::config::source::Kind;
use crate::position::{Follower, Gpsd};
use crate::publish::control::ControlRequest;
use crate::publish::raw::Object;
use crate::recording::{Header, TimeOfDay};
use crate::report::{Analysis, page};
use crate::sensor::replay::Replay;
use crate::store::CalibrationFile;
use crate::true_north::TrueNorth;
use crate::wall_clock;

/// Raw readings alone.
const WATCH: &str = r#"{"enable":true,"json":false,"readings":true}"#;

/// A daemon whose source is silent is not waited for without end.
const PATIENCE: Duration = Duration::from_secs(1);

/// Write a page with figures on a log, or on what a running daemon reads
///
/// The page is one file of HTML without scripts, and needs no network. It shows headings and their uncertainty over time,
/// the field of the turn before and after its calibration, what RIST and the swarm did, the deviation by heading, and each limit
/// of the verdict with what was measured. With --socket, or without a log, it shows what the daemon reads from now on.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example: headingd report turn.csv --out report.html")]
pub struct Args {
    /// The log, "-" is standard input; without one, the running daemon
    #[arg(conflicts_with_all = ["socket", "duration"])]
    pub log: Option<PathBuf>,
    /// The socket for headings of the running daemon; without it, that of the configuration
    #[arg(long, value_name = "PATH")]
    pub socket: Option<PathBuf>,
    /// How long to listen to the daemon, 1 to 86400 seconds
    #[arg(long, value_name = "S", default_value_t = 60.0, value_parser = number("a number of seconds", 1.0..=86_400.0))]
    pub duration: f64,
    /// The page to write; an existing one is replaced. "-" is standard output
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// Configuration [default: $HEADINGD_CONFIG, else /etc/headingd/headingd.toml, if there is one]
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    let named = args.config.as_deref();
    let mut config = match (&args.log, &args.socket) {
        (Some(_), _) => config_file::load(named)?,
        // A client that is told the socket needs no file.
        (None, Some(_)) if named.is_none() => config_file::load(None).unwrap_or_default(),
        (None, _) => config_file::load_for_client(named)?,
    };
    overwrite::refuse(&args.out, args.log.as_deref(), named, &config)?;
    may_write(&args.out)?;
    let is_other = |socket: &PathBuf| named.is_none() && *socket != config.socket.socket;
    if args.socket.as_ref().is_some_and(is_other) {
        // What the usual file says of place, source and limits is not said of another daemon.
        config = Config::default();
    }
    let analysis = match &args.log {
        Some(log) => of_log(log, &config)?,
        None => of_daemon(args, &config)?,
    };
    write_out(&args.out, page(&analysis).as_bytes())
}

/// Refuses a page that could not be written in the end, after a day of listening perhaps.
fn may_write(out: &Path) -> Result<(), Failure> {
    if out == Path::new("-") {
        return Ok(());
    }
    // A file is replaced, also behind a link; a device or a pipe is written to.
    let found = out.canonicalize().unwrap_or_else(|_| out.to_owned());
    let tried: io::Result<()> = if found.exists() && !found.is_file() {
        access(&found, Access::WRITE_OK).map_err(Into::into)
    } else {
        let folder = found.parent().filter(|folder| *folder != Path::new(""));
        tempfile_in(folder.unwrap_or(Path::new("."))).map(drop)
    };
    tried.or_fail(
        Failure::CANNOT_CREATE,
        format!("cannot write {}", out.display()),
    )
}

fn of_log(log: &Path, config: &Config) -> Result<Analysis, Failure> {
    let mut replay = Replay::open(log)?;
    let header = replay.header().clone();
    let mut time = TimeOfDay::new(&header);
    let setup = config.setup(&header.mountings, &config.mounting.board());
    let north = TrueNorth::new(&config.true_north);
    let mut analysis = Analysis::new(log, header, setup, north, None);
    read_log_on(&mut replay, |entry, begins_stretch| {
        if begins_stretch {
            analysis.begin_stretch();
            time.begin_stretch();
        }
        analysis.take(entry.reading, time.at(entry.reading.t_s));
        Ok(())
    })?;
    tell_skips(&replay)?;
    Ok(analysis)
}

fn of_daemon(args: &Args, config: &Config) -> Result<Analysis, Failure> {
    let sockets = match &args.socket {
        // Another daemon than that of the configuration has another control socket.
        Some(socket) if *socket != config.socket.socket => {
            DaemonSockets::beside(socket, &Config::default())
        }
        _ => DaemonSockets::beside(&config.socket.socket, config),
    };
    let mut headings = Headings::open(&sockets.headings, WATCH)?;
    let mut analysis = begin(&sockets, headings.board()?, config);
    headings.set_patience(PATIENCE)?;
    // A daemon that replays a log was not here and now when the log was recorded: neither gpsd nor clock counts.
    let live = config.source.kind != Some(Kind::Replay);
    let mut gpsd = if live { follower(config)? } else { None };
    let bar = progress::bar(progress::WITH_MESSAGE);
    bar.set_message(format!(
        "listening for {:.0} s; Ctrl-C gives up",
        args.duration
    ));
    let begun = Instant::now();
    let mut early = None;
    loop {
        let passed_s = begun.elapsed().as_secs_f64();
        if passed_s >= args.duration {
            break;
        }
        progress::set(&bar, passed_s / args.duration);
        match headings.raw_in_time() {
            Ok(Object::Reading(row)) => {
                if let Some(position) = gpsd.as_mut().and_then(Follower::news) {
                    analysis.put_position(position);
                }
                // A computer without a real-time clock uses the receiver's time.
                let now = || wall_clock::now().or_else(|| gpsd.as_ref()?.now());
                analysis.take(row.reading(), live.then(now).flatten());
            }
            Ok(_) => {}
            Err(failure) => {
                early = Some(failure.message);
                break;
            }
        }
    }
    drop(bar);
    if let Some(why) = early {
        tell(format_args!("the page ends early: {why}"));
    }
    if gpsd.is_some_and(|gpsd| !gpsd.has_position()) {
        tell(format_args!(
            "no position from the gpsd at {}",
            config.true_north.gpsd
        ));
    }
    if analysis.has_readings() {
        return Ok(analysis);
    }
    let why = "the daemon has handed out no readings: headingd status says why";
    Err(Failure::new(Failure::UNAVAILABLE, why))
}

/// An analysis that begins as the daemon is now, as far as this user may ask.
fn begin(sockets: &DaemonSockets, header: Header, config: &Config) -> Analysis {
    let status = daemon_status(&sockets.control).ok();
    // The board may have been told to be mounted otherwise than the configuration says.
    let told = status.as_ref().and_then(|status| status.board_axes);
    let board = told.unwrap_or_else(|| config.mounting.board());
    let setup = config.setup(&header.mountings, &board);
    let north = TrueNorth::new(&config.true_north);
    let active = active(sockets);
    let mut analysis = Analysis::new(&sockets.headings, header, setup, north, active);
    if let Some(status) = status {
        analysis.put_policy(status.policy);
    }
    analysis
}

/// Follows the gpsd of the configuration, if it has one, until the command ends.
fn follower(config: &Config) -> Result<Option<Follower>, Failure> {
    let Some(gpsd) = Gpsd::parse(&config.true_north.gpsd) else {
        return Ok(None);
    };
    let runtime = runtime()?;
    let follower = {
        let _within = runtime.enter();
        Follower::start(gpsd)
    };
    std::thread::spawn(move || runtime.block_on(pending::<()>()));
    Ok(Some(follower))
}

/// The daemon's calibration, where this user may ask for it.
fn active(sockets: &DaemonSockets) -> Option<Calibration> {
    let request = ControlRequest::Export { number: None };
    let answer = exchange(&sockets.control, &request, false).ok()?;
    let contents = CalibrationFile::from_value(answer["file"].clone()).ok()?;
    let entry = *contents.sensors.first()?.active()?;
    Some(entry.record.calibration)
}
