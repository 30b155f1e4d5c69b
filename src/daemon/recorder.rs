//! Writes raw readings into logs, on a thread of its own: a slow or full disk delays no heading.

use std::cell::Cell;
use std::fs::{self, File};
use std::io::{self, BufWriter, ErrorKind};
use std::os::fd::AsFd;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::time::{Duration, Instant};

use tokio::sync::oneshot;

use super::thread::Thread;
use super::{DaemonError, ring};
use crate::config::record::Settings;
use crate::date;
use crate::reading::Reading;
use crate::recording::{Entry, Header, RECORDED_FROM, Writer};
use crate::wall_clock;

/// Readings that may wait for the disk: some ten seconds of them.
const QUEUE: usize = 4096;
/// Interval at which readings are handed to the system, which writes them to disk: a daemon that is killed loses no more.
const FLUSH: Duration = Duration::from_secs(1);
/// Pause before a ring tries again what has failed.
const RETRY: Duration = Duration::from_secs(5);

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

enum Destination {
    /// Into one file; `-` is standard output.
    File(PathBuf),
    /// Into a ring of files.
    Ring(Ring),
}

struct Ring {
    settings: Settings,
    /// Recording has failed, and has been complained of.
    failing: Cell<bool>,
}

impl Ring {
    /// Whether a full disk has more room now, at the cost of the ring's oldest file.
    fn makes_room(&self) -> bool {
        match ring::remove_oldest(&self.settings.directory) {
            Ok(Some(oldest)) => {
                tracing::info!(
                    "the disk is full: removed the oldest log {}",
                    oldest.display()
                );
                true
            }
            Ok(None) | Err(_) => false,
        }
    }
}

pub(super) struct Recorder {
    queue: Option<SyncSender<Reading>>,
    thread: Thread,
    dropped: u64,
}

/// Ready when the recording has ended: how many readings are in it, and how it ended.
pub(super) type Ending = oneshot::Receiver<(u64, Result<(), RecordError>)>;

impl Recorder {
    /// Starts to record into one file. What becomes of it comes out of the second value.
    pub(super) fn file(path: &Path, header: Header) -> Result<(Self, Ending), DaemonError> {
        let (sender, ending) = oneshot::channel();
        let file = Destination::File(path.to_owned());
        let work = move |readings: &Receiver<Reading>| {
            let mut written = 0;
            let end = match record(&file, &header, readings, &mut written) {
                // The reader has closed the pipe: `| head`.
                Err(error) if error.source.kind() == ErrorKind::BrokenPipe => Ok(()),
                end => end,
            };
            // Nobody may want to know.
            let _ = sender.send((written, end));
        };
        Ok((Self::start(work)?, ending))
    }

    /// Starts a thread that does this with the readings.
    fn start(work: impl FnOnce(&Receiver<Reading>) + Send + 'static) -> Result<Self, DaemonError> {
        let (queue, readings) = sync_channel(QUEUE);
        let thread = Thread::start("recorder", move || work(&readings))?;
        Ok(Self {
            queue: Some(queue),
            thread,
            dropped: 0,
        })
    }

    /// Starts to record into a ring of files, if the settings say so.
    pub(super) fn ring(settings: &Settings, header: Header) -> Result<Option<Self>, DaemonError> {
        if settings.directory.as_os_str().is_empty() {
            return Ok(None);
        }
        let ring = Destination::Ring(Ring {
            settings: settings.clone(),
            failing: Cell::new(false),
        });
        let work = move |readings: &Receiver<Reading>| {
            // A failure has been logged: a ring goes on after it.
            let _ = record(&ring, &header, readings, &mut 0);
        };
        Self::start(work).map(Some)
    }

