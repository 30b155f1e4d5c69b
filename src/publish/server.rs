//! The server: a Unix socket at which any number of clients, up to a limit, ask and watch.
//!
//! Nothing here waits for a client but that client's own task. What has been handed to the system for a
//! slow client cannot be taken back: it may read headings as old as its socket's buffer is long, so every
//! `ATT` carries its time and `age_ms`, its age when it was written.

use std::future::Future;
use std::io;
use std::os::unix::net::UnixListener as StdListener;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use super::client::serve;
use super::clients::{ClientSocket, serve_clients};
use super::feed::Feed;
pub use super::feed::Publisher;
use super::gpsd::{self, Device, LINE_END};
use super::nmea;
pub use super::socket_file::{BindError, BindFault};
use super::socket_file::{OpenSocket, right_mode, right_path};
use crate::check::settings;

/// Headings are no secret, and nothing can be changed here.
const MOST_OPEN: u32 = 0o666;

settings! {
    /// Settings of the socket.
    pub struct Settings {
        /// Path of the socket, absolute, up to 100 bytes.
        socket: PathBuf = "/run/headingd/heading.sock".into() => |_, path| right_path(path).err();
        /// Permissions of the socket, octal, `"0600"` to `"0666"`. By default any local user may read
        /// headings, as any may read positions from gpsd. They are no secret, and nothing can be changed here. Set `"0660"`
        /// to let only the daemon's group in.
        mode: String = "0666".into() => |_, mode| right_mode(mode, MOST_OPEN).err();
        /// How many clients are served at a time. One user may have all but four of them (below
        /// eight, all but half); the rest is for other users. Root and the daemon's own user may have all.
        max_clients: usize = 32, 1..=1024, "clients";
        /// The longest request.
        request_limit_bytes: usize = 1024, 128..=65536, "bytes";
        /// How many messages a client may fall behind before it loses headings.
        backlog: usize = 64, 8..=4096, "messages";
        /// A client that is behind is disconnected unless it reads about 2 KiB within this time.
        write_timeout_s: f64 = 5.0, 0.1..=60.0, "seconds";
    }
}

/// A socket that has been claimed. Clients can connect from now on; [`Server::run`] serves them.
#[derive(Debug)]
pub struct Server {
    socket: OpenSocket,
    settings: Settings,
    feed: Arc<Feed>,
}

impl Server {
    /// Claims the socket, or takes the one that somebody else has made and `handed` over, whatever the settings' path and
    /// mode are. One that a dead daemon has left behind is replaced; one at which another daemon answers, or a file that is
    /// no socket, is left alone. Needs no runtime yet.
    ///
    /// A heading is dropped if its sample is older than `stale` when it is about to be sent.
    ///
    /// # Errors
    ///
    /// The settings are wrong, somebody else has the socket, or the system refuses.
    pub fn bind(
        handed: Option<StdListener>,
        settings: &Settings,
        nmea: &nmea::Settings,
        device: Device,
        stale: Duration,
    ) -> Result<Self, BindError> {
        Ok(Self {
            socket: OpenSocket::open(handed, &settings.socket, &settings.mode, MOST_OPEN)?,
            feed: Arc::new(Feed::new(device, nmea.clone(), settings.backlog, stale)),
            settings: settings.clone(),
        })
    }

    /// The path at which clients connect; that of the settings, if the socket has none.
    pub fn socket(&self) -> PathBuf {
        let address = self.socket.listener.local_addr().ok();
        let path = address.and_then(|address| Some(address.as_pathname()?.to_owned()));
        match &self.socket.file {
            None => path.unwrap_or_else(|| self.settings.socket.clone()),
            // It was made under another name.
            Some(_) => self.settings.socket.clone(),
        }
    }

    /// A handle by which headings, conditions and calibrations get in.
    pub fn publisher(&self) -> Publisher {
        self.feed.clone()
    }

    /// Serves clients until `shutdown` is ready. Then the socket is removed, and within 100 ms every client
    /// has been sent what was published before, as far as it takes it, and is closed.
    ///
    /// # Errors
    ///
    /// The socket cannot be handed to the runtime; nothing that a client does ends it.
    pub async fn run(self, shutdown: impl Future<Output = ()>) -> io::Result<()> {
        let socket = ClientSocket {
            open: self.socket,
            most: self.settings.max_clients,
            refusal: |full| {
                let message = format!("{full}; raise socket.max_clients, or try again later");
                gpsd::error(&message) + LINE_END
            },
            count: &self.feed.clients,
        };
        serve_clients(socket, shutdown, |stream, stopped| {
            serve(
                stream,
                self.feed.clone(),
                self.settings.request_limit_bytes,
                Duration::from_secs_f64(self.settings.write_timeout_s),
                stopped,
            )
        })
        .await
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::check::Check;

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
}
