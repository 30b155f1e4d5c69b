//! Writes raw readings into logs, on a thread of its own: a slow or full disk delays no heading.

mod open_log;

use std::cell::OnceCell;
use std::fs::{self, File};
use std::io::{self, ErrorKind};
use std::os::fd::AsFd;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::time::{Duration, Instant};

use tempfile::tempfile_in;
use tokio::sync::oneshot;

use super::thread::{Shared, Thread, lock};
use super::{DaemonError, remedy, ring};
use crate::config::record::Settings;
use crate::lock_file::LockFile;
use crate::publish::control::status::FolderSummary;
use crate::reading::Reading;
use crate::recording::{Entry, Header};
use crate::wall_clock;
use open_log::OpenLog;

/// Readings that may wait for the disk: some ten seconds of them.
const QUEUE: usize = 4096;
/// Bytes of rows between two looks at how much room the disk has left.
const CHECKED_EVERY: u64 = 8192;
/// Interval at which readings are handed to the system, which writes them to disk: a daemon that is killed loses no more.
const FLUSH: Duration = Duration::from_secs(1);
/// This name of a log is standard output.
const STDOUT: &str = "-";
/// Pause before a ring retries. A log that has been removed meanwhile is then closed, which frees its room.
const RETRY: Duration = Duration::from_secs(1);

#[derive(Debug, thiserror::Error)]
#[error("cannot {} recording {}: {source}", if *at_start { "begin" } else { "go on with" }, path.display())]
pub struct RecordError {
    /// Not even the file could be made.
    pub at_start: bool,
    path: PathBuf,
    source: io::Error,
}

impl RecordError {
    /// Names the file of an attempt that failed: to begin with it, or to go on.
    pub(super) fn of(at_start: bool, path: &Path) -> impl Fn(io::Error) -> Self {
        move |source| Self {
            at_start,
            path: path.to_owned(),
            source,
        }
    }
}

/// Where the readings go.
enum Destination {
    /// Into one file, or [`STDOUT`].
    File(PathBuf),
    /// Into a ring of files.
    Ring(Settings),
}

pub(super) struct Recorder {
    queue: SyncSender<Reading>,
    thread: Thread,
    dropped: u64,
    /// The file, or the folder of the ring.
    place: PathBuf,
    fault: Shared<Option<String>>,
    /// Called with the first reading.
    pub(super) begun: Option<Box<dyn FnOnce() + Send>>,
}

/// Ready when the recording has ended: how many readings are in it, and how it ended.
pub(super) type Ending = oneshot::Receiver<(u64, Result<(), RecordError>)>;

impl Recorder {
    /// Starts to record into one file. What becomes of it comes out of the second value.
    pub(super) fn file(path: &Path, header: Header) -> Result<(Self, Ending), DaemonError> {
        let destination = Destination::File(path.to_owned());
        Self::start(destination, header)
    }

    /// Starts to record into a ring of files, if the settings say so.
    pub(super) fn ring(settings: &Settings, header: Header) -> Result<Option<Self>, DaemonError> {
        if settings.directory().is_none() {
            return Ok(None);
        }
        // A failure has been logged: a ring goes on after it.
        let (recorder, _) = Self::start(Destination::Ring(settings.clone()), header)?;
        Ok(Some(recorder))
    }

    fn start(destination: Destination, header: Header) -> Result<(Self, Ending), DaemonError> {
        let (queue, readings) = sync_channel(QUEUE);
        let (sender, ending) = oneshot::channel();
        let fault = Shared::default();
        let place = match &destination {
            Destination::File(path) if path == Path::new(STDOUT) => "standard output".into(),
            Destination::File(path) => path.clone(),
            Destination::Ring(settings) => settings.directory.clone(),
        };
        let mut work = RecorderThread {
            destination,
            header,
            readings,
            ring_lock: OnceCell::new(),
            written: 0,
            fault: Shared::clone(&fault),
        };
        let thread = Thread::start("recorder", move || {
            let end = match work.record() {
                // The reader has closed the pipe: `| head`.
                Err(error) if error.source.kind() == ErrorKind::BrokenPipe => Ok(()),
                end => end,
            };
            // Nobody may want to know.
            let _ = sender.send((work.written, end));
        })?;
        let recorder = Self {
            queue,
            thread,
            dropped: 0,
            place,
            fault,
            begun: None,
        };
        Ok((recorder, ending))
    }

    /// Records a reading, if there is room for it. Never waits.
    pub(super) fn take(&mut self, reading: Reading) {
        if let Some(begun) = self.begun.take() {
            begun();
        }
        // A recording that has ended has said why.
        if let Err(TrySendError::Full(_)) = self.queue.try_send(reading) {
            if self.dropped == 0 {
                tracing::warn!(
                    "{} is too slow for the recording: readings are left out of it",
                    self.place.display()
                );
            }
            self.dropped += 1;
        }
    }

