//! Sockets that systemd has opened for the daemon (socket activation).

use std::env;
use std::os::unix::net::UnixListener;

use listenfd::ListenFd;

/// The name of the socket for headings (`FileDescriptorName=` of its unit). One without a name is taken for it too.
pub const HEADING: &str = "heading";

/// The name of the control socket.
pub const CONTROL: &str = "control";

/// Names of a socket whose unit has no FileDescriptorName=: systemd then uses the unit's name.
const UNNAMED: [&str; 2] = ["", "headingd.socket"];

#[derive(Debug, Default)]
pub struct Sockets {
    left: Vec<(String, UnixListener)>,
}

impl Sockets {
    /// Takes those that the environment names: `LISTEN_PID`, `LISTEN_FDS` and `LISTEN_FDNAMES`, as in
    /// sd_listen_fds(3). To be called once, before any thread is started.
    pub fn from_env() -> Self {
        let names = env::var("LISTEN_FDNAMES").unwrap_or_default();
        let mut names = names.split(':');
        let mut handed = ListenFd::from_env();
        let mut left = Vec::new();
        for index in 0..handed.len() {
            let name = names.next().unwrap_or_default().to_owned();
            match handed.take_unix_listener(index) {
                Ok(Some(listener)) => left.push((name, listener)),
                Ok(None) => {}
                Err(error) => tracing::warn!(
                    "leaving alone the socket {name:?} that the service manager has handed over: {error}"
                ),
            }
        }
        Self { left }
    }

    /// The socket of this name.
    pub fn take(&mut self, name: &str) -> Option<UnixListener> {
        let wanted = |found: &str| found == name || (name == HEADING && UNNAMED.contains(&found));
        let index = self.left.iter().position(|(found, _)| wanted(found))?;
        Some(self.left.swap_remove(index).1)
    }

    /// The names of those that nobody took.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.left.iter().map(|(name, _)| name.as_str())
    }
}