    /// Records a reading, if there is room for it. Never waits.
    pub(super) fn take(&mut self, reading: Reading) {
        let Some(queue) = &self.queue else { return };
        match queue.try_send(reading) {
            Ok(()) => {}
            Err(TrySendError::Full(_)) => {
                if self.dropped == 0 {
                    tracing::warn!(
                        "the disk is too slow for the recording: readings are left out of it"
                    );
                }
                self.dropped += 1;
            }
            // It has ended, and has said why.
            Err(TrySendError::Disconnected(_)) => self.queue = None,
        }
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

struct OpenLog {
    path: PathBuf,
    writer: Writer<BufWriter<File>>,
}

impl Destination {
    fn open(&self) -> Result<(PathBuf, File), RecordError> {
        Ok(match self {
            Self::File(path) if path == Path::new("-") => {
                let path = PathBuf::from("standard output");
                let descriptor = io::stdout().as_fd().try_clone_to_owned();
                let file = descriptor.map_err(RecordError::of(true, &path))?.into();
                (path, file)
            }
            Self::File(path) => {
                // Whoever reads the log that was there, as a daemon that replays it, reads on.
                if fs::symlink_metadata(path).is_ok_and(|found| found.is_file()) {
                    let _ = fs::remove_file(path);
                }
                let file = File::create(path).map_err(RecordError::of(true, path))?;
                (path.clone(), file)
            }
            Self::Ring(Ring { settings, .. }) => ring::next(&settings.directory, settings.files)
                .map_err(RecordError::of(true, &settings.directory))?,
        })
    }

    fn most_bytes(&self) -> u64 {
        match self {
            Self::File(_) => u64::MAX,
            Self::Ring(ring) => ring.settings.file_mib << 20,
        }
    }

    /// Attempts this; for a ring, retries until it succeeds. A full disk costs the ring's oldest files; where that does not help, readings
    /// are discarded meanwhile.
    fn retrying<T>(
        &self,
        readings: &Receiver<Reading>,
        mut attempt: impl FnMut() -> Result<T, RecordError>,
    ) -> Result<T, RecordError> {
        loop {
            let (error, ring) = match (attempt(), self) {
                (Err(error), Self::Ring(ring)) => (error, ring),
                (done, _) => return done,
            };
            let full = [ErrorKind::StorageFull, ErrorKind::QuotaExceeded];
            if full.contains(&error.source.kind()) && ring.makes_room() {
                continue;
            }
            if !ring.failing.replace(true) {
                tracing::error!(
                    "{error}; until then nothing is recorded, and headings go on: make room on the disk, or see \
                     to record.directory"
                );
            }
            if !discard(readings, RETRY) {
                return Err(error);
            }
        }
    }

    /// What was recorded is on the disk.
    fn recorded(&self) {
        if let Self::Ring(ring) = self
            && ring.failing.take()
        {
            tracing::info!("recording again");
        }
    }
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

impl OpenLog {
    /// Writes the header, with the present time unless it has that of a replayed log.
    fn begin(path: PathBuf, file: File, header: &Header) -> Result<Self, RecordError> {
        let mut header = header.clone();
        if !header.truth.iter().any(|(key, _)| key == RECORDED_FROM)
            && let Some(time) = wall_clock::now().map(date::rfc3339)
        {
            header.truth.push((RECORDED_FROM.to_owned(), time));
        }
        let writer =
            Writer::new(BufWriter::new(file), &header).map_err(RecordError::of(true, &path))?;
        Ok(Self { path, writer })
    }

    /// Writes readings until there are no more, or the file has its full size; whether it has.
    fn fill(
        &mut self,
        target: &Destination,
        first: Reading,
        readings: &Receiver<Reading>,
        written: &mut u64,
    ) -> Result<bool, RecordError> {
        let mut bytes = 0;
        let mut next = Ok(first);
        let mut flushed = Instant::now();
        loop {
            match next {
                Ok(reading) => {
                    let entry = Entry {
                        reading,
                        heading_truth_rad: None,
                    };
                    // A row that cannot be written is not buffered either, so that it can be written again.
                    bytes += target.retrying(readings, || self.write(&entry))?;
                    *written += 1;
                }
                Err(RecvTimeoutError::Timeout) => {
                    target.retrying(readings, || self.flush())?;
                    target.recorded();
                    flushed = Instant::now();
                }
                Err(RecvTimeoutError::Disconnected) => return Ok(false),
            }
            if bytes >= target.most_bytes() {
                return Ok(true);
            }
            next = readings.recv_timeout(FLUSH.saturating_sub(flushed.elapsed()));
        }
    }

    fn write(&mut self, entry: &Entry) -> Result<u64, RecordError> {
        let length = self.writer.write(entry);
        Ok(length.map_err(RecordError::of(false, &self.path))? as u64)
    }

    fn flush(&mut self) -> Result<(), RecordError> {
        let flushed = self.writer.flush();
        flushed.map_err(RecordError::of(false, &self.path))
    }
}

fn record(
    target: &Destination,
    header: &Header,
    readings: &Receiver<Reading>,
    written: &mut u64,
) -> Result<(), RecordError> {
    // A named file is opened at once, so that an error is reported at once. A ring opens its next file, and removes the oldest, only
    // when there is a reading to write: a daemon that restarts again and again without one must not remove the logs that show why.
    let mut opened = match target {
        Destination::File(_) => Some(target.open()?),
        Destination::Ring(_) => None,
    };
    loop {
        // The header contains the time of the first reading, so it is written only when that has come.
        let first = readings.recv();
        let (path, file) = match opened.take() {
            Some(opened) => opened,
            None if first.is_err() => return Ok(()),
            None => target.retrying(readings, || target.open())?,
        };
        if *written == 0 && matches!(target, Destination::Ring(_)) {
            tracing::info!("recording into {}", path.display());
        }
        let mut log = OpenLog::begin(path, file, header)?;
        let full = match first {
            Ok(first) => log.fill(target, first, readings, written)?,
            Err(_) => false,
        };
        target.retrying(readings, || log.flush())?;
        target.recorded();
        if !full {
            return Ok(());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_disk_costs_the_oldest_logs_of_a_ring_but_not_the_newest() {
        let folder = tempfile::tempdir().unwrap();
        for _ in 0..3 {
            ring::next(folder.path(), 3).unwrap();
        }
        let target = Destination::Ring(Ring {
            settings: Settings {
                directory: folder.path().to_owned(),
                ..Settings::default()
            },
            failing: Cell::new(false),
        });
        let attempt = |left: usize| {
            let (sender, readings) = sync_channel(1);
            // The daemon ends: a pause is not waited for.
            drop(sender);
            target.retrying(&readings, || {
                match fs::read_dir(folder.path()).unwrap().count() > left {
                    true => Err(RecordError::of(false, folder.path())(
                        ErrorKind::StorageFull.into(),
                    )),
                    false => Ok(()),
                }
            })
        };
        assert!(attempt(2).is_ok() && attempt(1).is_ok());
        assert!(folder.path().join("record-000003.csv").exists());
        assert!(attempt(0).is_err());
        assert!(folder.path().join("record-000003.csv").exists());
    }

    #[test]
    fn a_log_that_is_replaced_is_read_to_its_end() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log.csv");
        fs::write(&path, "old").unwrap();
        let reader = File::open(&path).unwrap();
        Destination::File(path.clone()).open().unwrap();
        assert_eq!(io::read_to_string(reader).unwrap(), "old");
        assert_eq!(fs::read(path).unwrap(), b"");
    }
}
