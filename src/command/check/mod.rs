//! `headingd check`: tries the chips, and says what is wrong with them and what helps.

mod examine;
mod text;

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use super::progress::Progress;
use super::{Failure, config_file, load_config, print};
use crate::config::source::Kind;
use crate::sensor::bus::LinuxBus;
use crate::sensor::clock::SystemClock;
use examine::examine;

/// Try the chips on an I2C bus: which answer, what they are, and whether they are well
///
/// Runs the magnetometer's self-test, and then reads all chips for two seconds: let the board lie still and level
/// meanwhile. Stop the daemon first. The status is 0 only when all is well, 3 when something is not.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// The configuration file; its tables i2c and mounting say what to try [default: /etc/headingd/headingd.toml]
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Print one JSON object
    #[arg(long)]
    pub json: bool,
}

/// Runs the command.
///
/// # Errors
///
/// The configuration cannot be used, or a chip is not well.
pub fn run(args: &Args) -> Result<(), Failure> {
    let path = config_file::path(args.config.as_deref());
    let config = load_config(&path)?;
    if config.source.kind != Some(Kind::I2c) {
        return Err(Failure::new(
            Failure::CONFIG,
            format!(
                "{}: source.kind must be \"i2c\": there are no chips to check",
                path.display()
            ),
        ));
    }
    let mut bus = LinuxBus::new(config.i2c.bus);
    let mut clock = SystemClock::new(Arc::new(AtomicBool::new(false)));
    let busy =
        Progress::spinner("trying the chips, some seconds: let the board lie still and level");
    let report = examine(&config, &mut bus, &mut clock);
    drop(busy);
    if args.json {
        let json = serde_json::to_string(&report);
        let json = json.map_err(|error| Failure::new(Failure::IO, error))?;
        print(&format!("{json}\n"))?;
    } else {
        print(&text::written(&report))?;
    }
    if report.problems.is_empty() {
        Ok(())
    } else {
        Err(Failure::new(Failure::REFUSED, ""))
    }
}
