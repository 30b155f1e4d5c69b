//! The command line as a whole: its commands and their help, from which the manual pages come too.

use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// A compass daemon that calibrates its magnetometer by itself
///
/// headingd reads a three-axis magnetometer and a gyro, notices when the board has made a full turn,
/// calibrates on that turn, judges the result, and publishes headings on a Unix socket in the JSON of gpsd.
#[derive(Parser)]
#[command(name = "headingd", version, after_help = "Start with: headingd demo")]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
}

/// In the order of help: what is needed every day first.
#[derive(Subcommand)]
enum Command {
    Run(super::run::Args),
    Check(super::check::Args),
    Status(super::status::Args),
    Watch(super::watch::Args),
    Monitor(super::monitor::Args),
    Calibration(super::calibration::Args),
    Mounting(super::mounting::Args),
    Record(super::record::Args),
    Report(super::report::Args),
    Replay(super::replay::Args),
    Calibrate(super::calibrate::Args),
    Align(super::align::Args),
    Simulate(super::simulate::Args),
    Demo(super::demo::Args),
    Field(super::field::Args),
    Config(super::config::Args),
}

impl Cli {
    /// Carries out the command. What goes wrong is said on standard error, and the status tells it to programs.
    pub fn run(self) -> ExitCode {
        let result = match self.command {
            Command::Run(args) => super::run::run(&args),
            Command::Check(args) => super::check::run(&args),
            Command::Status(args) => super::status::run(&args),
            Command::Watch(args) => super::watch::run(&args),
            Command::Monitor(args) => super::monitor::run(&args),
            Command::Calibration(args) => super::calibration::run(&args),
            Command::Mounting(args) => super::mounting::run(&args),
            Command::Record(args) => super::record::run(&args),
            Command::Report(args) => super::report::run(&args),
            Command::Replay(args) => super::replay::run(&args),
            Command::Calibrate(args) => super::calibrate::run(&args),
            Command::Align(args) => super::align::run(&args),
            Command::Simulate(args) => super::simulate::run(&args),
            Command::Demo(args) => super::demo::run(&args),
            Command::Field(args) => super::field::run(&args),
            Command::Config(args) => super::config::run(&args),
        };
        match result {
            Ok(()) => ExitCode::SUCCESS,
            Err(failure) => {
                failure.tell();
                ExitCode::from(failure.status)
            }
        }
    }
}
