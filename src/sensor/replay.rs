//! A recorded log as a source of readings. The caller decides how fast to play them.

use std::fs::{self, File, Metadata};
use std::io::{self, BufReader, ErrorKind, Seek};
use std::os::fd::AsFd;
use std::os::unix::fs::{FileTypeExt, OpenOptionsExt};
use std::path::Path;
use std::sync::mpsc;
use std::thread;
use std::time::Duration;

use crate::recording::{Reader, RecordingError};

/// Longest wait for somebody to open a named pipe for writing.
const PIPE_PATIENCE: Duration = Duration::from_secs(5);

/// An open log: an iterator of its good rows that counts the bad ones.
pub type Replay = Reader<BufReader<File>>;

impl Replay {
    /// Opens the log, `-` is standard input, and reads its header. The times of a file are checked, too. Those of a pipe are
    /// not: its first rows may take long to come.
    ///
    /// # Errors
    ///
    /// When the log cannot be opened, its header cannot be understood, or its times are not in seconds.
    pub fn open(path: &Path) -> Result<Self, RecordingError> {
        let log = path.display().to_string();
        let failed =
            |source: io::Error| RecordingError::Input(format!("cannot open log {log}: {source}"));
        let mut file = open(path).map_err(failed)?;
        if file.metadata().map_err(failed)?.is_file() {
            Reader::new(log.clone(), BufReader::new(&file))?.check_times()?;
            file.rewind().map_err(failed)?;
        }
        Self::new(log, BufReader::new(file))
    }

    /// How much of the file has been read, 0 to 1; 0 where that is not known, as of a pipe.
    pub fn share_read(&self) -> f64 {
        let mut file = self.input().get_ref();
        let position = file.stream_position().unwrap_or(0);
        let bytes = file.metadata().map_or(0, |found| found.len());
        (position as f64 / bytes.max(1) as f64).min(1.0)
    }

    /// Why the log, read to its end, is of no use: it has no row, or most of them were skipped. `None` if it is of use.
    pub fn unusable(&self) -> Option<String> {
        let skips = self.skips();
        if skips.is_empty() {
            let name = self.name();
            return Some(format!(
                "log {name} has no reading: it ends after the line of column names, but rows must follow, one a reading"
            ));
        }
        let summary = skips.summary()?;
        let most = skips.are_most();
        most.then(|| format!("most of the log cannot be used: {summary}"))
    }
}

/// Refuses a folder in place of a log: to open it works, and only to read it would fail.
///
/// # Errors
///
/// When a folder was found.
pub fn refuse_folder(found: &Metadata) -> io::Result<()> {
    if found.is_dir() {
        return Err(ErrorKind::IsADirectory.into());
    }
    Ok(())
}

/// Opens a log. Opening a named pipe blocks until a writer opens it, so a thread does that, with a timeout.
fn open(path: &Path) -> io::Result<File> {
    if path == Path::new("-") {
        return Ok(io::stdin().as_fd().try_clone_to_owned()?.into());
    }
    let found = fs::metadata(path).map_err(|error| match error.kind() {
        ErrorKind::NotFound => io::Error::new(ErrorKind::NotFound, "there is no such file"),
        _ => error,
    })?;
    refuse_folder(&found)?;
    if !found.file_type().is_fifo() {
        return File::open(path);
    }
    let (sender, opened) = mpsc::channel();
    let pipe = path.to_owned();
    thread::Builder::new().spawn(move || {
        // An error means that the timeout has passed.
        let _ = sender.send(File::open(pipe));
    })?;
    opened.recv_timeout(PIPE_PATIENCE).unwrap_or_else(|_| {
        // Ends the thread's wait. An error means that it has ended by itself.
        let _ = File::options()
            .write(true)
            .custom_flags(libc::O_NONBLOCK)
            .open(path);
        let seconds = PIPE_PATIENCE.as_secs();
        let why = format!("it is a pipe that nobody has opened for writing within {seconds} s");
        Err(io::Error::new(ErrorKind::TimedOut, why))
    })
}
