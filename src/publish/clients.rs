//! Accepts clients up to the limit, and closes their connections at shutdown.

use std::collections::HashMap;
use std::future::Future;
use std::io::{self, Write};
use std::pin::pin;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use rustix::process::geteuid;
use tokio::net::unix::UCred;
use tokio::net::{UnixListener, UnixStream};
use tokio::sync::watch;
use tokio::task::{Id, JoinError, JoinSet};
use tokio::time::{sleep, timeout};

use super::admission::{Full, admit};
use super::client::ClientError;
use super::socket_file::OpenSocket;

/// How long clients have at the end to take what is on its way to them.
const FAREWELL: Duration = Duration::from_millis(80);

/// What helps where the process, or the system, has reached its limit of open files.
pub(crate) const OUT_OF_FILES: &str = "serve fewer clients (socket.max_clients), or raise the limit of open files (LimitNOFILE= in the systemd unit)";

/// Pauses after a failed accept: the first, doubled each time up to the last.
const PAUSES: (Duration, Duration) = (Duration::from_millis(50), Duration::from_secs(1));

/// A socket that has been claimed, and how many clients it has room for.
pub(super) struct ClientSocket<'a> {
    pub open: OpenSocket,
    pub most: usize,
    /// The line that a refused client is sent.
    pub refusal: fn(Full) -> String,
    /// How many are connected.
    pub count: &'a AtomicUsize,
}

/// Serves clients until `shutdown` is ready. Then the socket is removed, and every client has until [`FAREWELL`] to
/// end by itself. `serve` is handed a receiver that tells of the end.
pub(super) async fn serve_clients<S, F>(
    socket: ClientSocket<'_>,
    shutdown: impl Future<Output = ()>,
    serve: S,
) -> io::Result<()>
where
    S: Fn(UnixStream, watch::Receiver<bool>) -> F,
    F: Future<Output = Result<(), ClientError>> + Send + 'static,
{
    let listener = UnixListener::from_std(socket.open.listener)?;
    let (stop, stopped) = watch::channel(false);
    let mut clients: JoinSet<Result<(), ClientError>> = JoinSet::new();
    // Who the client of each task is.
    let mut peers: HashMap<Id, UCred> = HashMap::new();
    let own = geteuid().as_raw();
    let mut shutdown = pin!(shutdown);
    let mut pause = None;
    loop {
        let accepted = tokio::select! {
            () = &mut shutdown => break,
            Some(left) = clients.join_next_with_id() => {
                leave(left, &mut peers);
                None
            }
            accepted = accept(&listener, pause) => Some(accepted),
        };
        // All who have left make room before the next is refused.
        while let Some(left) = clients.try_join_next_with_id() {
            leave(left, &mut peers);
        }
        match accepted {
            None => {}
            Some(Ok((stream, peer))) => {
                pause = None;
                match admit(socket.most, own, peers.values().map(UCred::uid), peer.uid()) {
                    Ok(()) => {
                        let served = clients.spawn(serve(stream, stopped.clone()));
                        peers.insert(served.id(), peer);
                    }
                    Err(full) => {
                        refuse(stream, &(socket.refusal)(full));
                        let (pid, uid) = (peer.pid(), peer.uid());
                        tracing::info!(pid, uid, "refused a client: {full}");
                    }
                }
            }
            Some(Err(error)) => {
                // Logged once per episode.
                if pause.is_none() {
                    tracing::warn!("{error}");
                }
                pause = Some(pause.map_or(PAUSES.0, |last: Duration| (last * 2).min(PAUSES.1)));
            }
        }
        socket.count.store(clients.len(), Ordering::Relaxed);
    }
    drop((listener, socket.open.file));
    // Receivers are there as long as `stopped` is.
    let _ = stop.send(true);
    let _ = timeout(FAREWELL, async {
        while clients.join_next().await.is_some() {}
    })
    .await;
    clients.shutdown().await;
    socket.count.store(0, Ordering::Relaxed);
    Ok(())
}

/// The next client and who it is, after a pause if the last attempt failed.
async fn accept(
    listener: &UnixListener,
    pause: Option<Duration>,
) -> Result<(UnixStream, UCred), String> {
    if let Some(pause) = pause {
        sleep(pause).await;
    }
    let (stream, _) = listener.accept().await.map_err(|error| {
        // Usually out of file descriptors; the client stays in the backlog.
        format!("cannot accept a client, will try again: {error}; {OUT_OF_FILES}")
    })?;
    let peer = stream.peer_cred();
    peer.map(|peer| (stream, peer)).map_err(|error| {
        format!("disconnected a client, as the system does not tell who it is: {error}")
    })
}

/// Tells a client that there is no room. Its buffer is empty, so that this takes no time and no task.
fn refuse(stream: UnixStream, line: &str) {
    // A client that has gone in the meantime need not be told.
    if let Ok(mut stream) = stream.into_std() {
        let _ = stream.write_all(line.as_bytes());
    }
}

/// Takes a client off the list, and logs why it left.
fn leave(left: Result<(Id, Result<(), ClientError>), JoinError>, peers: &mut HashMap<Id, UCred>) {
    let (id, ended) = match left {
        Ok((id, ended)) => (id, ended),
        Err(error) => {
            peers.remove(&error.id());
            tracing::error!("a client's task failed: {error}");
            return;
        }
    };
    let peer = peers.remove(&id);
    let (pid, uid) = (
        peer.and_then(|peer| peer.pid()),
        peer.map(|peer| peer.uid()),
    );
    match ended {
        Ok(()) => tracing::debug!(pid, "a client left"),
        Err(error @ ClientError::Broken(_)) => tracing::debug!(pid, "a client left: {error}"),
        Err(error) => tracing::info!(pid, uid, "let a client go: {error}"),
    }
}
