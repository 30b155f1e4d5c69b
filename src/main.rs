//! headingd: a compass daemon that calibrates its magnetometer by itself.

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use headingd::command;

/// A compass daemon that calibrates its magnetometer by itself
///
/// headingd reads a three-axis magnetometer and a gyro, notices when the board has made a full turn,
/// calibrates on that turn, judges the result, and publishes headings on a Unix socket in the JSON of gpsd.
#[derive(Parser)]
#[command(name = "headingd", version, after_help = "Start with: headingd demo")]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Replay(command::replay::Args),
    Calibrate(command::calibrate::Args),
    Run(command::run::Args),
    Record(command::record::Args),
    Demo(command::demo::Args),
    Simulate(command::simulate::Args),
    Check(command::check::Args),
    Config(command::config::Args),
    Paper(command::paper::Args),
}

fn main() -> ExitCode {
    let result = match Cli::parse().command {
        Command::Replay(args) => command::replay::run(&args),
        Command::Calibrate(args) => command::calibrate::run(&args),
        Command::Run(args) => command::run::run(&args),
        Command::Record(args) => command::record::run(&args),
        Command::Demo(args) => command::demo::run(&args),
        Command::Simulate(args) => command::simulate::run(&args),
        Command::Check(args) => command::check::run(&args),
        Command::Config(args) => command::config::run(&args),
        Command::Paper(args) => command::paper::run(&args),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            failure.tell();
            ExitCode::from(failure.status)
        }
    }
}