    pub(super) fn summary(&self) -> FolderSummary {
        FolderSummary::of(&self.place, lock(&self.fault).clone())
    }

    /// Waits until everything is on disk, unless that takes longer than `patience`.
    pub(super) async fn close(self, patience: Duration) {
        drop(self.queue);
        self.thread.end(patience).await;
        if self.dropped > 0 {
            tracing::warn!(
                readings = self.dropped,
                "readings were left out of the recording"
            );
        }
    }
}

/// Writes the readings.
struct RecorderThread {
    destination: Destination,
    header: Header,
    readings: Receiver<Reading>,
    /// Keeps other daemons out of the ring.
    ring_lock: OnceCell<Arc<LockFile>>,
    /// How many readings are in the log.
    written: u64,
    /// Why nothing is recorded now; already logged.
    fault: Shared<Option<String>>,
}

impl RecorderThread {
    fn record(&mut self) -> Result<(), RecordError> {
        // A named file is opened at once, so that an error is reported at once. A log that is there is replaced, and a ring opens
        // its next file and removes the oldest, only when there is a reading to write, so a daemon that restarts again and again
        // without readings loses no log.
        let mut opened = match &self.destination {
            Destination::File(path) if path != Path::new(STDOUT) && path.is_file() => {
                may_replace(path).map_err(RecordError::of(true, path))?;
                None
            }
            Destination::File(_) => Some(self.open()?),
            Destination::Ring(_) => None,
        };
        loop {
            // The header contains the time of the first reading, so it is written only when that has come. A full disk may delay it.
            let first = self.readings.recv();
            let received = wall_clock::now();
            let (path, file) = match opened.take() {
                Some(opened) => opened,
                None if first.is_err() => return Ok(()),
                None => {
                    self.claim_ring()?;
                    self.leave_reserve(None)?;
                    self.retrying(|| self.open())?
                }
            };
            if self.written == 0 && matches!(self.destination, Destination::Ring(_)) {
                tracing::info!("recording into {}", path.display());
            }
            let mut log = OpenLog::begin(path, file, &self.header, received)?;
            let filled = match first {
                Ok(first) => self.fill(&mut log, first),
                Err(_) => Ok(false),
            };
            let ended = filled.and_then(|full| self.flush(&mut log).map(|()| !full));
            // The disk has the room of a removed log again only when that is closed.
            if self.has_lost(&log.path) {
                let log = log.path.display();
                tracing::info!("{log} has been removed: what follows goes into another file");
            } else if ended? {
                return Ok(());
            }
        }
    }

    fn open(&self) -> Result<(PathBuf, File), RecordError> {
        Ok(match &self.destination {
            Destination::File(path) if path == Path::new(STDOUT) => {
                let path = PathBuf::from("standard output");
                let descriptor = io::stdout().as_fd().try_clone_to_owned();
                let file = descriptor.map_err(RecordError::of(true, &path))?.into();
                (path, file)
            }
            Destination::File(path) => {
                // Removed, not truncated: a process that reads the old log can finish.
                if fs::symlink_metadata(path).is_ok_and(|found| found.is_file()) {
                    let _ = fs::remove_file(path);
                }
                let file = File::create(path).map_err(RecordError::of(true, path))?;
                (path.clone(), file)
            }
            Destination::Ring(settings) => {
                ring::next(&settings.directory, settings.files, settings.file_bytes())
                    .map_err(RecordError::of(true, &settings.directory))?
            }
        })
    }

    /// Makes the ring's folder and takes its lock, trying until that succeeds: another daemon's logs are not removed.
    fn claim_ring(&self) -> Result<(), RecordError> {
        let Destination::Ring(settings) = &self.destination else {
            return Ok(());
        };
        let folder = &settings.directory;
        let claim = || {
            fs::create_dir_all(folder)?;
            if self.ring_lock.get().is_none() {
                let _ = self.ring_lock.set(LockFile::of_folder(folder)?);
            }
            Ok(())
        };
        while let Err(error) = claim().map_err(RecordError::of(true, folder)) {
            if !self.pause(&error) {
                return Err(error);
            }
        }
        Ok(())
    }

    /// Whether somebody has removed this log of the ring. What cannot be found out is taken to be there.
    fn has_lost(&self, log: &Path) -> bool {
        matches!(self.destination, Destination::Ring(_)) && matches!(log.try_exists(), Ok(false))
    }

