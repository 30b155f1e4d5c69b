//! headingd: a compass daemon that calibrates its magnetometer by itself.

use std::process::ExitCode;

use clap::Parser;
use headingd::command::cli::Cli;

fn main() -> ExitCode {
    Cli::parse().run()
}
