//! The socket in the file system: where it may be and who may connect; claimed without taking it from a living daemon,
//! and removed again.

use std::fs::{self, Permissions};
use std::io::{self, ErrorKind};
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::{FileTypeExt, PermissionsExt};
use std::os::unix::net::UnixListener;
use std::path::{Path, PathBuf};

use rustix::net::sockopt::socket_peercred;
use rustix::net::{self, AddressFamily, SocketAddrUnix, SocketFlags, SocketType, socket_with};
use thiserror::Error;

use crate::check::Fault;
use crate::lock_file::{LockError, LockFile, OwnFile};

/// The longest path of a socket, bytes: the system takes 107, and the name under which it is made needs some.
const LONGEST_PATH: usize = 100;

/// Why a socket cannot be served on.
#[derive(Debug, Error)]
#[error("cannot serve on {}: {why}", path.display())]
pub struct BindError {
    /// The socket.
    pub path: PathBuf,
    /// What is in the way.
    pub why: BindFault,
}

/// What is in the way of a socket.
#[derive(Debug, Error)]
pub enum BindFault {
    /// Another process serves there or is about to; its number, if that is known.
    #[error(
        "another daemon is serving there{}; stop it, or set another socket in [socket] or [control]",
        .0.map(|pid| format!(" (process {pid})")).unwrap_or_default()
    )]
    Busy(Option<u32>),
    /// Somebody may be serving there.
    #[error(
        "cannot find out whether a daemon is serving there: {0}; join the socket's group, or set another socket"
    )]
    Unsure(io::Error),
    /// Nobody can serve there: why, and what helps.
    #[error("{0}")]
    Unusable(String),
}

impl BindFault {
    /// What was attempted at `path` failed.
    fn failed(path: &Path, attempt: &str, source: io::Error) -> Self {
        let remedy = match source.kind() {
            ErrorKind::PermissionDenied | ErrorKind::ReadOnlyFilesystem => format!(
                "; let this user write to {} (systemd: User= and RuntimeDirectory=), or set another socket",
                path.parent().unwrap_or(path).display()
            ),
            _ => String::new(),
        };
        Self::Unusable(format!("{attempt}: {source}{remedy}"))
    }
}

#[derive(Debug)]
pub(super) struct OpenSocket {
    pub(super) listener: UnixListener,
    /// Its file, removed in the end, and the lock, held until the file is gone: fields are dropped in their order. None if
    /// somebody else has made the socket, and will remove it.
    pub(super) file: Option<(OwnFile, LockFile)>,
}

impl OpenSocket {
    /// The socket that was handed over, or else one at `path` with these permissions, which are at most `most_open`. One
    /// there that nobody serves on any more is replaced.
    pub(super) fn open(
        handed: Option<UnixListener>,
        path: &Path,
        mode: &str,
        most_open: u32,
    ) -> Result<Self, BindError> {
        let opened = match handed {
            Some(listener) => {
                let attempt = "cannot make the socket that was handed over non-blocking";
                let set = listener.set_nonblocking(true);
                set.map(|()| Self {
                    listener,
                    file: None,
                })
                .map_err(|source| BindFault::failed(path, attempt, source))
            }
            None => right_path(path)
                .and_then(|()| right_mode(mode, most_open))
                .map_err(|fault| BindFault::Unusable(fault.to_string()))
                .and_then(|mode| claim(path, mode)),
        };
        opened.map_err(|why| BindError {
            path: path.to_owned(),
            why,
        })
    }
}

