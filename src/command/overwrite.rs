//! What no command writes over: what it reads, what the daemon keeps, and what is no file.

use std::fs;
use std::os::unix::fs::{FileTypeExt, MetadataExt};
use std::path::{Path, PathBuf};

use super::{Failure, config_file};
use crate::config::Config;
use crate::store::Store;

/// Refuses to write over the log that is read, the configuration (which may be `named`), the daemon's calibrations, and what is
/// no file.
pub fn refuse(
    out: &Path,
    log: Option<&Path>,
    named: Option<&Path>,
    config: &Config,
) -> Result<(), Failure> {
    // Standard output, whatever has that name here.
    if out == Path::new("-") {
        return Ok(());
    }
    refuse_other_than_file(out)?;
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

/// Refuses what is there and cannot hold the output, or must not. A terminal, `/dev/null` or a pipe takes what is written.
fn refuse_other_than_file(out: &Path) -> Result<(), Failure> {
    let (what, right) = match fs::metadata(out).map(|found| found.file_type()) {
        Ok(kind) if kind.is_dir() => ("it is a folder", "name a file in it"),
        Ok(kind) if kind.is_socket() => ("it is a socket", "name a file"),
        // Its file system would be lost.
        Ok(kind) if kind.is_block_device() => ("it is a disk", "name a file"),
        _ => return Ok(()),
    };
    Err(Failure::new(
        Failure::CANNOT_CREATE,
        format!(
            "cannot write {}: {what}; {right}, or - for standard output",
            out.display()
        ),
    ))
}

/// Whether both are there, and one file.
fn same_file(one: &Path, other: &Path) -> bool {
    let file = |path| fs::metadata(path).map(|found| (found.dev(), found.ino()));
    matches!((file(one), file(other)), (Ok(one), Ok(other)) if one == other)
}
