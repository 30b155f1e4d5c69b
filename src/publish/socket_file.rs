//! The socket in the file system: where it may be and who may connect; claimed without taking it from a living daemon,
//! and removed again.

use std::fs::{self, Permissions};
use std::io::{self, ErrorKind};
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::{FileTypeExt, MetadataExt, PermissionsExt};
use std::os::unix::net::UnixListener;
use std::path::{Path, PathBuf};
use std::process;

use rustix::net::sockopt::socket_peercred;
use rustix::net::{self, AddressFamily, SocketAddrUnix, SocketFlags, SocketType, socket_with};
use thiserror::Error;

use crate::check::Fault;
use crate::lock_file::{LockError, LockFile};

/// The longest path of a socket, bytes: the system takes 107, and the name under which it is made needs some.
const LONGEST_PATH: usize = 100;

/// Why the socket cannot be served on.
#[derive(Debug, Error)]
pub enum BindError {
    /// The settings are not usable.
    #[error("cannot serve on {}: {fault}", path.display())]
    Settings {
        /// The socket.
        path: PathBuf,
        /// What is wrong with them.
        fault: String,
    },
    /// Somebody answers there, or is about to.
    #[error(
        "cannot serve on {}: another daemon is serving there{}; stop it, or set another socket",
        path.display(), pid.map(|pid| format!(" (process {pid})")).unwrap_or_default()
    )]
    Busy {
        /// The socket.
        path: PathBuf,
        /// Its process, if that is known.
        pid: Option<u32>,
    },
    /// Somebody may be serving there.
    #[error(
        "cannot serve on {}: cannot find out whether a daemon is serving there: {source}; join its group, or set \
         another socket",
        path.display()
    )]
    Unsure {
        /// The socket.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// Something else stands there; it is left alone.
    #[error(
        "cannot serve on {}: a file that is no socket is there; move it away, or set another socket",
        path.display()
    )]
    NotASocket {
        /// The socket.
        path: PathBuf,
    },
    /// Its directory is missing.
    #[error(
        "cannot serve on {}: the directory {} does not exist; create it (sudo install -d -o $USER {}, or systemd's \
         RuntimeDirectory=), or set another socket",
        path.display(), directory.display(), directory.display()
    )]
    NoDirectory {
        /// The socket.
        path: PathBuf,
        /// The directory.
        directory: PathBuf,
    },
    /// This user may not make a socket there.
    #[error(
        "cannot serve on {}: {attempt}: {source}; let this user write to {} (systemd: User= and RuntimeDirectory=), \
         or set another socket",
        path.display(), path.parent().unwrap_or(path).display()
    )]
    NotAllowed {
        /// The socket.
        path: PathBuf,
        /// What was attempted.
        attempt: &'static str,
        /// What the system said.
        source: io::Error,
    },
    /// The system refused.
    #[error("cannot serve on {}: {attempt}: {source}", path.display())]
    System {
        /// The socket.
        path: PathBuf,
        /// What was attempted.
        attempt: &'static str,
        /// What the system said.
        source: io::Error,
    },
}

impl BindError {
    /// What was attempted at `path` failed.
    fn failed(path: &Path, attempt: &'static str, source: io::Error) -> Self {
        let path = path.to_owned();
        match source.kind() {
            ErrorKind::PermissionDenied | ErrorKind::ReadOnlyFilesystem => Self::NotAllowed {
                path,
                attempt,
                source,
            },
            _ => Self::System {
                path,
                attempt,
                source,
            },
        }
    }
}

/// The file of our own socket; dropping it removes the file.
#[derive(Debug)]
pub(super) struct SocketFile {
    path: PathBuf,
    /// Device and inode, by which it is known again.
    identity: (u64, u64),
    /// Held until the file is gone.
    _lock: LockFile,
}

/// A socket that somebody else has made, ready to be served on; `path` is for the message.
pub(super) fn inherited(listener: UnixListener, path: &Path) -> Result<UnixListener, BindError> {
    let attempt = "cannot make the socket that was handed over non-blocking";
    listener
        .set_nonblocking(true)
        .map_err(|source| BindError::failed(path, attempt, source))?;
    Ok(listener)
}

