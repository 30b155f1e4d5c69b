//! A ring of log files, of which the oldest are removed: `record-000001.csv`, `record-000002.csv` and so
//! on. They are numbered, since a board without a clock of its own starts each day in 1970.

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

use rustix::fs::statvfs;

const PREFIX: &str = "record-";
const SUFFIX: &str = ".csv";
/// A ring leaves so many bytes free on its disk, or an eighth of a small one: room for 250 calibrations of 4 kB.
const RESERVE: u64 = 1 << 20;
/// No ring has more files, however short: a folder that a program lists at each start stays small.
const MOST_FILES: usize = 1000;

/// Removes the oldest files of the folder and makes the next. Together they fit into `files` × `full` bytes, each counted by its length, at most `full`.
/// If each counted as one, a daemon that restarts again and again would drive out long files by short ones.
pub(super) fn next(directory: &Path, files: usize, full: u64) -> io::Result<(PathBuf, File)> {
    let numbers = numbers(directory)?;
    let next = numbers.last().map_or(1, |last| last + 1);
    // A file's header and its last row may reach beyond its full size.
    let size = |number: &u64| {
        let found = fs::symlink_metadata(path(directory, *number));
        found.map_or(0, |found| found.len().min(full))
    };
    let mut room = full.saturating_mul(files as u64 - 1);
    let fits = |number: &&u64| {
        let left = room.checked_sub(size(number));
        room = left.unwrap_or_default();
        left.is_some()
    };
    let kept = (numbers.iter().rev().take(MOST_FILES - 1))
        .take_while(fits)
        .count();
    for number in &numbers[..numbers.len() - kept] {
        fs::remove_file(path(directory, *number))?;
    }
    let path = path(directory, next);
    let file = File::create_new(&path)?;
    Ok((path, file))
}

/// Removes the oldest file, unless it is the only one, and logs that. Returns whether it did.
pub(super) fn remove_oldest(directory: &Path) -> bool {
    let numbers = numbers(directory).unwrap_or_default();
    let [oldest, _, ..] = numbers[..] else {
        return false;
    };
    let path = path(directory, oldest);
    let removed = fs::remove_file(&path).is_ok();
    if removed {
        let path = path.display();
        tracing::info!("the disk is full: removed the oldest log {path}");
    }
    removed
}

/// Whether the disk has the reserve left; what cannot be found out stops no recording.
pub(super) fn has_reserve(directory: &Path) -> bool {
    statvfs(directory).map_or(true, |disk| {
        let [left, all] = [disk.f_bavail, disk.f_blocks].map(|blocks| blocks * disk.f_frsize);
        left >= RESERVE.min(all / 8)
    })
}

fn path(directory: &Path, number: u64) -> PathBuf {
    directory.join(format!("{PREFIX}{number:06}{SUFFIX}"))
}

/// The numbers of the files that are there, the oldest first; others are not ours.
fn numbers(directory: &Path) -> io::Result<Vec<u64>> {
    let mut numbers = Vec::new();
    for entry in fs::read_dir(directory)? {
        let name = entry?.file_name();
        let number = name
            .to_str()
            .and_then(|name| name.strip_prefix(PREFIX)?.strip_suffix(SUFFIX))
            .and_then(|number| number.parse().ok());
        // A number written otherwise is another file.
        numbers.extend(number.filter(|number| path(directory, *number).file_name() == Some(&name)));
    }
    numbers.sort_unstable();
    Ok(numbers)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_oldest_go_and_the_count_goes_on() {
        let folder = tempfile::tempdir().unwrap();
        let ring = folder.path();
        for _ in 0..5 {
            let (path, _) = next(ring, 3, 10).unwrap();
            fs::write(path, "12345678901").unwrap();
        }
        for other in ["record-x.csv", "record-1.csv", "notes.txt"] {
            fs::write(ring.join(other), "").unwrap();
        }
        let (path, _) = next(ring, 2, 10).unwrap();
        assert!(path.ends_with("record-000006.csv"), "{path:?}");
        let mut left: Vec<String> = fs::read_dir(ring)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        left.sort();
        assert_eq!(
            left,
            [
                "notes.txt",
                "record-000005.csv",
                "record-000006.csv",
                "record-1.csv",
                "record-x.csv"
            ]
        );
    }

    #[test]
    fn short_files_do_not_drive_out_a_long_one() {
        let folder = tempfile::tempdir().unwrap();
        let (long, _) = next(folder.path(), 3, 100).unwrap();
        fs::write(&long, [0; 100]).unwrap();
        for _ in 0..20 {
            let (short, _) = next(folder.path(), 3, 100).unwrap();
            fs::write(short, [0; 5]).unwrap();
        }
        assert!(long.exists());
        assert_eq!(numbers(folder.path()).unwrap().len(), 21);
        next(folder.path(), 3, 100).unwrap();
        assert!(long.exists());
        next(folder.path(), 2, 100).unwrap();
        assert!(!long.exists());
        assert_eq!(numbers(folder.path()).unwrap().len(), 22);
    }

    #[test]
    fn a_ring_has_a_thousand_files_at_most() {
        let folder = tempfile::tempdir().unwrap();
        for _ in 0..MOST_FILES + 5 {
            next(folder.path(), 2, 1 << 20).unwrap();
        }
        let left = numbers(folder.path()).unwrap();
        assert_eq!((left.len(), left[0]), (MOST_FILES, 6));
    }
}