    /// Writes readings until there are no more (`false`), or until the ring needs another file (`true`): this one is full, or has been
    /// removed.
    fn fill(&mut self, log: &mut OpenLog, first: Reading) -> Result<bool, RecordError> {
        let most_bytes = match &self.destination {
            Destination::File(_) => u64::MAX,
            Destination::Ring(settings) => settings.file_bytes(),
        };
        let (mut bytes, mut checked_at) = (0, 0);
        let mut next = Ok(first);
        let mut flushed = Instant::now();
        loop {
            match next {
                Ok(reading) => {
                    if bytes >= checked_at {
                        self.leave_reserve(Some(&log.path))?;
                        checked_at = bytes + CHECKED_EVERY;
                    }
                    let entry = Entry {
                        reading,
                        heading_truth_deg: None,
                    };
                    // A row that cannot be written is not buffered either, so that it can be written again.
                    bytes += self.retrying(|| log.write(&entry))?;
                    self.written += 1;
                }
                Err(RecvTimeoutError::Timeout) => {
                    self.flush(log)?;
                    flushed = Instant::now();
                    if self.has_lost(&log.path) {
                        return Ok(true);
                    }
                }
                Err(RecvTimeoutError::Disconnected) => return Ok(false),
            }
            if bytes >= most_bytes {
                return Ok(true);
            }
            let pause = FLUSH.saturating_sub(flushed.elapsed());
            next = self.readings.recv_timeout(pause);
        }
    }

    fn flush(&self, log: &mut OpenLog) -> Result<(), RecordError> {
        self.retrying(|| log.flush())?;
        if lock(&self.fault).take().is_some() {
            tracing::info!("recording again");
        }
        Ok(())
    }

    /// Attempts this; for a ring, retries until it succeeds, or its log is gone. A full disk costs the ring's oldest files; where that
    /// does not help, readings are discarded meanwhile.
    fn retrying<T>(
        &self,
        mut attempt: impl FnMut() -> Result<T, RecordError>,
    ) -> Result<T, RecordError> {
        loop {
            let (error, ring) = match (attempt(), &self.destination) {
                (Err(error), Destination::Ring(settings)) => (error, &settings.directory),
                (done, _) => return done,
            };
            let full = remedy::is_full(&error.source) && !self.must_close(&error);
            let goes_on = full && ring::remove_oldest(ring) || self.pause(&error);
            if !goes_on {
                return Err(error);
            }
        }
    }

    /// Leaves the ring's reserve free: while the disk has less, the oldest logs are removed, or else nothing is recorded.
    fn leave_reserve(&self, log: Option<&Path>) -> Result<(), RecordError> {
        while let Destination::Ring(settings) = &self.destination
            && !ring::has_reserve(&settings.directory)
        {
            let place = log.unwrap_or(&settings.directory);
            let why = "the disk is nearly full, and calibrations may need what is left";
            let error =
                RecordError::of(log.is_none(), place)(io::Error::new(ErrorKind::StorageFull, why));
            let goes_on = ring::remove_oldest(&settings.directory) || self.pause(&error);
            if !goes_on {
                return Err(error);
            }
        }
        Ok(())
    }

    /// Complains of this error of a ring, and discards readings for a while. Returns whether it may be tried again.
    fn pause(&self, error: &RecordError) -> bool {
        if self.must_close(error) {
            return false;
        }
        let remedy = remedy::of_folder(&error.source, "record.directory");
        let message = format!("{error}; {remedy}");
        if lock(&self.fault).replace(message.clone()).is_none() {
            tracing::error!(
                "{message}; until that is done nothing is recorded, and headings go on"
            );
        }
        discard(&self.readings, RETRY)
    }

    /// Whether the log in which this failed is gone.
    fn must_close(&self, error: &RecordError) -> bool {
        !error.at_start && self.has_lost(&error.path)
    }
}

/// Fails if [`RecorderThread::open`] could not replace this file by a log. The file stays as it is.
fn may_replace(file: &Path) -> io::Result<()> {
    let Err(error) = File::options().write(true).open(file) else {
        return Ok(());
    };
    // A file of somebody else may be removed where a new one can be made.
    let folder = file.parent().filter(|folder| *folder != Path::new(""));
    tempfile_in(folder.unwrap_or(Path::new("."))).map_or(Err(error), |_| Ok(()))
}

/// Discards readings for this long. Returns whether more may come.
fn discard(readings: &Receiver<Reading>, time: Duration) -> bool {
    let begun = Instant::now();
    loop {
        match readings.recv_timeout(time.saturating_sub(begun.elapsed())) {
            Ok(_) => {}
            Err(RecvTimeoutError::Timeout) => return true,
            Err(RecvTimeoutError::Disconnected) => return false,
        }
    }
}

#[cfg(test)]
mod tests;
