//! Commands, one file each; the command line; what they write and which options they share.

use std::fmt;
use std::io::{self, Write};
use std::ops::RangeInclusive;
use std::path::Path;

use clap::builder::{PossibleValuesParser, TypedValueParser};
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

use crate::store::{CalibrationFile, replace_file};

mod align;
mod calibrate;
mod calibration;
mod check;
pub mod cli;
mod config;
mod config_file;
mod control;
mod demo;
mod failure;
mod field;
mod headings;
mod monitor;
mod mounting;
mod overwrite;
mod progress;
mod read_log;
mod record;
mod replay;
mod report;
mod run;
mod runtime;
mod simulate;
mod status;
mod wait;
mod watch;
mod wording;

use failure::{Failure, OrFail};

/// Says this on standard error. Nobody reads it where that is gone; eprintln! would panic.
fn tell(text: impl fmt::Display) {
    let _ = writeln!(io::stderr(), "headingd: {text}");
}

/// What has come of writing to standard output. A reader that has gone away (`| head`) ends the command, which is no failure.
fn output<T>(written: io::Result<T>) -> Result<T, Failure> {
    written.map_err(|error| match error.kind() {
        io::ErrorKind::BrokenPipe => Failure::new(0, ""),
        _ => Failure::new(
            Failure::IO,
            format!("cannot write to standard output: {error}"),
        ),
    })
}

fn print(text: &str) -> Result<(), Failure> {
    write_out(Path::new("-"), text.as_bytes())
}

/// Replaces a file as a whole; "-" is standard output.
fn write_out(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    if path == Path::new("-") {
        let mut out = io::stdout().lock();
        return output(out.write_all(bytes).and_then(|()| out.flush()));
    }
    let what = format!("cannot write {}", path.display());
    replace_file(path, bytes).or_fail(Failure::CANNOT_CREATE, what)
}

/// Writes a calibration file; "-" is standard output.
fn write_calibrations(path: &Path, contents: &CalibrationFile) -> Result<(), Failure> {
    let json = contents.to_json();
    let json = json.map_err(|why| Failure::new(Failure::DATA, why))?;
    write_out(path, json.as_bytes())
}

/// Writes a value to standard output, as one line of JSON.
fn print_json(value: &impl Serialize) -> Result<(), Failure> {
    let json = serde_json::to_string(value).or_fail(Failure::IO, "cannot write JSON")?;
    print(&(json + "\n"))
}

/// A text of an object that the daemon sent; empty where it has none.
fn text<'a>(object: &'a Value, key: &str) -> &'a str {
    object[key].as_str().unwrap_or_default()
}

/// Reads an option that is a number within a range; `what` says of what: "a number of seconds".
fn number(
    what: &'static str,
    range: RangeInclusive<f64>,
) -> impl Fn(&str) -> Result<f64, String> + Clone + Send + Sync + 'static {
    move |text| {
        let number = text.parse().ok().filter(|number| range.contains(number));
        let (least, most) = range.clone().into_inner();
        number.ok_or_else(|| format!("must be {what} from {least} to {most}"))
    }
}

/// Reads an option whose words are those of the configuration.
fn word<T>(words: &'static [&'static str]) -> impl TypedValueParser<Value = T>
where
    T: DeserializeOwned + Clone + Send + Sync + 'static,
{
    PossibleValuesParser::new(words).try_map(|word| serde_json::from_value(word.into()))
}
