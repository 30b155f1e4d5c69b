//! NMEA 0183 for programs that open nothing but serial ports: a pseudo terminal that looks like one.

use std::fs::{self, File, Permissions};
use std::io::{self, ErrorKind, Write};
use std::os::fd::OwnedFd;
use std::os::unix::fs::{PermissionsExt, symlink};
use std::path::{Path, PathBuf};

use rustix::fs::{Mode, OFlags, fcntl_setfl, open};
use rustix::io::ioctl_fionread;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{
    OptionalActions, QueueSelector, ioctl_tiocnxcl, tcflush, tcgetattr, tcsetattr,
};

use super::lines::HeadingLines;
use crate::check::{absolute_or_empty, settings};
use crate::lock_file::{LockFile, OwnFile};

/// Headings are no secret, and what is written to it is thrown away; programs open a port for both.
const MODE: u32 = 0o666;

settings! {
    /// Where the port is.
    #[derive(Eq)]
    pub struct Settings {
        /// Path of a link to the port, absolute: `"/run/headingd/nmea"`. Empty, as it is by default: none.
        path: PathBuf = PathBuf::new()
            => |key, path| absolute_or_empty(key, path, "an absolute path, as \"/run/headingd/nmea\", or empty");
    }
}

pub(super) struct Pty {
    ours: File,
    /// The program's side, held open: otherwise writes fail while no program has the port open.
    theirs: OwnedFd,
    _link: OwnFile,
    /// Another daemon would make its own link in place of ours.
    _lock: LockFile,
}

impl Pty {
    /// Makes a port. A link to a port that an earlier daemon left is replaced; anything else in its place is left alone.
    pub(super) fn open(path: &Path) -> io::Result<Self> {
        let lock = LockFile::beside(path)?;
        let ours = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY)?;
        grantpt(&ours)?;
        unlockpt(&ours)?;
        let port = ptsname(&ours, Vec::new())?
            .into_string()
            .map_err(io::Error::other)?;
        let theirs = open(
            &port,
            OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC,
            Mode::empty(),
        )?;
        // No echo, and no line ends of its own.
        let mut line = tcgetattr(&theirs)?;
        line.make_raw();
        tcsetattr(&theirs, OptionalActions::Now, &line)?;
        fs::set_permissions(&port, Permissions::from_mode(MODE))?;
        fcntl_setfl(&ours, OFlags::RDWR | OFlags::NONBLOCK)?;
        if fs::read_link(path).is_ok_and(|port| port.starts_with("/dev/pts")) {
            fs::remove_file(path)?;
        }
        symlink(&port, path).map_err(|error| match error.kind() {
            ErrorKind::AlreadyExists => {
                io::Error::new(error.kind(), "something else is there: move it away")
            }
            _ => error,
        })?;
        Ok(Self {
            ours: ours.into(),
            theirs,
            _link: OwnFile::new(path, &fs::symlink_metadata(path)?),
            _lock: lock,
        })
    }

    /// Writes until there are no more.
    pub(super) async fn run(mut self, mut lines: HeadingLines) {
        while let Some(text) = lines.next().await {
            if let Err(error) = self.write(&text) {
                tracing::debug!("cannot write to the port: {error}");
            }
        }
    }

    /// Writes in place of what nobody has read: a program that opens the port later gets no old headings.
    fn write(&mut self, text: &str) -> io::Result<()> {
        // A program that opened the port exclusively and was killed leaves it locked, since our descriptor keeps the port open.
        // So the lock is cleared here.
        ioctl_tiocnxcl(&self.theirs)?;
        if ioctl_fionread(&self.theirs)? > 0 {
            tcflush(&self.theirs, QueueSelector::IFlush)?;
        }
        // What a program writes must not pile up.
        tcflush(&self.theirs, QueueSelector::OFlush)?;
        match self.ours.write(text.as_bytes()) {
            Err(error) if error.kind() != ErrorKind::WouldBlock => Err(error),
            _ => Ok(()),
        }
    }
}
