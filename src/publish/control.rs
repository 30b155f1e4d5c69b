//! The control socket: what changes the daemon, and tells how it does, for those who may.
//!
//! A request is one line of JSON, `{"request":"rollback","number":3}`, and so is its answer:
//! `{"ok":true,"code":"ok","message":"…",…}`. Whoever asked is logged, with the credentials that the system gives.

mod answer;
mod client;
mod request;
pub(crate) mod status;

use std::future::Future;
use std::io;
use std::os::unix::net::UnixListener;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicUsize;

use tokio::sync::{mpsc, oneshot};

use super::clients::{ClientSocket, serve_clients};
use super::socket_file::{BindError, OpenSocket, right_mode, right_path};
use crate::check::{Fault, settings};
pub use answer::Answer;
pub use request::ControlRequest;

/// Calibrations can be replaced here: the rest of the world stays out.
const MOST_OPEN: u32 = 0o660;

/// How many clients are served at a time, at most four of them of one user.
const MOST_CLIENTS: usize = 8;

/// The name of the socket where the configuration names none.
const FILE_NAME: &str = "control.sock";

settings! {
    /// Settings of the control socket.
    #[derive(Eq)]
    pub struct Settings {
        /// Path of the socket, absolute, up to 100 bytes. Empty: `control.sock` in the folder of the heading socket.
        socket: PathBuf = PathBuf::new()
            => |_, path| right_path(path).err().filter(|_| !path.as_os_str().is_empty());
        /// Permissions of the socket, octal, `"0600"` to `"0660"`: the daemon's user and its group.
        mode: String = "0660".into() => |_, mode| right_mode(mode, MOST_OPEN).err();
    }
}

impl Settings {
    /// Where the socket is, beside this one for headings.
    pub fn path(&self, heading_socket: &Path) -> PathBuf {
        if self.socket.as_os_str().is_empty() {
            heading_socket.with_file_name(FILE_NAME)
        } else {
            self.socket.clone()
        }
    }

    /// What is wrong with that place, if anything is.
    pub(crate) fn check_path(&self, heading_socket: &Path) -> Option<Fault> {
        right_path(&self.path(heading_socket)).err()
    }
}

#[derive(Debug)]
pub struct ControlCall {
    pub request: ControlRequest,
    /// An answer that is dropped says that the daemon is about to end.
    pub answer: oneshot::Sender<Answer>,
}

/// The control socket, claimed.
#[derive(Debug)]
pub struct Control(OpenSocket);

impl Control {
    /// Claims the socket, or takes the one that was `handed` over, as that for headings is. `heading_socket` is beside it
    /// unless the settings say otherwise.
    pub fn bind(
        handed: Option<UnixListener>,
        settings: &Settings,
        heading_socket: &Path,
    ) -> Result<Self, BindError> {
        let path = settings.path(heading_socket);
        OpenSocket::open(handed, &path, &settings.mode, MOST_OPEN).map(Self)
    }

    /// Hands requests to `requests` and answers to those who asked, until `shutdown` is ready. Then the socket is gone.
    pub async fn run(
        self,
        requests: mpsc::Sender<ControlCall>,
        shutdown: impl Future<Output = ()>,
    ) -> io::Result<()> {
        let socket = ClientSocket {
            open: self.0,
            most: MOST_CLIENTS,
            refusal: |full| {
                Answer::refused("too_many_clients", format!("{full}; try again later")).line()
            },
            count: &AtomicUsize::new(0),
        };
        serve_clients(socket, shutdown, |stream, stopped| {
            client::serve(stream, requests.clone(), stopped)
        })
        .await
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::check::Check;

    #[test]
    fn nobody_but_user_and_group_may_be_let_in() {
        for mode in ["0666", "0661", "660x", "0060"] {
            let settings = Settings {
                socket: "relative".into(),
                mode: mode.into(),
            };
            let keys: Vec<_> = settings.check().into_iter().map(|f| f.key).collect();
            assert_eq!(keys, ["socket", "mode"], "{mode}");
        }
    }
}
