//! A recorded log as a source of readings. The caller decides how fast to play them.

use std::fs::{self, File, Metadata};
use std::io::{self, BufReader, ErrorKind, Seek};
use std::os::fd::AsFd;
use std::os::unix::fs::{FileTypeExt, OpenOptionsExt};
use std::path::Path;
use std::sync::mpsc;
use std::thread;
use std::time::Duration;

use crate::recording::{Entry, Header, Reader, RecordingError, Skips};

/// Longest wait for somebody to open a named pipe for writing.
const PIPE_PATIENCE: Duration = Duration::from_secs(5);

/// An open log: an iterator of its good rows that counts the bad ones.
#[derive(Debug)]
pub struct Replay {
    /// The open file that the reader reads, for its position.
    file: File,
    bytes: u64,
    reader: Reader<BufReader<File>>,
}

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
        let file = open(path).map_err(failed)?;
        let mut shared = file.try_clone().map_err(failed)?;
        let found = file.metadata().map_err(failed)?;
        if found.is_file() {
            Reader::new(log.clone(), BufReader::new(&file))?.check_times()?;
            shared.rewind().map_err(failed)?;
        }
        Ok(Self {
            file: shared,
            bytes: found.len(),
            reader: Reader::new(log, BufReader::new(file))?,
        })
    }

    /// The log's name in messages.
    pub fn name(&self) -> &str {
        &self.reader.log
    }

    /// The log's header.
    pub fn header(&self) -> &Header {
        self.reader.header()
    }

    /// How much of the file has been read, 0 to 1; 0 where that is not known, as of a pipe.
    pub fn share_read(&self) -> f64 {
        let position = (&self.file).stream_position().unwrap_or(0);
        (position as f64 / self.bytes.max(1) as f64).min(1.0)
    }

    /// Whether a new stretch begins with the last entry: what was known of the motion is over.
    pub fn begins_stretch(&self) -> bool {
        self.reader.begins_stretch()
    }

    /// The rows skipped so far.
    pub fn skips(&self) -> &Skips {
        &self.reader.skips
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

impl Iterator for Replay {
    type Item = Result<Entry, RecordingError>;

    fn next(&mut self) -> Option<Self::Item> {
        self.reader.next()
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

/// Opens a log. A pipe may be one, but the system would wait for ever for somebody to write to it.
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
        // An error means that it is not waited for any more.
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