/// Listens on `path` with permissions `mode`. A socket that nobody serves on any more is replaced.
fn claim(path: &Path, mode: u32) -> Result<OpenSocket, BindFault> {
    let failed = |attempt| move |source| BindFault::failed(path, attempt, source);
    // The path is absolute, so only "/" has no parent.
    let directory = path.parent().unwrap_or(path);
    if !directory.is_dir() {
        let directory = directory.display();
        return Err(BindFault::Unusable(format!(
            "the directory {directory} does not exist; create it (sudo install -d -o $USER {directory}, or systemd's \
             RuntimeDirectory=), or set another socket"
        )));
    }
    refuse_if_taken(path)?;
    // Two daemons that start together may both pass this check; the lock lets one through, and the second check sees its socket.
    let lock = lock(path)?;
    refuse_if_taken(path)?;

    // bind() makes the file with permissions that depend on the umask, and fails where a stale socket is. So it is made under another
    // name, given its permissions, and renamed: at its own name there is always either the old socket or the finished new one.
    let made = tempfile::Builder::new()
        .prefix(".h")
        .make_in(directory, |path| UnixListener::bind(path))
        .map_err(failed("cannot make a socket in its directory"))?;
    fs::set_permissions(made.path(), Permissions::from_mode(mode))
        .map_err(failed("cannot set its permissions"))?;
    made.as_file()
        .set_nonblocking(true)
        .map_err(failed("cannot make it non-blocking"))?;
    let found =
        fs::symlink_metadata(made.path()).map_err(failed("cannot look at the socket just made"))?;
    let put = made.persist(path).map_err(|error| error.error);
    let listener = put.map_err(failed("cannot put the socket in its place"))?;
    Ok(OpenSocket {
        listener,
        file: Some((OwnFile::new(path, &found), lock)),
    })
}

/// An error unless `path` is free, or is a socket at which nobody listens.
fn refuse_if_taken(path: &Path) -> Result<(), BindFault> {
    // Not following links: a link is no socket of ours.
    let found = match fs::symlink_metadata(path) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(()),
        found => found
            .map_err(|source| BindFault::failed(path, "cannot look at what is there", source))?,
    };
    if !found.file_type().is_socket() {
        let why = "a file that is no socket is there; move it away, or set another socket";
        return Err(BindFault::Unusable(why.to_owned()));
    }
    match connect(path) {
        Ok(pid) => Err(BindFault::Busy(pid)),
        Err(error) => match error.kind() {
            // It has clients waiting, and takes none of them just now.
            ErrorKind::WouldBlock => Err(BindFault::Busy(None)),
            ErrorKind::ConnectionRefused | ErrorKind::NotFound => Ok(()),
            _ => Err(BindFault::Unsure(error)),
        },
    }
}

/// Connects without waiting: somebody who listens and never answers would be waited for for ever. The process that
/// listens there.
fn connect(path: &Path) -> io::Result<Option<u32>> {
    let flags = SocketFlags::NONBLOCK | SocketFlags::CLOEXEC;
    let socket = socket_with(AddressFamily::UNIX, SocketType::STREAM, flags, None)?;
    net::connect(&socket, &SocketAddrUnix::new(path)?)?;
    let listening = socket_peercred(&socket).ok();
    Ok(listening.and_then(|other| u32::try_from(other.pid.as_raw_nonzero().get()).ok()))
}

/// The lock beside the socket.
fn lock(path: &Path) -> Result<LockFile, BindFault> {
    LockFile::beside(path).map_err(|error| match error {
        LockError::Held(pid) => BindFault::Busy(pid),
        LockError::System(source) => {
            BindFault::failed(path, "cannot lock the file .lock beside it", source)
        }
    })
}

/// What is wrong with the path of a socket is the error.
pub(super) fn right_path(path: &Path) -> Result<(), Fault> {
    let length = path.as_os_str().as_bytes().len();
    if path.is_absolute() && path.file_name().is_some() && length <= LONGEST_PATH {
        return Ok(());
    }
    let right = format!("an absolute path of up to {LONGEST_PATH} bytes");
    Err(Fault::new(
        "socket",
        format!("{path:?} ({length} bytes)"),
        right,
    ))
}

/// Permissions as a number, if they are ones that a socket may have: at most `most`.
pub(super) fn right_mode(mode: &str, most: u32) -> Result<u32, Fault> {
    // `from_str_radix` would accept a sign.
    let octal = mode.bytes().all(|b| matches!(b, b'0'..=b'7'));
    let bits = u32::from_str_radix(mode, 8).ok().filter(|_| octal);
    bits.filter(|bits| bits & !most == 0 && bits & 0o600 == 0o600)
        .ok_or_else(|| {
            let right = format!(
                "octal permissions in quotes, from \"0600\" to \"{most:04o}\", without execution"
            );
            Fault::new("mode", format!("{mode:?}"), right)
        })
}
