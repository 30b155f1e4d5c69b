//! A ring of log files, of which the oldest are removed: `record-000001.csv`, `record-000002.csv` and so
//! on. They are numbered, since a board without a clock of its own starts each day in 1970.

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

const PREFIX: &str = "record-";
const SUFFIX: &str = ".csv";

/// Makes room for another file among at most `most`, and makes it.
pub(super) fn next(directory: &Path, most: usize) -> io::Result<(PathBuf, File)> {
    fs::create_dir_all(directory)?;
    let numbers = numbers(directory)?;
    let next = numbers.last().map_or(1, |last| last + 1);
    let excess = (numbers.len() + 1).saturating_sub(most);
    for number in &numbers[..excess.min(numbers.len())] {
        fs::remove_file(path(directory, *number))?;
    }
    let path = path(directory, next);
    let file = File::create_new(&path)?;
    Ok((path, file))
}

/// Removes the oldest file and returns its path, unless there are no more than `spared`.
pub(super) fn remove_oldest(directory: &Path, spared: usize) -> io::Result<Option<PathBuf>> {
    let numbers = numbers(directory)?;
    let Some(oldest) = numbers.first().filter(|_| numbers.len() > spared) else {
        return Ok(None);
    };
    let path = path(directory, *oldest);
    fs::remove_file(&path)?;
    Ok(Some(path))
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
        let ring = folder.path().join("a/b");
        for _ in 0..5 {
            next(&ring, 3).unwrap();
        }
        for other in ["record-x.csv", "record-1.csv", "notes.txt"] {
            fs::write(ring.join(other), "").unwrap();
        }
        let (path, _) = next(&ring, 2).unwrap();
        assert!(path.ends_with("record-000006.csv"), "{path:?}");
        let mut left: Vec<String> = fs::read_dir(&ring)
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
}
