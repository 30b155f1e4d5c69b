//! The server: a Unix socket at which any number of clients, up to a limit, ask and watch.
//!
//! Nothing here waits for a client but that client's own task. What has been handed to the system for a
//! slow client cannot be taken back: it may read headings as old as its socket's buffer is long, so every
//! `ATT` carries its time and `age_ms`, its age when it was written.

use std::future::Future;
use std::io::{self, Write};
use std::os::unix::ffi::OsStrExt;
use std::os::unix::net::UnixListener as StdListener;
use std::path::PathBuf;
use std::pin::pin;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use serde::{Deserialize, Serialize};
use tokio::net::{UnixListener, UnixStream};
use tokio::sync::watch;
use tokio::task::JoinSet;
use tokio::time::{sleep, timeout};

use super::client::{ClientError, LINE_END, serve};
use super::feed::Feed;
pub use super::feed::Publisher;
use super::gpsd::{self, Device};
pub use super::socket_file::BindError;
use super::socket_file::{SocketFile, claim};
use crate::check::{Check, Fault, within};

/// How long clients have at the end to take what is on its way to them.
const FAREWELL: Duration = Duration::from_millis(80);

/// Pauses after a failed accept: the first, doubled each time up to the last.
const PAUSES: (Duration, Duration) = (Duration::from_millis(50), Duration::from_secs(1));

/// The longest path of a socket, bytes: the system takes 107, and the name under which it is made needs some.
const LONGEST_PATH: usize = 100;

/// Settings of the socket.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// Path of the socket, absolute, up to 100 bytes. Default `/run/headingd/heading.sock`.
    pub socket: PathBuf,
    /// Permissions of the socket, octal, `"0600"` to `"0666"`. Default `"0666"`: any local user may read
    /// headings, as any may read positions from gpsd. They are no secret, nothing can be changed here, and a
    /// client can at worst use up the connections. Set `"0660"` to let only the daemon's group in.
    pub mode: String,
    /// How many clients are served at a time, 1 to 1024. Default 32.
    pub max_clients: usize,
    /// The longest request, bytes, 128 to 65536. Default 1024.
    pub request_limit_bytes: usize,
    /// How many messages a client may fall behind before it loses headings, 8 to 4096. Default 64.
    pub backlog: usize,
    /// How long a client may take nothing of what is sent to it, seconds, 0.1 to 60. Default 5.
    pub write_timeout_s: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            socket: "/run/headingd/heading.sock".into(),
            mode: "0666".into(),
            max_clients: 32,
            request_limit_bytes: 1024,
            backlog: 64,
            write_timeout_s: 5.0,
        }
    }
}

impl Settings {
    /// The permissions as a number, if they are ones that a socket may have.
    fn mode_bits(&self) -> Option<u32> {
        // A sign is no part of a mode, but would be of a number.
        let octal = self.mode.bytes().all(|b| matches!(b, b'0'..=b'7'));
        u32::from_str_radix(&self.mode, 8)
            .ok()
            .filter(|_| octal)
            .filter(|bits| bits & !0o666 == 0 && bits & 0o600 == 0o600)
    }
}

impl Check for Settings {
    fn check(&self) -> Vec<Fault> {
        let mut faults = Vec::new();
        let length = self.socket.as_os_str().as_bytes().len();
        if !self.socket.is_absolute() || self.socket.file_name().is_none() || length > LONGEST_PATH
        {
            faults.push(Fault {
                key: "socket".into(),
                found: format!("{:?} ({length} bytes)", self.socket),
                right: format!("an absolute path of up to {LONGEST_PATH} bytes"),
            });
        }
        if self.mode_bits().is_none() {
            faults.push(Fault {
                key: "mode".into(),
                found: format!("{:?}", self.mode),
                right: "octal permissions in quotes, from \"0600\" to \"0666\", without execution"
                    .into(),
            });
        }
        within(
            &mut faults,
            "max_clients",
            self.max_clients,
            1..=1024,
            "clients",
        );
        within(
            &mut faults,
            "request_limit_bytes",
            self.request_limit_bytes,
            128..=65536,
            "bytes",
        );
        within(&mut faults, "backlog", self.backlog, 8..=4096, "messages");
        within(
            &mut faults,
            "write_timeout_s",
            self.write_timeout_s,
            0.1..=60.0,
            "seconds",
        );
        faults
    }
}

/// A socket that has been claimed. Clients can connect from now on; [`Server::run`] serves them.
#[derive(Debug)]
pub struct Server {
    listener: StdListener,
    /// None if somebody else has made the socket, and will remove it.
    file: Option<SocketFile>,
    settings: Settings,
    feed: Arc<Feed>,
}

impl Server {
    /// Claims the socket. One that a dead daemon has left behind is replaced; one at which another daemon
    /// answers, or a file that is no socket, is left alone. Needs no runtime yet.
    ///
    /// A heading whose sample is older than `stale` when it is its turn is sent to nobody.
    pub fn bind(settings: &Settings, device: Device, stale: Duration) -> Result<Self, BindError> {
        let refused = |fault: String| BindError::Settings {
            path: settings.socket.clone(),
            fault,
        };
        if let Some(fault) = settings.check().first() {
            return Err(refused(fault.to_string()));
        }
        let mode = settings
            .mode_bits()
            .ok_or_else(|| refused("mode is not octal".into()))?;
        let (listener, file) = claim(&settings.socket, mode)?;
        Ok(Self::on(listener, Some(file), settings, device, stale))
    }

