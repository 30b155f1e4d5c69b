//! Recording into one log: the readings of a running service, or of a daemon of its own.

use std::future::Future;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::Duration;

use tempfile::TempDir;
use tokio::sync::mpsc;
use tokio::time::timeout;

use super::recorder::{RecordError, Recorder};
use super::source_task::SourceTask;
use super::{Daemon, DaemonError};
use crate::config::source::Kind;
use crate::config::{Config, record};
use crate::publish::raw::Row;
use crate::publish::server::BindFault;
use crate::recording::Header;
use crate::service::Service;

/// At the end a disk that hangs is waited for this long.
const PATIENCE: Duration = Duration::from_secs(1);

pub struct Recording {
    /// Where the readings come from, for people.
    pub from: String,
    header: Header,
    origin: ReadingsFrom,
    /// Holds the socket if it cannot be where it is configured. Dropping it removes the folder.
    _folder: Option<TempDir>,
}

impl Recording {
    /// Of the readings that the service at `socket` hands out, until `rows` is at its end.
    pub fn of_service(socket: &Path, header: Header, rows: mpsc::Receiver<Row>) -> Self {
        Self {
            from: format!("the service at {}", socket.display()),
            header,
            origin: ReadingsFrom::Service(rows),
            _folder: None,
        }
    }

    /// Of the configuration's source. Serves headings as the daemon does; if the configured socket cannot be bound, on one in a
    /// temporary folder. Needs a runtime.
    pub fn open(config: &Config) -> Result<Self, DaemonError> {
        // One recording is enough. It needs no calibrations, and the store belongs to the service.
        let mut config = Config {
            record: record::Settings::default(),
            ..config.clone()
        };
        config.store.directory = PathBuf::new();
        let source = SourceTask::open(&config)?;
        let mut sockets = Service::default();
        let mut folder = None;
        let server = match super::bind(&config, &mut sockets, &source) {
            // A service is there, or may be: two readers of the same chips would disturb each other.
            Err(error) if matches!(error.why, BindFault::Busy(_) | BindFault::Unsure(_)) => {
                return Err(error.into());
            }
            Err(error) => {
                let Ok(made) = tempfile::Builder::new().prefix("headingd-").tempdir() else {
                    return Err(error.into());
                };
                tracing::warn!("{error}; recording with a socket in a temporary folder");
                config.socket.socket = made.path().join("heading.sock");
                config.control.socket = PathBuf::new();
                folder = Some(made);
                super::bind(&config, &mut sockets, &source)?
            }
            Ok(server) => server,
        };
        // A recording needs no control socket, and another daemon may have it.
        let control = super::control(&config, &mut sockets).unwrap_or_else(|error| {
            tracing::warn!("recording without a control socket: {error}");
            None
        });
        let from = match config.source.kind {
            Some(Kind::Simulator) => "a simulated board".to_owned(),
            Some(Kind::Replay) => format!("the log {}", source.name),
            _ => source.name.clone(),
        };
        let header = source.header.clone();
        let daemon = Daemon::serving_on(source, server, control, &config, sockets)?;
        Ok(Self {
            from,
            header,
            origin: ReadingsFrom::Daemon(Box::new(daemon)),
            _folder: folder,
        })
    }

    /// Records into one log until the readings are at their end, the log cannot be written, or `shutdown` is ready; calls
    /// `begun` with the first reading. How many readings are in the log then, and how it ended.
    pub async fn run(
        self,
        out: &Path,
        begun: impl FnOnce() + Send + 'static,
        shutdown: impl Future<Output = ()>,
    ) -> (u64, Result<(), DaemonError>) {
        let (mut recorder, mut ending) = match Recorder::file(out, self.header) {
            Ok(started) => started,
            Err(error) => return (0, Err(error)),
        };
        recorder.begun = Some(Box::new(begun));
        let mut early = None;
        let stop = async {
            tokio::select! {
                () = shutdown => {}
                end = &mut ending => early = Some(end),
            }
        };
        let heard = match self.origin {
            ReadingsFrom::Daemon(mut daemon) => {
                daemon.session.recorder = Some(recorder);
                daemon.run_until(stop).await
            }
            ReadingsFrom::Service(rows) => {
                from_service(rows, recorder, stop).await;
                Ok(())
            }
        };
        let end = match early {
            Some(end) => end,
            None => timeout(PATIENCE, ending).await.unwrap_or_else(|_| {
                let hangs = RecordError::of(false, out)(ErrorKind::TimedOut.into());
                Ok((0, Err(hangs)))
            }),
        };
        // An error means that the thread panicked, which has been logged.
        let (written, end) = end.unwrap_or((0, Ok(())));
        (written, end.map_err(DaemonError::Record).and(heard))
    }
}

enum ReadingsFrom {
    Daemon(Box<Daemon>),
    Service(mpsc::Receiver<Row>),
}

async fn from_service(
    mut rows: mpsc::Receiver<Row>,
    mut recorder: Recorder,
    shutdown: impl Future<Output = ()>,
) {
    let mut losses = Losses::default();
    let record = async {
        while let Some(row) = rows.recv().await {
            losses.count(&row);
            recorder.take(row.reading());
        }
    };
    tokio::select! {
        () = shutdown => {}
        () = record => {}
    }
    if losses.total > 0 {
        tracing::warn!(
            readings = losses.total,
            "readings of the service were lost on the way into the recording"
        );
    }
    recorder.close(PATIENCE).await;
}

/// Counts the readings that are lost on the way from the service.
#[derive(Default)]
struct Losses {
    /// Number of the last reading.
    seq: Option<u64>,
    total: u64,
}

impl Losses {
    fn count(&mut self, row: &Row) {
        // The service is not trusted: it may send any number.
        let lost = match self.seq {
            Some(last) => row.seq.saturating_sub(last.saturating_add(1)),
            None => 0,
        };
        if lost > 0 && self.total == 0 {
            tracing::warn!(
                t_s = row.reading().t_s,
                "this recording is too slow for the service: readings are lost on the way into it"
            );
        }
        self.total = self.total.saturating_add(lost);
        self.seq = Some(row.seq);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_numbers_of_a_service_make_the_count_overflow() {
        let mut losses = Losses::default();
        for (seq, lost) in [
            (u64::MAX, 0),
            (0, 0),
            (5, 4),
            (u64::MAX, u64::MAX - 2),
            (u64::MAX, u64::MAX - 2),
            (1, u64::MAX - 2),
            (u64::MAX, u64::MAX),
        ] {
            let mut row = Row::default();
            row.seq = seq;
            losses.count(&row);
            assert_eq!(losses.total, lost, "{seq}");
        }
    }
}
