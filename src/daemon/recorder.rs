//! Writes raw readings into logs, on a thread of its own: a slow or full disk delays no heading.

use std::fs::File;
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
    Ring(Settings),
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
        let recorder = Self::start(
            Destination::File(path.to_owned()),
            header,
            |written, end| {
                // Nobody may want to know.
                let _ = sender.send((written, end));
            },
        )?;
        Ok((recorder, ending))
    }

    fn start(
        target: Destination,
        header: Header,
        ended: impl FnOnce(u64, Result<(), RecordError>) + Send + 'static,
    ) -> Result<Self, DaemonError> {
        let (queue, readings) = sync_channel(QUEUE);
        let thread = Thread::start("recorder", move || {
            let mut written = 0;
            let end = match record(&target, &header, &readings, &mut written) {
                // The reader has closed the pipe: `| head`.
                Err(error) if error.source.kind() == ErrorKind::BrokenPipe => Ok(()),
                end => end,
            };
            ended(written, end);
        })?;
        Ok(Self {
            queue: Some(queue),
            thread,
            dropped: 0,
        })
    }

    /// Starts to record into a ring of files, if the settings say so. A failure is logged once.
    pub(super) fn ring(settings: &Settings, header: Header) -> Result<Option<Self>, DaemonError> {
        if settings.directory.as_os_str().is_empty() {
            return Ok(None);
        }
        let ended = |_, end| {
            if let Err(error) = end {
                tracing::error!(
                    "{error}; nothing is recorded any more, headings go on: see to the disk and record.directory, \
                     and start again"
                );
            }
        };
        Self::start(Destination::Ring(settings.clone()), header, ended).map(Some)
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
                let file = File::create(path).map_err(RecordError::of(true, path))?;
                (path.clone(), file)
            }
            Self::Ring(ring) => ring::next(&ring.directory, ring.files)
                .map_err(RecordError::of(true, &ring.directory))?,
        })
    }

    fn most_bytes(&self) -> u64 {
        match self {
            Self::File(_) => u64::MAX,
            Self::Ring(ring) => ring.file_mib << 20,
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
        first: Reading,
        readings: &Receiver<Reading>,
        most_bytes: u64,
        written: &mut u64,
    ) -> Result<bool, RecordError> {
        let mut bytes = 0;
        let mut next = Ok(first);
        let mut flushed = Instant::now();
        loop {
            let done = match next {
                Ok(reading) => {
                    let entry = Entry {
                        reading,
                        heading_truth_rad: None,
                    };
                    self.writer.write(&entry).map(|length| {
                        *written += 1;
                        bytes += length as u64;
                    })
                }
                Err(RecvTimeoutError::Timeout) => {
                    flushed = Instant::now();
                    self.writer.flush()
                }
                Err(RecvTimeoutError::Disconnected) => return Ok(false),
            };
            done.map_err(RecordError::of(false, &self.path))?;
            if bytes >= most_bytes {
                return Ok(true);
            }
            next = readings.recv_timeout(FLUSH.saturating_sub(flushed.elapsed()));
        }
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
            None => target.open()?,
        };
        if *written == 0 && matches!(target, Destination::Ring(_)) {
            tracing::info!("recording into {}", path.display());
        }
        let mut log = OpenLog::begin(path, file, header)?;
        let full = match first {
            Ok(first) => log.fill(first, readings, target.most_bytes(), written)?,
            Err(_) => false,
        };
        let closed = log.writer.flush();
        closed.map_err(RecordError::of(false, &log.path))?;
        if !full {
            return Ok(());
        }
    }
}
