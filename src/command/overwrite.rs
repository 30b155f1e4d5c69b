//! Files that no command writes over: what it reads, and what the daemon keeps.

use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use super::{Failure, config_file};
use crate::config::Config;
use crate::store::Store;

/// Refuses to write over the log that is read, the configuration (which may be `named`), and the daemon's calibrations.
pub fn refuse(
    out: &Path,
    log: Option<&Path>,
    named: Option<&Path>,
    config: &Config,
) -> Result<(), Failure> {
    let configuration = config_file::path(named);
    let store = config.store.directory().map(Store::file_in);
    let needed = [
        (log.map(Path::to_owned), "is the log that is read"),
        (Some(configuration), "is the configuration"),
        (
            store,
            "holds the daemon's calibrations, and headingd calibration import adds one to them",
        ),
    ];
    let over = |(path, what): (Option<PathBuf>, _)| same_file(&path?, out).then_some(what);
    match needed.into_iter().find_map(over) {
        Some(what) => Err(Failure::new(
            Failure::CANNOT_CREATE,
            format!(
                "cannot write {}: it {what}; name another file",
                out.display()
            ),
        )),
        None => Ok(()),
    }
}

/// Whether both are there, and one file.
fn same_file(one: &Path, other: &Path) -> bool {
    let file = |path| fs::metadata(path).map(|found| (found.dev(), found.ino()));
    matches!((file(one), file(other)), (Ok(one), Ok(other)) if one == other)
}
