//! One client of the control socket: its lines are requests, and each gets an answer.

use std::io;
use std::time::{Duration, Instant};

use tokio::io::{AsyncBufReadExt, AsyncReadExt, AsyncWriteExt, BufReader};
use tokio::net::UnixStream;
use tokio::net::unix::{OwnedReadHalf, UCred};
use tokio::sync::{mpsc, oneshot, watch};
use tokio::time::{sleep, timeout, timeout_at};

use super::{Answer, ControlCall, ControlRequest};
use crate::logging::CHANGES;
use crate::publish::allowance::{ANSWER, Allowance, ERROR, bytes};
use crate::publish::client::ClientError;

/// The longest request, bytes: a file of some hundred calibrations.
const LONGEST: usize = 256 * 1024;

/// Idle timeout: a client that completes no request in this time is disconnected, which frees its place.
const IDLE: Duration = Duration::from_secs(10);

/// An answer takes longer only if a disk hangs.
const PATIENCE: Duration = Duration::from_secs(10);

/// How long a client may take nothing of its answer.
const WRITE_PATIENCE: Duration = Duration::from_secs(5);

/// Serves one client until it leaves, breaks, is idle for too long, or `stop` says that the server stops.
pub(super) async fn serve(
    stream: UnixStream,
    requests: mpsc::Sender<ControlCall>,
    mut stop: watch::Receiver<bool>,
) -> Result<(), ClientError> {
    let peer = stream.peer_cred()?;
    let (reader, mut writer) = stream.into_split();
    let mut reader = BufReader::new(reader);
    let mut line = Vec::new();
    let mut allowance = Allowance::new(Instant::now());
    let mut deadline = tokio::time::Instant::now() + IDLE;
    loop {
        let pause = allowance.pause(Instant::now());
        let count = tokio::select! {
            // An error means that the server is gone, which is a reason to stop as well.
            _ = stop.changed() => return Ok(()),
            read = read_line(&mut reader, &mut line, pause, deadline) => read?,
        };
        if count == Some(0) {
            return Ok(());
        }
        allowance.spend(Instant::now(), bytes(line.len()));
        let text = line.trim_ascii();
        let farewell = farewell(&line, count.is_none());
        let is_last = farewell.is_some();
        let answer = match farewell {
            Some(farewell) => farewell,
            None if text.is_empty() => {
                // An empty line does not extend the deadline.
                allowance.spend(Instant::now(), ANSWER);
                continue;
            }
            None => answer(text, &peer, &mut allowance, &requests).await,
        };
        timeout(WRITE_PATIENCE, writer.write_all(answer.line().as_bytes()))
            .await
            .map_err(|_| ClientError::Unread(WRITE_PATIENCE))??;
        if is_last {
            return Ok(());
        }
        deadline = tokio::time::Instant::now() + IDLE;
    }
}

/// Reads a line after this pause; how many bytes it has, or `None` if it is not there by the deadline.
async fn read_line(
    reader: &mut BufReader<OwnedReadHalf>,
    line: &mut Vec<u8>,
    pause: Option<Duration>,
    deadline: tokio::time::Instant,
) -> io::Result<Option<usize>> {
    line.clear();
    if let Some(pause) = pause {
        sleep(pause).await;
    }
    // Room for the end of the line, or for a byte too many.
    let mut limited = reader.take(LONGEST as u64 + 2);
    let read = timeout_at(deadline, limited.read_until(b'\n', line));
    read.await.ok().transpose()
}

/// The last answer, to a client that is to be let go.
fn farewell(line: &[u8], silent: bool) -> Option<Answer> {
    let without_end = line.strip_suffix(b"\r\n").or(line.strip_suffix(b"\n"));
    if silent {
        let message = format!(
            "no whole request has come for {} s: the connection is closed",
            IDLE.as_secs()
        );
        Some(Answer::refused("timeout", message))
    } else if without_end.unwrap_or(line).len() > LONGEST {
        let message = format!("a request has at most {LONGEST} bytes: the connection is closed");
        Some(Answer::refused("too_long", message))
    } else {
        None
    }
}

/// Answers a request, and logs who asked.
async fn answer(
    text: &[u8],
    peer: &UCred,
    allowance: &mut Allowance,
    requests: &mpsc::Sender<ControlCall>,
) -> Answer {
    let (pid, uid, gid) = (peer.pid(), peer.uid(), peer.gid());
    match ControlRequest::parse(text) {
        Ok(request) => {
            let (changes, words) = (request.changes(), request.to_string());
            allowance.spend(Instant::now(), ANSWER);
            let answer = carry_out(request, requests).await;
            let (code, message) = (answer.code, &answer.message);
            if changes {
                tracing::info!(target: CHANGES, pid, uid, gid, code, "asked for {words}: {message}");
            } else {
                tracing::debug!(pid, uid, gid, code, "asked for {words}");
            }
            answer
        }
        Err(answer) => {
            allowance.spend(Instant::now(), ERROR);
            let (code, message) = (answer.code, &answer.message);
            tracing::info!(pid, uid, gid, code, "a request was refused: {message}");
            answer
        }
    }
}

async fn carry_out(request: ControlRequest, requests: &mpsc::Sender<ControlCall>) -> Answer {
    let (sender, answer) = oneshot::channel();
    let call = ControlCall {
        request,
        answer: sender,
    };
    let ending = || Answer::refused("stopping", "the daemon is about to stop");
    if requests.send(call).await.is_err() {
        return ending();
    }
    match timeout(PATIENCE, answer).await {
        Ok(answer) => answer.unwrap_or_else(|_| ending()),
        // Asking again could change more: a second rollback goes one further back.
        Err(_) => Answer::refused(
            "not_kept",
            format!(
                "the change is in effect, but the disk has not answered for {} s: headingd status shows whether it is saved",
                PATIENCE.as_secs()
            ),
        ),
    }
}
