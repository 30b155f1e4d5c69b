//! One client of the control socket: its lines are orders, and each gets an answer.

use std::time::{Duration, Instant};

use tokio::io::{AsyncBufReadExt, AsyncReadExt, AsyncWriteExt, BufReader};
use tokio::net::UnixStream;
use tokio::sync::{mpsc, oneshot, watch};
use tokio::time::{sleep, timeout, timeout_at};

use super::{Answer, ControlCall, ControlRequest};
use crate::publish::allowance::Allowance;
use crate::publish::client::ClientError;

/// Where the log is told of changes. `logging::repeats` knows it: however many there are, none is left out.
const CHANGES: &str = "headingd::publish::control::changes";

/// The longest request, bytes: a file of some hundred calibrations.
const LONGEST: usize = 256 * 1024;

/// A client of which no whole request comes for this long is let go: others want its place.
pub(super) const IDLE: Duration = Duration::from_secs(10);

/// An answer takes longer only if a disk hangs.
const PATIENCE: Duration = Duration::from_secs(10);

/// How long a client may take nothing of its answer.
const WRITE_PATIENCE: Duration = Duration::from_secs(5);

/// Serves one client until it leaves, breaks, is idle for this long, or `stop` says that the server stops.
pub(super) async fn serve(
    stream: UnixStream,
    orders: mpsc::Sender<ControlCall>,
    mut stop: watch::Receiver<bool>,
    idle: Duration,
) -> Result<(), ClientError> {
    let peer = stream.peer_cred();
    let (pid, uid, gid) = match &peer {
        Ok(peer) => (peer.pid(), Some(peer.uid()), Some(peer.gid())),
        Err(_) => (None, None, None),
    };
    let (reader, mut writer) = stream.into_split();
    let mut reader = BufReader::new(reader);
    let mut line = Vec::new();
    let mut allowance = Allowance::new(Instant::now());
    let mut deadline = tokio::time::Instant::now() + idle;
    loop {
        line.clear();
        let pause = allowance.pause(Instant::now());
        // Room for the end of the line, and for one byte too many.
        let mut limited = (&mut reader).take(LONGEST as u64 + 2);
        let read = async {
            if let Some(pause) = pause {
                sleep(pause).await;
            }
            timeout_at(deadline, limited.read_until(b'\n', &mut line)).await
        };
        let count = tokio::select! {
            // An error means that the server is gone, which is a reason to stop as well.
            _ = stop.changed() => return Ok(()),
            read = read => read.ok().transpose()?,
        };
        if count == Some(0) {
            return Ok(());
        }
        allowance.bytes(Instant::now(), line.len());
        let text = line.trim_ascii();
        let silent = count.is_none();
        let too_long = line.len() > LONGEST + 1;
        let answer = if silent {
            let message = format!(
                "no whole request has come for {} s: the connection is closed",
                idle.as_secs()
            );
            Answer::refused("timeout", message)
        } else if too_long {
            let message =
                format!("a request has at most {LONGEST} bytes: the connection is closed");
            Answer::refused("too_long", message)
        } else if text.is_empty() {
            // Nothing was asked: the time goes on.
            allowance.answer(Instant::now());
            continue;
        } else {
            match ControlRequest::parse(text) {
                Ok(request) => {
                    let (changes, words) = (request.changes(), request.to_string());
                    allowance.answer(Instant::now());
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
                    allowance.error(Instant::now());
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
        deadline = tokio::time::Instant::now() + idle;
    }
}

async fn carry_out(request: ControlRequest, orders: &mpsc::Sender<ControlCall>) -> Answer {
    let (sender, answer) = oneshot::channel();
    let order = ControlCall {
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
            "it is active, but the disk hangs: whether it is kept will show in headingd status",
        ),
    }
}

#[cfg(test)]
mod tests {
    use std::io::{Read, Write};
    use std::os::unix::net::UnixStream as StdStream;

    use super::*;

    /// Runs a client of the control socket against `other`, which is at the other end of its connection.
    fn served(idle: Duration, other: impl FnOnce(StdStream) -> String + Send + 'static) -> String {
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build()
            .unwrap();
        let (here, there) = StdStream::pair().unwrap();
        here.set_nonblocking(true).unwrap();
        there
            .set_read_timeout(Some(Duration::from_secs(30)))
            .unwrap();
        let other = std::thread::spawn(move || other(there));
        runtime.block_on(async {
            let (orders, _waiting) = mpsc::channel(1);
            let (_server, stop) = watch::channel(false);
            let stream = UnixStream::from_std(here).unwrap();
            // It may hang up in the middle of what the other end sends.
            let _ = serve(stream, orders, stop, idle).await;
        });
        other.join().unwrap()
    }

    #[test]
    fn blank_lines_hold_no_place() {
        let said = served(Duration::from_millis(300), |stream| {
            let mut writer = stream.try_clone().unwrap();
            let blanks = std::thread::spawn(move || {
                // Until it is hung up on, or has had long enough for that.
                for _ in 0..1000 {
                    if writer.write_all(b"\r\n").is_err() {
                        break;
                    }
                    std::thread::sleep(Duration::from_millis(20));
                }
                // An error means that it is closed already.
                let _ = writer.shutdown(std::net::Shutdown::Write);
            });
            let mut said = String::new();
            // An error after the answer: it was hung up on with a line on its way.
            let _ = (&stream).read_to_string(&mut said);
            drop(stream);
            blanks.join().unwrap();
            said
        });
        assert!(said.contains("\"code\":\"timeout\""), "{said}");
    }
}
