//! `headingd check`: tries the chips, and says what is wrong with them and what helps.

#[cfg(test)]
mod tests;

use std::fmt;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use serde_json::json;

use super::{Failure, config_file, print, print_json, progress};
use crate::check::Fault;
use crate::config::Config;
use crate::config::source::Kind;
use crate::frame::rounded;
use crate::sensor::bus::LinuxBus;
use crate::sensor::clock::SystemClock;
use crate::sensor::i2c::examine::{CheckReport, Expected, examine};

/// Try the chips on an I2C bus: which answer, what they are, and whether they are well
///
/// Runs the magnetometer's self-test, and then reads all chips for two seconds: let the board lie still and level
/// meanwhile. Stop the daemon first. The status is 0 only when all is well, 3 when something is not.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// The configuration file; its tables i2c and mounting say what to try [default: $HEADINGD_CONFIG, else /etc/headingd/headingd.toml]
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Print one JSON object
    #[arg(long)]
    pub json: bool,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    let path = config_file::path(args.config.as_deref());
    let config = config_file::read(&path)?;
    if config.source.kind != Some(Kind::I2c) {
        let found = (config.source.kind)
            .map_or_else(|| "not set".to_owned(), |kind| json!(kind).to_string());
        let right = "\"i2c\": there are no chips to check";
        let fault = Fault::new("source.kind", found, right);
        let message = format!("{}: {fault}", path.display());
        return Err(Failure::new(Failure::CONFIG, message));
    }
    let mut bus = LinuxBus::new(config.i2c.bus);
    let mut clock = SystemClock::new(Arc::new(AtomicBool::new(false)));
    let busy =
        progress::spinner("trying the chips, some seconds: let the board lie still and level");
    let report = examine(&expected(&config), &mut bus, &mut clock);
    drop(busy);
    if args.json {
        print_json(&report)?;
    } else {
        print(&report.to_string())?;
    }
    if report.problems.is_empty() {
        Ok(())
    } else {
        Err(Failure::new(Failure::REFUSED, ""))
    }
}

fn expected(config: &Config) -> Expected<'_> {
    let chips = config.i2c.board.mountings(&config.mounting.chips());
    Expected {
        i2c: &config.i2c,
        mountings: chips.on(&config.mounting.board()),
        gyro_bias_limit_deg_s: config.attitude.gyro_bias_limit_deg_s,
    }
}

/// Line by line.
impl fmt::Display for CheckReport {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(out, "{}", self.bus)?;
        for found in &self.chips {
            writeln!(out, "  0x{:02x}  {}", found.address, found.chip)?;
        }
        if let Some(found) = &self.magnetometer {
            let probably = if found.sure { "" } else { "probably " };
            writeln!(
                out,
                "magnetometer: {probably}{} ({})",
                found.kind, found.why
            )?;
        }
        for axis in &self.self_test {
            let measured = axis.measured.map_or("overflow".to_owned(), whole);
            let passed = if axis.passed { "good" } else { "NOT GOOD" };
            let (low, high) = axis.limits;
            writeln!(
                out,
                "  self-test {}: {measured} counts, expected {:.0} ({low:.0} to {high:.0}): {passed}",
                axis.axis, axis.expected
            )?;
        }
        if let (Some(field), Some(rate_hz)) = (self.field_mgauss, self.mag_rate_hz) {
            writeln!(
                out,
                "  field: {field:.0} mG, {rate_hz:.1} readings a second (the Earth's: 220 to 670 mG)"
            )?;
        }
        if let (Some([x, y, z]), Some(noise), Some(rate_hz)) =
            (self.gyro_deg_s, self.gyro_noise_deg_s, self.gyro_rate_hz)
        {
            writeln!(
                out,
                "gyro at rest: {x:+.2} {y:+.2} {z:+.2} deg/s on body X, Y, Z, noise {noise:.2} deg/s, {rate_hz:.1} readings a second"
            )?;
        }
        if let Some([x, y, z]) = self.accel_m_s2 {
            writeln!(
                out,
                "accelerometer at rest: {x:+.2} {y:+.2} {z:+.2} m/s2 on body X, Y, Z (level: 0 0 -9.8)"
            )?;
        }
        for problem in &self.problems {
            writeln!(out, "PROBLEM ({}): {}", problem.code, problem.message)?;
        }
        if self.problems.is_empty() {
            writeln!(out, "all is well")?;
        }
        Ok(())
    }
}

fn whole(counts: f64) -> String {
    format!("{:.0}", rounded(counts, 0))
}
