//! `headingd calibration`: looks after the calibrations of a running daemon.

use std::path::{Path, PathBuf};

use clap::builder::RangedU64ValueParser;
use clap::{Subcommand, value_parser};
use serde_json::Value;

use super::control::{self, ControlTarget};
use super::wait::start_and_wait;
use super::{Failure, print, print_json, text, word, write_calibrations};
use crate::calibration::model::Mode;
use crate::calibration::policy::{CalibrationOrigin, Policy};
use crate::publish::control::ControlRequest;
use crate::publish::control::status::CalibrationSummary;
use crate::store::{CalibrationFile, Store};

/// Look after the calibration of the running daemon
///
/// Talks to the daemon's control socket, which its user and its group may use.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Example: headingd calibration list")]
pub struct Args {
    #[command(flatten)]
    pub target: ControlTarget,
    /// Print the daemon's answer, one JSON object; a refusal too
    #[arg(long, global = true)]
    pub json: bool,
    #[command(subcommand)]
    pub action: CalibrationAction,
}

#[derive(Clone, Debug, Subcommand)]
pub enum CalibrationAction {
    /// List the calibrations kept of this sensor, the oldest first
    List,
    /// Show a calibration with its parameters
    Show {
        /// Its number; without it, the active one
        #[arg(value_parser = number())]
        number: Option<u64>,
    },
    /// Lock the active calibration: nothing replaces it, until it is unlocked or the mode changes
    Lock,
    /// Unlock the active calibration: turns and other motion calibrate again. Mode off stays off
    Unlock,
    /// Make an earlier calibration the active one
    Rollback {
        /// Its number; without it, the one saved before the active one
        #[arg(value_parser = number())]
        number: Option<u64>,
    },
    /// Forget the active calibration, or another one
    Forget {
        /// Its number; without it, the active one
        #[arg(value_parser = number())]
        number: Option<u64>,
        /// Forget all calibrations of this sensor
        #[arg(long, conflicts_with = "number")]
        all: bool,
    },
    /// Write a calibration to a file, or to standard output
    Export {
        /// Its number; without it, the active one
        #[arg(value_parser = number())]
        number: Option<u64>,
        /// The file; an existing one is replaced. "-" is standard output, as it is without this
        #[arg(long, value_name = "FILE")]
        out: Option<PathBuf>,
    },
    /// Make the calibration in a file the active one: one that export or "headingd calibrate --out" wrote
    Import {
        /// The file; "-" is standard input
        file: PathBuf,
    },
    /// Calibrate on the next turn, even if there is a calibration and the mode is off
    Start {
        /// Wait until a turn has been judged, or motion has taught as much, and show the progress. Exit status: 0, or 3 if the turn
        /// is refused
        #[arg(long)]
        wait: bool,
    },
    /// Cancel a calibration that was started, or one under way
    Cancel,
    /// Calibrate on every turn (on), only when told to (off), or never (locked). Without a word, show the mode
    Mode {
        /// The mode
        #[arg(value_parser = word::<Policy>(Policy::WORDS))]
        mode: Option<Policy>,
    },
}

impl CalibrationAction {
    fn request(&self) -> Result<ControlRequest, Failure> {
        Ok(match *self {
            Self::List => ControlRequest::List {},
            Self::Show { number } => ControlRequest::Show { number },
            Self::Lock => ControlRequest::Lock {},
            Self::Unlock => ControlRequest::Unlock {},
            Self::Rollback { number } => ControlRequest::Rollback { number },
            Self::Forget { number, all } => ControlRequest::Forget { number, all },
            Self::Export { number, .. } => ControlRequest::Export { number },
            // Read here too: what is wrong is told with the file's name.
            Self::Import { ref file } => ControlRequest::Import {
                file: (Store::read_file(file)?.to_value())
                    .map_err(|why| Failure::new(Failure::DATA, why))?,
            },
            Self::Start { .. } => ControlRequest::Start {},
            Self::Cancel => ControlRequest::Cancel {},
            Self::Mode { mode } => ControlRequest::Mode { mode },
        })
    }
}

/// The number of a calibration.
fn number() -> RangedU64ValueParser {
    value_parser!(u64).range(1..)
}

pub fn run(args: &Args) -> Result<(), Failure> {
    if let CalibrationAction::Start { wait: true } = args.action {
        return start_and_wait(&args.target, args.json);
    }
    if let CalibrationAction::Export { out: Some(out), .. } = &args.action {
        args.target.refuse_overwrite(out)?;
    }
    let answer = args.target.ask(&args.action.request()?, args.json)?;
    if let CalibrationAction::Export { out, .. } = &args.action {
        return export(&answer, out.as_deref());
    }
    if args.json {
        return print_json(&answer);
    }
    let message = text(&answer, "message");
    match &args.action {
        CalibrationAction::List => {
            let calibrations: Vec<_> = control::read(answer["calibrations"].clone())?;
            print(&format!("{}{message}\n", table(&calibrations)))
        }
        CalibrationAction::Show { .. } => {
            let mut parameters = answer["parameters"].clone();
            if let Some(parameters) = parameters.as_object_mut() {
                // Some 90 numbers: --json has them.
                parameters.remove("covariance");
            }
            let line = line(&control::read(answer["calibration"].clone())?);
            print(&format!("{line}\n{parameters}\n"))
        }
        _ => print(&format!("{message}\n")),
    }
}

fn export(answer: &Value, out: Option<&Path>) -> Result<(), Failure> {
    let contents = CalibrationFile::from_value(answer["file"].clone())
        .map_err(|error| Failure::new(Failure::DATA, error))?;
    write_calibrations(out.unwrap_or(Path::new("-")), &contents)
}

fn table(calibrations: &[CalibrationSummary]) -> String {
    let lines = calibrations.iter().map(|calibration| {
        let mark = if calibration.in_force { '*' } else { ' ' };
        format!("{mark} {}\n", line(calibration))
    });
    lines.collect()
}

/// One calibration, as list, show and status print it.
pub(super) fn line(calibration: &CalibrationSummary) -> String {
    let mut line = format!(
        "{}  {}  {:8}",
        calibration.number,
        calibration
            .time
            .as_deref()
            .unwrap_or("at an unknown time      "),
        calibration.mode.map(Mode::word).unwrap_or_default(),
    );
    let mut add = |what: &str, value: Option<String>| {
        if let Some(value) = value {
            line += &format!("  {what} {value}");
        }
    };
    add("by", calibration.method.clone());
    // A turn or motion is what a calibration is usually made on.
    let unusual = calibration
        .origin
        .filter(|origin| *origin != CalibrationOrigin::Turn);
    add("from", unusual.map(|origin| origin.word().to_owned()));
    add(
        "residual",
        calibration.residual_mgauss.map(|n| format!("{n:.1} mG")),
    );
    add(
        calibration.deviation_label(),
        calibration.heading_sd_deg.map(|n| format!("{n:.2} deg")),
    );
    add(
        "gyro",
        calibration.gyro_rms_deg.map(|n| format!("{n:.1} deg")),
    );
    add("samples", calibration.samples.map(|n| n.to_string()));
    line
}