/// Listens on `path` with permissions `mode`. A socket that nobody serves on any more is replaced.
pub(super) fn claim(path: &Path, mode: u32) -> Result<(UnixListener, SocketFile), BindError> {
    let failed = |attempt| move |source| BindError::failed(path, attempt, source);
    // The settings have been checked: the path is absolute, so only "/" has no parent.
    let directory = path.parent().unwrap_or(path);
    if !directory.is_dir() {
        return Err(BindError::NoDirectory {
            path: path.to_owned(),
            directory: directory.to_owned(),
        });
    }
    refuse_if_taken(path)?;
    // Of two that are started together both have come this far.
    let lock = lock(path)?;
    refuse_if_taken(path)?;

    // bind() makes the file with permissions that hang on the umask, and fails where a stale socket lies.
    // So it is made under another name, given its permissions, and renamed: at its own name there is always
    // either the old socket or the finished new one.
    let temporary = directory.join(format!(".h{:x}", process::id()));
    match fs::remove_file(&temporary) {
        Err(error) if error.kind() != ErrorKind::NotFound => {
            return Err(failed("cannot remove what an earlier start left")(error));
        }
        _ => {}
    }
    let listener =
        UnixListener::bind(&temporary).map_err(failed("cannot make a socket in its directory"))?;
    let finish = || -> Result<(u64, u64), BindError> {
        fs::set_permissions(&temporary, Permissions::from_mode(mode))
            .map_err(failed("cannot set its permissions"))?;
        listener
            .set_nonblocking(true)
            .map_err(failed("cannot make it non-blocking"))?;
        let identity =
            identity(&temporary).map_err(failed("cannot look at the socket just made"))?;
        fs::rename(&temporary, path).map_err(failed("cannot put the socket in its place"))?;
        Ok(identity)
    };
    match finish() {
        Ok(identity) => {
            let file = SocketFile {
                path: path.to_owned(),
                identity,
                _lock: lock,
            };
            Ok((listener, file))
        }
        Err(error) => {
            // Best effort: the error that is reported is the one that led here.
            let _ = fs::remove_file(&temporary);
            Err(error)
        }
    }
}

/// An error unless `path` is free, or is a socket at which nobody listens.
fn refuse_if_taken(path: &Path) -> Result<(), BindError> {
    let failed = |attempt, source| BindError::failed(path, attempt, source);
    // Not following links: a link is no socket of ours.
    match fs::symlink_metadata(path) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(()),
        Err(error) => return Err(failed("cannot look at what is there", error)),
        Ok(found) if !found.file_type().is_socket() => {
            return Err(BindError::NotASocket {
                path: path.to_owned(),
            });
        }
        Ok(_) => {}
    }
    let busy = |pid| BindError::Busy {
        path: path.to_owned(),
        pid,
    };
    match connect(path) {
        Ok(pid) => Err(busy(pid)),
        // It has clients waiting, and takes none of them just now.
        Err(error) if error.kind() == ErrorKind::WouldBlock => Err(busy(None)),
        Err(error)
            if matches!(
                error.kind(),
                ErrorKind::ConnectionRefused | ErrorKind::NotFound
            ) =>
        {
            Ok(())
        }
        Err(source) => Err(BindError::Unsure {
            path: path.to_owned(),
            source,
        }),
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
fn lock(path: &Path) -> Result<LockFile, BindError> {
    let mut name = path.as_os_str().to_owned();
    name.push(".lock");
    LockFile::take(Path::new(&name)).map_err(|error| match error {
        LockError::Held(pid) => BindError::Busy {
            path: path.to_owned(),
            pid,
        },
        LockError::System(source) => {
            BindError::failed(path, "cannot lock the file .lock beside it", source)
        }
    })
}

fn identity(path: &Path) -> io::Result<(u64, u64)> {
    fs::symlink_metadata(path).map(|found| (found.dev(), found.ino()))
}

impl Drop for SocketFile {
    fn drop(&mut self) {
        // Another daemon may have put its own there in the meantime.
        if identity(&self.path).is_ok_and(|found| found == self.identity)
            && let Err(error) = fs::remove_file(&self.path)
        {
            tracing::warn!("cannot remove the socket {}: {error}", self.path.display());
        }
    }
}

/// Finds what is wrong with the path of a socket.
pub(super) fn check_path(faults: &mut Vec<Fault>, key: &str, path: &Path) {
    let length = path.as_os_str().as_bytes().len();
    if !path.is_absolute() || path.file_name().is_none() || length > LONGEST_PATH {
        let right = format!("an absolute path of up to {LONGEST_PATH} bytes");
        faults.push(Fault::new(key, format!("{path:?} ({length} bytes)"), right));
    }
}

/// Finds what is wrong with permissions that are at most `most`.
pub(super) fn check_mode(faults: &mut Vec<Fault>, key: &str, mode: &str, most: u32) {
    if mode_bits(mode, most).is_none() {
        let right = format!(
            "octal permissions in quotes, from \"0600\" to \"{most:04o}\", without execution"
        );
        faults.push(Fault::new(key, format!("{mode:?}"), right));
    }
}

/// Permissions as a number, if they are ones that a socket may have.
pub(super) fn mode_bits(mode: &str, most: u32) -> Option<u32> {
    // A sign is no part of a mode, but would be of a number.
    let octal = mode.bytes().all(|b| matches!(b, b'0'..=b'7'));
    u32::from_str_radix(mode, 8)
        .ok()
        .filter(|_| octal)
        .filter(|bits| bits & !most == 0 && bits & 0o600 == 0o600)
}
