//! A client of the control socket: how the commands that look after the daemon reach it, and what helps if they
//! do not.

use std::fs;
use std::io::{self, BufRead, BufReader, ErrorKind, Read, Write};
use std::os::unix::fs::FileTypeExt;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::time::Duration;

use rustix::net::sockopt::{Timeout, set_socket_timeout};
use rustix::net::{self, AddressFamily, SocketAddrUnix, SocketFlags, SocketType, socket_with};
use serde::de::DeserializeOwned;
use serde_json::Value;

use super::{Failure, OrFail, config_file, overwrite, print_json};
use crate::config::Config;
use crate::publish::control::ControlRequest;
use crate::publish::control::status::DaemonStatus;

/// A daemon that is well takes a connection, and answers what changes nothing, at once.
pub(super) const PATIENCE: Duration = Duration::from_secs(5);

/// A change is answered when it is on disk: a little longer than the daemon waits for that.
const DISK_PATIENCE: Duration = Duration::from_secs(15);

/// No answer is longer, bytes.
const LONGEST: u64 = 1 << 22;

#[derive(Clone, Debug, clap::Args)]
pub struct ControlTarget {
    /// The daemon's control socket; without it, that of the configuration
    #[arg(long, value_name = "PATH", global = true, conflicts_with = "config")]
    pub socket: Option<PathBuf>,
    /// The daemon's configuration file [default: $HEADINGD_CONFIG, else /etc/headingd/headingd.toml, if there is one]
    #[arg(long, value_name = "FILE", global = true)]
    pub config: Option<PathBuf>,
}

impl ControlTarget {
    /// Refuses to write over the daemon's own files, as far as its configuration tells them.
    pub fn refuse_overwrite(&self, out: &Path) -> Result<(), Failure> {
        let named = self.config.as_deref();
        let config = config_file::load_for_client(named)?;
        overwrite::refuse(out, None, named, &config)
    }

    pub(super) fn path(&self) -> Result<PathBuf, Failure> {
        if let Some(path) = &self.socket {
            return Ok(path.clone());
        }
        let config = config_file::load_for_client(self.config.as_deref())?;
        Ok(config.control.path(&config.socket.socket))
    }

    /// Sends a request; gives the answer. With `json` a refusal is printed, too.
    pub fn ask(&self, request: &ControlRequest, json: bool) -> Result<Value, Failure> {
        exchange(&self.path()?, request, json)
    }
}

/// Sends a request to the daemon with this control socket. A refusal becomes a `Failure`; with `print_refusal` it is printed, too.
pub(super) fn exchange(
    path: &Path,
    request: &ControlRequest,
    print_refusal: bool,
) -> Result<Value, Failure> {
    let line = exchange_lines(path, request).map_err(|error| {
        let mut failure = unreachable(path, &error);
        if request.changes() && is_timeout(&error) {
            failure.message += "; what was asked may still be done";
        }
        failure
    })?;
    let answer: Value = serde_json::from_str(&line).unwrap_or_default();
    let text = |key: &str| answer[key].as_str();
    let (Some(ok), Some(code), Some(message)) =
        (answer["ok"].as_bool(), text("code"), text("message"))
    else {
        return Err(stranger(path, &answer));
    };
    if ok {
        return Ok(answer);
    }
    let failure = Failure::new(status(code), format!("{message} ({code})"));
    if print_refusal {
        print_json(&answer)?;
    }
    Err(failure)
}

/// How the daemon with this control socket does.
pub(super) fn daemon_status(path: &Path) -> Result<DaemonStatus, Failure> {
    read(exchange(path, &ControlRequest::Status {}, false)?)
}

/// The answer as the command reads it.
pub(super) fn read<T: DeserializeOwned>(answer: Value) -> Result<T, Failure> {
    let what = "the daemon and this headingd are of different versions";
    serde_json::from_value(answer).or_fail(Failure::DATA, what)
}

