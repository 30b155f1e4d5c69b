//! Writes the completions of the shells into a folder: headingd (bash), _headingd (zsh), headingd.fish.
//!
//!     cargo run --example completions -- target/completions

use std::error::Error;
use std::fs;
use std::path::Path;

use clap::CommandFactory;
use clap_complete::{Shell, generate_to};
use headingd::command::cli::Cli;

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args_os()
        .nth(1)
        .ok_or("usage: completions FOLDER")?;
    let folder = Path::new(&folder);
    fs::create_dir_all(folder)?;
    for shell in [Shell::Bash, Shell::Zsh, Shell::Fish] {
        generate_to(shell, &mut Cli::command(), "headingd", folder)?;
    }
    // Where bash looks, the file has the program's name alone.
    fs::rename(folder.join("headingd.bash"), folder.join("headingd"))?;
    Ok(())
}
