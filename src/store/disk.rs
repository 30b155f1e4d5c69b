//! Files replaced as a whole: whenever the power goes, either the old content or the new one is there.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

const TEMPORARY_SUFFIX: &str = ".tmp";

/// Replaces a file's content as a whole. After an error a regular file is the old one or the new one.
pub fn replace_file(path: &Path, bytes: &[u8]) -> io::Result<()> {
    // A link keeps pointing where it did, and a device or pipe is written to, not replaced.
    let path = match fs::canonicalize(path) {
        Ok(path) => path,
        Err(error) if error.kind() == io::ErrorKind::NotFound => match fs::read_link(path) {
            Ok(target) => {
                let folder = path.parent().unwrap_or(path);
                return replace_file(&folder.join(target), bytes);
            }
            Err(_) => path.to_owned(),
        },
        Err(error) => return Err(error),
    };
    if path.exists() && !path.is_file() {
        let mut device = OpenOptions::new().write(true).open(&path)?;
        return device.write_all(bytes);
    }
    let directory = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    written(directory, &name, bytes)?.persist(&path)?;
    sync_folder(directory)
}

/// A temporary file with this content, safe on disk; dropped, it is removed. Its errors do not name it, since nobody
/// knows its name.
pub(super) fn written(
    directory: &Path,
    name: &str,
    bytes: &[u8],
) -> io::Result<tempfile::NamedTempFile> {
    let mut options = OpenOptions::new();
    // Neither a calibration nor a log is a secret; the umask still applies.
    options.write(true).create_new(true).mode(0o644);
    let mut file = tempfile::Builder::new()
        .prefix(&temporary_prefix(name))
        .suffix(TEMPORARY_SUFFIX)
        .make_in(directory, |path| options.open(path))?;
    file.as_file_mut().write_all(bytes)?;
    file.as_file().sync_all()?;
    Ok(file)
}

fn temporary_prefix(name: &str) -> String {
    format!(".{name}.")
}

/// Removes what a process left that was killed while it wrote a file of this name.
pub(super) fn remove_leftovers(directory: &Path, name: &str) -> io::Result<()> {
    for entry in fs::read_dir(directory)? {
        let entry = entry?;
        let found = entry.file_name();
        let found = found.to_string_lossy();
        if found.starts_with(&temporary_prefix(name)) && found.ends_with(TEMPORARY_SUFFIX) {
            fs::remove_file(entry.path())?;
        }
    }
    Ok(())
}

/// Makes a rename durable: the folder has changed, so it is synced. Some file systems cannot do that, and
/// neither can a user who may not read the folder: that is no error.
pub(super) fn sync_folder(directory: &Path) -> io::Result<()> {
    use io::ErrorKind::{InvalidInput, PermissionDenied, Unsupported};
    let synced = File::open(directory).and_then(|folder| folder.sync_all());
    synced.or_else(|error| match error.kind() {
        InvalidInput | PermissionDenied | Unsupported => Ok(()),
        _ => Err(error),
    })
}

/// Gives the file's content a second name, `<path>.<reason>-<n>`, n the first free number. A file that can be read stays
/// until it is replaced, so that there is never a moment without one.
pub(super) fn set_aside(path: &Path, reason: &str) -> io::Result<PathBuf> {
    use io::ErrorKind::{InvalidInput, PermissionDenied};
    let numbered = |number: u32| {
        let mut name = path.as_os_str().to_owned();
        name.push(format!(".{reason}-{number}"));
        PathBuf::from(name)
    };
    let aside = (1..)
        .map(numbered)
        .find(|aside| fs::symlink_metadata(aside).is_err())
        .expect("no folder has a file for each number");
    if fs::hard_link(path, &aside).is_ok() {
        return Ok(aside);
    }
    // Not every file system has links.
    let copied = fs::copy(path, &aside).and_then(|_| File::open(&aside)?.sync_all());
    if let Err(error) = copied {
        // An incomplete copy is worth nothing; the disk may be full.
        let _ = fs::remove_file(&aside);
        // What may not be read, or is a folder, is of no use where it is.
        if !matches!(error.kind(), PermissionDenied | InvalidInput) {
            return Err(error);
        }
        fs::rename(path, &aside)?;
    }
    Ok(aside)
}

#[cfg(test)]
mod tests {
    use std::fs::Permissions;
    use std::os::unix::fs::PermissionsExt;

    use super::*;

    #[test]
    fn a_folder_that_cannot_be_synced_is_no_error() {
        sync_folder("/proc".as_ref()).unwrap();
        // Files can be made in it, but nobody except root may read it.
        let folder = tempfile::tempdir().unwrap();
        fs::set_permissions(folder.path(), Permissions::from_mode(0o333)).unwrap();
        sync_folder(folder.path()).unwrap();
        fs::set_permissions(folder.path(), Permissions::from_mode(0o700)).unwrap();
    }
}
