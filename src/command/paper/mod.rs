//! `headingd paper`: the paper's tests, run again, its tables beside ours.
//!
//! A. Ali, S. Siddharth, Z. Syed, N. El-Sheimy, "Swarm Optimization-Based Magnetometer Calibration for
//! Personal Handheld Devices", Sensors 12 (2012).

pub mod log;
pub mod published;
pub mod trial;

mod json;
mod text;

use super::progress::Progress;
use super::{Failure, print};

/// Run the tests of the paper again, and print its tables beside ours
///
/// Makes the logs of Ali et al. (Sensors 12, 2012) from their own parameters, and calibrates on them with the
/// paper's swarm (all samples, RIST, RIST and MPSOT) and with the standard profile. Takes a few seconds. The same
/// seed gives the same numbers, but for the times.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Number that fixes noise and swarms
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// Print one JSON object
    #[arg(long)]
    pub json: bool,
}

/// Runs the command.
///
/// # Errors
///
/// A test of the paper cannot be made again, or a log cannot be written.
pub fn run(args: &Args) -> Result<(), Failure> {
    let busy = Progress::spinner("running the paper's tests, some seconds");
    let trials = trial::trials(args.seed)
        .map_err(|error| Failure::new(Failure::REFUSED, format!("cannot calibrate {error}")))?;
    drop(busy);
    if args.json {
        let json = json::json(&trials, args.seed).map_err(|error| {
            Failure::new(
                Failure::IO,
                format!("cannot write the tests as JSON: {error}"),
            )
        })?;
        print(&(json + "\n"))
    } else {
        print(&text::text(&trials, args.seed))
    }
}