    /// Serves on a socket that somebody else has made, and will remove. Its path and mode are not those of the
    /// settings.
    pub fn inherit(
        listener: StdListener,
        settings: &Settings,
        device: Device,
        stale: Duration,
    ) -> Result<Self, BindError> {
        listener
            .set_nonblocking(true)
            .map_err(|source| BindError::System {
                path: settings.socket.clone(),
                attempt: "cannot make the socket that was handed over non-blocking",
                source,
            })?;
        Ok(Self::on(listener, None, settings, device, stale))
    }

    fn on(
        listener: StdListener,
        file: Option<SocketFile>,
        settings: &Settings,
        device: Device,
        stale: Duration,
    ) -> Self {
        Self {
            listener,
            file,
            feed: Arc::new(Feed::new(device, settings.backlog, stale)),
            settings: settings.clone(),
        }
    }

    /// The path at which clients connect; that of the settings, if the socket has none.
    pub fn socket(&self) -> PathBuf {
        let address = self.listener.local_addr().ok();
        let path = address.and_then(|address| Some(address.as_pathname()?.to_owned()));
        match &self.file {
            None => path.unwrap_or_else(|| self.settings.socket.clone()),
            // It was made under another name.
            Some(_) => self.settings.socket.clone(),
        }
    }

    /// A handle by which headings, conditions and calibrations get in.
    pub fn publisher(&self) -> Publisher {
        Publisher::new(self.feed.clone())
    }

    /// Serves clients until `shutdown` is ready. Then the socket is removed, and within 100 ms every client
    /// has been sent what was published before, as far as it takes it, and is closed.
    ///
    /// An error means that the socket could not be handed to the runtime; nothing that a client does ends it.
    pub async fn run(self, shutdown: impl Future<Output = ()>) -> io::Result<()> {
        let listener = UnixListener::from_std(self.listener)?;
        let (stop, stopped) = watch::channel(false);
        let mut clients: JoinSet<Result<(), ClientError>> = JoinSet::new();
        let mut shutdown = pin!(shutdown);
        let mut pause = None;
        loop {
            let accepted = tokio::select! {
                () = &mut shutdown => break,
                Some(left) = clients.join_next() => {
                    log_leave(left);
                    None
                }
                accepted = accept(&listener, pause) => Some(accepted),
            };
            // All who have left make room before the next is refused.
            while let Some(left) = clients.try_join_next() {
                log_leave(left);
            }
            match accepted {
                None => {}
                Some(Ok(stream)) => {
                    pause = None;
                    if clients.len() >= self.settings.max_clients {
                        refuse(stream, self.settings.max_clients);
                    } else {
                        clients.spawn(serve(
                            stream,
                            self.feed.clone(),
                            self.settings.request_limit_bytes,
                            Duration::from_secs_f64(self.settings.write_timeout_s),
                            stopped.clone(),
                        ));
                    }
                }
                Some(Err(error)) => {
                    // Out of file descriptors, as a rule; the client stays in the queue. Once an episode.
                    if pause.is_none() {
                        tracing::warn!("cannot accept a client, will try again: {error}");
                    }
                    pause = Some(pause.map_or(PAUSES.0, |last: Duration| (last * 2).min(PAUSES.1)));
                }
            }
            self.feed.clients.store(clients.len(), Ordering::Relaxed);
        }
        drop((listener, self.file));
        // Receivers are there as long as `stopped` is.
        let _ = stop.send(true);
        let _ = timeout(FAREWELL, async {
            while clients.join_next().await.is_some() {}
        })
        .await;
        clients.shutdown().await;
        self.feed.clients.store(0, Ordering::Relaxed);
        Ok(())
    }
}

/// The next client, after a pause if the last attempt failed.
async fn accept(listener: &UnixListener, pause: Option<Duration>) -> io::Result<UnixStream> {
    if let Some(pause) = pause {
        sleep(pause).await;
    }
    listener.accept().await.map(|(stream, _)| stream)
}

/// Tells a client that there is no room. Its buffer is empty, so that this takes no time and no task.
fn refuse(stream: UnixStream, limit: usize) {
    let line = gpsd::error(&format!(
        "headingd serves {limit} clients already; raise max_clients, or try again later"
    ));
    // A client that has gone in the meantime need not be told.
    if let Ok(mut stream) = stream.into_std() {
        let _ = stream.write_all(format!("{line}{LINE_END}").as_bytes());
    }
    tracing::info!("refused a client: {limit} are connected");
}

fn log_leave(left: Result<Result<(), ClientError>, tokio::task::JoinError>) {
    match left {
        Ok(Ok(())) => tracing::debug!("a client left"),
        Ok(Err(error @ ClientError::Broken(_))) => tracing::debug!("a client left: {error}"),
        Ok(Err(error)) => tracing::info!("let a client go: {error}"),
        Err(error) => tracing::error!("a client's task failed: {error}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_defaults_are_right_and_every_fault_is_named() {
        assert_eq!(Settings::default().check(), []);
        let wrong = Settings {
            socket: "heading.sock".into(),
            mode: "0777".into(),
            max_clients: 0,
            request_limit_bytes: 1,
            backlog: 0,
            write_timeout_s: f64::NAN,
        };
        let keys: Vec<_> = wrong.check().into_iter().map(|fault| fault.key).collect();
        assert_eq!(
            keys,
            [
                "socket",
                "mode",
                "max_clients",
                "request_limit_bytes",
                "backlog",
                "write_timeout_s",
            ]
        );
        for mode in ["", "+0666", "0o666", "rw", "0066", "660 "] {
            let settings = Settings {
                mode: mode.into(),
                ..Settings::default()
            };
            assert_eq!(settings.check().len(), 1, "{mode:?}");
        }
    }

    #[test]
    fn unknown_settings_are_refused() {
        assert!(toml::from_str::<Settings>("backlog = 9").is_ok());
        assert!(toml::from_str::<Settings>("backlogs = 9").is_err());
    }
}
