//! Writes the manual pages into a folder: headingd(1) and one of each command from the command line's own
//! definitions, headingd.toml(5) from the configuration file that goes with the program.
//!
//!     cargo run --example man -- target/man

#[path = "keys.rs"]
mod keys;

use std::error::Error;
use std::fs;
use std::path::Path;

use clap::CommandFactory;
use headingd::command::cli::Cli;
use roff::{Roff, bold, roman};

const CONFIGURATION: &str = include_str!("../config/headingd.toml");

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args_os().nth(1).ok_or("usage: man FOLDER")?;
    let folder = Path::new(&folder);
    fs::create_dir_all(folder)?;
    clap_mangen::generate_to(Cli::command().disable_help_subcommand(true), folder)?;
    fs::write(folder.join("headingd.toml.5"), configuration()?)?;
    Ok(())
}

/// headingd.toml(5).
fn configuration() -> Result<String, Box<dyn Error>> {
    let mut page = Roff::new();
    let source = concat!("headingd ", env!("CARGO_PKG_VERSION"));
    page.control("TH", ["headingd.toml", "5", "", source, ""]);
    page.control("SH", ["NAME"]);
    page.text([roman("headingd.toml - configuration of the compass daemon")]);
    page.control("SH", ["SYNOPSIS"]);
    page.text([roman("/etc/headingd/headingd.toml")]);
    page.control("SH", ["DESCRIPTION"]);
    page.text([roman(
        "A file in TOML. A key or table that is left out has its default. Every fault in a file is named, with its \
         line, by",
    ), bold(" headingd config check "), roman("FILE; systemctl reload headingd has it read again.")]);
    for table in keys::read(CONFIGURATION)? {
        page.control("SH", [format!("[{}]", table.name).as_str()]);
        page.text([roman(table.about)]);
        for key in table.keys {
            page.control("TP", []);
            page.text([bold(key.name)]);
            let default = match key.default {
                Some(default) => format!("Default: {default}"),
                None => "No default.".to_owned(),
            };
            page.text([roman(key.about)]);
            page.control("br", []);
            page.text([roman(default)]);
        }
    }
    page.control("SH", ["FILES"]);
    for (file, what) in [
        (
            "/etc/headingd/headingd.toml",
            "the configuration of the service",
        ),
        ("/run/headingd/heading.sock", "where headings are served"),
        ("/var/lib/headingd", "where the calibration is kept"),
    ] {
        page.control("TP", []);
        page.text([bold(file)]);
        page.text([roman(what)]);
    }
    page.control("SH", ["SEE ALSO"]);
    page.text([
        bold("headingd"),
        roman("(1), "),
        bold("headingd-run"),
        roman("(1)"),
    ]);
    Ok(page.render())
}
