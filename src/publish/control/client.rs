//! One client of the control socket: its lines are orders, and each gets an answer.

use std::time::Duration;

use tokio::io::{AsyncBufReadExt, AsyncReadExt, AsyncWriteExt, BufReader};
use tokio::net::UnixStream;
use tokio::sync::{mpsc, oneshot, watch};
use tokio::time::timeout;

use super::{Answer, Order, Request};
use crate::publish::client::ClientError;

/// Where the log is told of changes. `logging::repeats` knows it: however many there are, none is left out.
const CHANGES: &str = "headingd::publish::control::changes";

/// The longest request, bytes: a file of some hundred calibrations.
const LONGEST: usize = 256 * 1024;

/// A client of which no whole request comes for this long is let go: others want its place.
const IDLE: Duration = Duration::from_secs(10);

/// An answer takes longer only if a disk hangs.
const PATIENCE: Duration = Duration::from_secs(10);

/// How long a client may take nothing of its answer.
const WRITE_PATIENCE: Duration = Duration::from_secs(5);

/// Serves one client until it leaves, breaks, idles, or `stop` says that the server stops.
pub(super) async fn serve(
    stream: UnixStream,
    orders: mpsc::Sender<Order>,
    mut stop: watch::Receiver<bool>,
) -> Result<(), ClientError> {
    let peer = stream.peer_cred();
    let (pid, uid, gid) = match &peer {
        Ok(peer) => (peer.pid(), Some(peer.uid()), Some(peer.gid())),
        Err(_) => (None, None, None),
    };
    let (reader, mut writer) = stream.into_split();
    let mut reader = BufReader::new(reader);
    let mut line = Vec::new();
    loop {
        line.clear();
        // Room for the end of the line, and for one byte too many.
        let mut limited = (&mut reader).take(LONGEST as u64 + 2);
        let read = timeout(IDLE, limited.read_until(b'\n', &mut line));
        let count = tokio::select! {
            // An error means that the server is gone, which is a reason to stop as well.
            _ = stop.changed() => return Ok(()),
            read = read => read.ok().transpose()?,
        };
        if count == Some(0) {
            return Ok(());
        }
        let text = line.trim_ascii();
        let silent = count.is_none();
        let too_long = line.len() > LONGEST + 1;
        let answer = if silent {
            let message = format!(
                "no whole request has come for {} s: the connection is closed",
                IDLE.as_secs()
            );
            Answer::refused("timeout", message)
        } else if too_long {
            let message =
                format!("a request has at most {LONGEST} bytes: the connection is closed");
            Answer::refused("too_long", message)
        } else if text.is_empty() {
            continue;
        } else {
            match Request::parse(text) {
                Ok(request) => {
                    let (changes, words) = (request.changes(), request.to_string());
                    let answer = carry_out(request, &orders).await;
                    let (code, message) = (answer.code, &answer.message);
                    if changes {
                        tracing::info!(target: CHANGES, pid, uid, gid, code, "asked for {words}: {message}");
                    } else {
                        tracing::debug!(pid, uid, gid, code, "asked for {words}");
                    }
                    answer
                }
                Err(answer) => {
                    let (code, message) = (answer.code, &answer.message);
                    tracing::info!(pid, uid, gid, code, "a request was refused: {message}");
                    answer
                }
            }
        };
        timeout(WRITE_PATIENCE, writer.write_all(answer.line().as_bytes()))
            .await
            .map_err(|_| ClientError::TooSlow(WRITE_PATIENCE))??;
        if silent || too_long {
            return Ok(());
        }
    }
}

async fn carry_out(request: Request, orders: &mpsc::Sender<Order>) -> Answer {
    let (sender, answer) = oneshot::channel();
    let order = Order {
        request,
        answer: sender,
    };
    let ending = || Answer::refused("stopping", "the daemon is about to stop");
    if orders.send(order).await.is_err() {
        return ending();
    }
    match timeout(PATIENCE, answer).await {
        Ok(answer) => answer.unwrap_or_else(|_| ending()),
        Err(_) => Answer::refused(
            "timeout",
            "it is in force, but the disk hangs: whether it is kept will show in headingd status",
        ),
    }
}