/// The exit status for a refusal with this code.
fn status(code: &str) -> u8 {
    match code {
        "unreadable" | "newer" | "malformed" | "unknown_request" | "too_long" => Failure::DATA,
        "stopping" | "timeout" | "too_many_clients" => Failure::UNAVAILABLE,
        "not_kept" | "internal" => Failure::IO,
        _ => Failure::REFUSED,
    }
}

fn exchange_lines(path: &Path, request: &ControlRequest) -> io::Result<String> {
    let patience = if request.changes() {
        DISK_PATIENCE
    } else {
        PATIENCE
    };
    let request = serde_json::to_string(request)?;
    let mut stream = connect(path)?;
    stream.set_read_timeout(Some(patience))?;
    stream.set_write_timeout(Some(patience))?;
    let sent = stream.write_all(format!("{request}\n").as_bytes());
    let mut answer = String::new();
    let read = BufReader::new(stream.take(LONGEST)).read_line(&mut answer);
    // Even if the daemon did not take the whole request, its answer may be there.
    if !answer.ends_with('\n') {
        sent?;
        read?;
        return Err(ErrorKind::UnexpectedEof.into());
    }
    Ok(answer)
}

/// Connects, with a timeout: once the queue of a hung daemon is full, connect(2) would block.
pub(super) fn connect(path: &Path) -> io::Result<UnixStream> {
    let flags = SocketFlags::CLOEXEC;
    let socket = socket_with(AddressFamily::UNIX, SocketType::STREAM, flags, None)?;
    // Linux applies it to connect(2) as well.
    set_socket_timeout(&socket, Timeout::Send, Some(PATIENCE))?;
    net::connect(&socket, &SocketAddrUnix::new(path)?)?;
    Ok(socket.into())
}

/// The server on this socket uses another protocol.
fn stranger(path: &Path, answer: &Value) -> Failure {
    let usual = Config::default();
    let (what, control) = if answer["class"].is_string() {
        ("the socket for headings", usual.control.path(path))
    } else {
        let control = usual.control.path(&usual.socket.socket);
        ("not headingd's control socket", control)
    };
    let message = format!(
        "{} is {what}: the control socket is {}, unless [control] of the configuration says otherwise; name it with \
         --socket, or the configuration with --config",
        path.display(),
        control.display()
    );
    Failure::new(Failure::DATA, message)
}

/// Why the daemon with this socket cannot be reached, and what helps.
pub(super) fn unreachable(path: &Path, error: &io::Error) -> Failure {
    let name = path.display();
    if fs::metadata(path).is_ok_and(|found| !found.file_type().is_socket()) {
        let message = format!(
            "{name} is not a socket: name the daemon's with --socket, or its configuration with --config"
        );
        return Failure::new(Failure::DATA, message);
    }
    let (status, message) = match error.kind() {
        ErrorKind::NotFound | ErrorKind::ConnectionRefused => (
            Failure::UNAVAILABLE,
            format!(
                "no headingd is running at {name}: start it (systemctl start headingd), or name its socket with \
                 --socket, or its configuration with --config"
            ),
        ),
        ErrorKind::PermissionDenied => (
            Failure::NO_PERMISSION,
            format!(
                "not allowed to connect to {name}: only its user and its group may, and ls -l {name} shows them; for the \
                 service, usermod -aG headingd $USER, and log in again"
            ),
        ),
        ErrorKind::UnexpectedEof | ErrorKind::BrokenPipe | ErrorKind::ConnectionReset => (
            Failure::UNAVAILABLE,
            format!("headingd has closed {name} without an answer: it is about to stop; try again"),
        ),
        _ if is_timeout(error) => (
            Failure::UNAVAILABLE,
            format!("headingd does not answer at {name}: systemctl restart headingd"),
        ),
        _ => (
            Failure::IO,
            format!("cannot talk to headingd at {name}: {error}"),
        ),
    };
    Failure::new(status, message)
}

pub(super) fn is_timeout(error: &io::Error) -> bool {
    [ErrorKind::WouldBlock, ErrorKind::TimedOut].contains(&error.kind())
}
