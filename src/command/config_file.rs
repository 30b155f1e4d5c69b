//! Where a command finds its configuration: the file that `--config` names, or else the same one for all commands.

use std::env;
use std::path::{Path, PathBuf};

use super::{Failure, load_config};
use crate::config::Config;

/// The configuration of the service, and of every command that is told of no other.
const USUAL: &str = "/etc/headingd/headingd.toml";

/// The environment variable that names another file in its place.
const VARIABLE: &str = "HEADINGD_CONFIG";

/// The file that a command without `--config` reads.
fn usual() -> PathBuf {
    match env::var_os(VARIABLE) {
        Some(path) if !path.is_empty() => path.into(),
        _ => USUAL.into(),
    }
}

/// The path of the configuration of a command that cannot do without one.
pub fn path(named: Option<&Path>) -> PathBuf {
    named.map_or_else(usual, Path::to_owned)
}

/// The configuration of a command that can do with the defaults: they hold where no file is named and there is none.
///
/// # Errors
///
/// The file cannot be read, or has a fault.
pub fn load(named: Option<&Path>) -> Result<Config, Failure> {
    let path = path(named);
    let chosen = named.is_some() || env::var_os(VARIABLE).is_some();
    if !chosen && !path.exists() {
        return Ok(Config::default());
    }
    load_config(&path)
}

/// The configuration of a command that only has to find a running daemon, which may have started before somebody made a
/// fault in the file: then the usual sockets are tried.
///
/// # Errors
///
/// A file that was named cannot be read, or has a fault.
pub fn load_for_client(named: Option<&Path>) -> Result<Config, Failure> {
    match load(named) {
        Err(failure) if named.is_none() => {
            eprintln!("headingd: {failure}\nheadingd: trying the usual sockets");
            Ok(Config::default())
        }
        loaded => loaded,
    }
}
