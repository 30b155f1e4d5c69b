//! Where a command finds its configuration: the file that `--config` names, or else the same one for all commands.

use std::env;
use std::fs::{self, File};
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use super::{Failure, OrFail, tell};
use crate::config::Config;

/// The configuration of the service, and of every command that is told of no other.
const USUAL: &str = "/etc/headingd/headingd.toml";

/// What helps where that is missing.
const INSTALL: &str = "; the package installs it, and --config names another: config/simulator.toml needs no hardware";

/// The environment variable that names another file in its place.
const VARIABLE: &str = "HEADINGD_CONFIG";

/// The file that the option names, or else the variable.
fn chosen(named: Option<&Path>) -> Option<PathBuf> {
    let variable = || env::var_os(VARIABLE).filter(|path| !path.is_empty());
    named
        .map(Path::to_owned)
        .or_else(|| variable().map(PathBuf::from))
}

/// The path of the configuration of a command that cannot do without one.
pub fn path(named: Option<&Path>) -> PathBuf {
    chosen(named).unwrap_or_else(|| USUAL.into())
}

/// The configuration of a command that can do with the defaults: they hold where no file is named and there is none.
pub fn load(named: Option<&Path>) -> Result<Config, Failure> {
    let chosen = chosen(named);
    if chosen.is_none() && matches!(Path::new(USUAL).try_exists(), Ok(false)) {
        return Ok(Config::default());
    }
    read(&chosen.unwrap_or_else(|| USUAL.into()))
}

/// The configuration of a command that only has to find a running daemon. Where the usual file has a fault (perhaps edited since
/// the daemon started), the default sockets are tried. A file that the user names gets no such fallback: it may be of another daemon.
pub fn load_for_client(named: Option<&Path>) -> Result<Config, Failure> {
    match load(named) {
        Err(failure) if chosen(named).is_none() => {
            tell(format_args!("{failure}"));
            tell("trying the usual sockets");
            Ok(Config::default())
        }
        loaded => loaded,
    }
}

/// The longest configuration that is read, bytes: one with every key has a hundredth of it.
const LONGEST_CONFIG: u64 = 1 << 20;

pub fn read(path: &Path) -> Result<Config, Failure> {
    let name = path.display();
    let mut bytes = Vec::new();
    open_regular(path)
        .and_then(|file| file.take(LONGEST_CONFIG + 1).read_to_end(&mut bytes))
        .map_err(|error| {
            let missing = path == Path::new(USUAL) && error.kind() == io::ErrorKind::NotFound;
            let remedy = if missing { INSTALL } else { "" };
            let message = format!("cannot read configuration {name}: {error}{remedy}");
            Failure::new(Failure::NO_INPUT, message)
        })?;
    if bytes.len() as u64 > LONGEST_CONFIG {
        let message = format!("{name}: longer than 1 MiB, so it is no configuration of headingd");
        return Err(Failure::new(Failure::CONFIG, message));
    }
    let not_text = format!("{name}: not a text in UTF-8");
    let text = String::from_utf8(bytes).or_fail(Failure::CONFIG, not_text)?;
    Config::parse(&name.to_string(), &text).map_err(|error| Failure::new(Failure::CONFIG, error))
}

/// Opens a regular file. A pipe may have nobody who writes to it, and a device may have no end.
fn open_regular(path: &Path) -> io::Result<File> {
    let found = fs::metadata(path)?;
    if found.is_file() || found.is_dir() {
        return File::open(path);
    }
    let what = "it is no regular file, but a pipe, a device or a socket";
    Err(io::Error::new(io::ErrorKind::InvalidInput, what))
}
