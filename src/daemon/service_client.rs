//! A client of a running service: the raw readings of a source that another process has.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::Duration;

use tokio::io::{AsyncBufReadExt, AsyncReadExt, AsyncWriteExt, BufReader};
use tokio::net::UnixStream;
use tokio::time::timeout;

use super::recorder::Recorder;
use crate::publish::raw::{self, Object, Row};
use crate::recording::Header;

/// How long to wait for the service's answer.
const PATIENCE: Duration = Duration::from_secs(5);

/// No service sends a longer line, bytes. The longest is a header with all its remarks.
const LONGEST_LINE: u64 = 1 << 20;

/// Raw readings, and the condition, which tells why none come.
const REQUEST: &[u8] =
    b"?WATCH={\"enable\":true,\"json\":false,\"state\":true,\"readings\":true};\n";

/// Why a service's readings cannot be had, or not any longer.
#[derive(Debug, thiserror::Error)]
#[error("cannot record from the service at {}: {what}", socket.display())]
pub struct ListenError {
    socket: PathBuf,
    what: String,
    /// Whether anybody took the connection.
    pub(super) connected: bool,
}

impl ListenError {
    fn new(socket: &Path, what: String) -> Self {
        Self {
            socket: socket.to_owned(),
            what,
            connected: true,
        }
    }
}

/// A service that hands out its raw readings.
pub(super) struct ServiceClient {
    socket: PathBuf,
    stream: BufReader<UnixStream>,
    pub(super) header: Header,
    line: Vec<u8>,
    /// Number of the last reading.
    seq: Option<u64>,
    lost: u64,
    /// The fault of the source that was logged last.
    told: Option<String>,
}

impl ServiceClient {
    /// Asks the service at `socket` for its readings.
    pub(super) async fn connect(socket: &Path) -> Result<Self, ListenError> {
        let failed = |what| ListenError::new(socket, what);
        let broken = |error| failed(format!("the connection failed: {error}"));
        let mut stream = UnixStream::connect(socket)
            .await
            .map_err(|error| ListenError {
                connected: false,
                ..broken(error)
            })?;
        match stream.write_all(REQUEST).await {
            // It has hung up, and may have said why: a service that is full does.
            Err(error) if error.kind() == ErrorKind::BrokenPipe => {}
            written => written.map_err(broken)?,
        }
        let mut client = Self::on(socket, stream);
        let answer = timeout(PATIENCE, client.listen_for_header());
        let late = |_| failed(format!("it has not answered within {PATIENCE:?}"));
        client.header = answer.await.map_err(late)??;
        Ok(client)
    }

    fn on(socket: &Path, stream: UnixStream) -> Self {
        Self {
            socket: socket.to_owned(),
            stream: BufReader::new(stream),
            header: Header::default(),
            line: Vec::new(),
            seq: None,
            lost: 0,
            told: None,
        }
    }

    /// Records readings until the service hangs up, at the end of its source or its own, or reads another board.
    pub(super) async fn record(&mut self, recorder: &mut Recorder) -> Result<(), ListenError> {
        loop {
            match self.next().await? {
                None => {
                    tracing::info!(
                        "the service at {} has hung up: the recording ends",
                        self.socket.display()
                    );
                    return Ok(());
                }
                Some(Object::Reading(row)) => {
                    self.count(&row);
                    recorder.take(row.reading());
                }
                Some(Object::State { cal_state, message }) => self.tell(&cal_state, message),
                Some(Object::Board { .. }) => {
                    tracing::warn!(
                        "the service at {} reads another board now: the recording ends, start another one",
                        self.socket.display()
                    );
                    return Ok(());
                }
                Some(_) => {}
            }
        }
    }

    /// Logs how many readings were lost, if any.
    pub(super) fn conclude(&self) {
        if self.lost > 0 {
            tracing::warn!(
                readings = self.lost,
                "readings of the service were lost on the way into the recording"
            );
        }
    }

    fn count(&mut self, row: &Row) {
        // The service is not trusted: it may send any number.
        let lost = match self.seq {
            Some(last) => row.seq.saturating_sub(last.saturating_add(1)),
            None => 0,
        };
        if lost > 0 && self.lost == 0 {
            tracing::warn!(
                t_s = row.reading().t_s,
                "this recording is too slow for the service: readings are lost on the way into it"
            );
        }
        self.lost = self.lost.saturating_add(lost);
        self.seq = Some(row.seq);
    }

    /// Logs a fault of the source once, and its end.
    fn tell(&mut self, cal_state: &str, message: String) {
        let trouble = (cal_state == "fault").then_some(message);
        if trouble == self.told {
            return;
        }
        match &trouble {
            Some(message) => tracing::warn!("{message}"),
            None => tracing::info!("there are readings again"),
        }
        self.told = trouble;
    }

    async fn listen_for_header(&mut self) -> Result<Header, ListenError> {
        loop {
            let what = match self.next().await? {
                Some(Object::Board { header }) => match raw::header(&header) {
                    Ok(header) => return Ok(header),
                    Err(error) => error.to_string(),
                },
                Some(Object::Error { message }) => format!("it says: {message}"),
                Some(_) => continue,
                None => "it has hung up".to_owned(),
            };
            return Err(ListenError::new(&self.socket, what));
        }
    }

    async fn next(&mut self) -> Result<Option<Object>, ListenError> {
        self.line.clear();
        let read = (&mut self.stream)
            .take(LONGEST_LINE)
            .read_until(b'\n', &mut self.line)
            .await;
        let what = match read {
            Ok(0) => return Ok(None),
            Ok(_) if self.line.ends_with(b"\n") => match serde_json::from_slice(&self.line) {
                Ok(object) => return Ok(Some(object)),
                Err(error) => format!(
                    "it sends what headingd does not: {error}, in {}",
                    crate::recording::shown(&self.line)
                ),
            },
            Ok(_) => "the connection was cut within a line".to_owned(),
            Err(error) => format!("the connection broke: {error}"),
        };
        Err(ListenError::new(&self.socket, what))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn no_numbers_of_a_service_make_the_count_overflow() {
        let (stream, _service) = UnixStream::pair().unwrap();
        let mut client = ServiceClient::on(Path::new("s"), stream);
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
            client.count(&row);
            assert_eq!(client.lost, lost, "{seq}");
        }
    }
}
