//! Locks that one process holds at a time, by files beside what they guard; the system lets go of them however the
//! process ends. Each holds the number of its process, so that another can say who has it.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, ErrorKind, Read, Write};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::process;
use std::sync::{Arc, Mutex, PoisonError, Weak};

/// Attempts to lock; each fails if the owner removes the file in between.
const ATTEMPTS: usize = 100;

/// Longest content, bytes: a number and the end of its line.
const LONGEST: u64 = 32;

/// The lock of a folder, in it; that of a file has the file's name before it.
const NAME: &str = ".lock";

/// A file of ours; dropping it removes the file, unless its name belongs to another file by then.
#[derive(Debug)]
pub struct OwnFile {
    path: PathBuf,
    /// Device and inode, by which it is known again.
    identity: (u64, u64),
}

impl OwnFile {
    /// The file with this metadata, which is or will be at `path`.
    pub fn new(path: &Path, found: &fs::Metadata) -> Self {
        Self {
            path: path.to_owned(),
            identity: identity(found),
        }
    }
}

/// A lock that is held; dropping it removes its file.
#[derive(Debug)]
pub struct LockFile {
    /// Dropped before the lock ends, so that the file goes while nobody else can hold it.
    own: OwnFile,
    /// Closing it releases the lock.
    file: File,
}

#[derive(Debug)]
pub enum LockError {
    /// Another process holds it; its number, if known.
    Held(Option<u32>),
    System(io::Error),
}

impl From<LockError> for io::Error {
    fn from(error: LockError) -> Self {
        let holder = match error {
            LockError::System(error) => return error,
            LockError::Held(pid) => pid.map(|pid| format!(" (process {pid})")),
        };
        let holder = holder.unwrap_or_default();
        Self::new(
            ErrorKind::ResourceBusy,
            format!("another daemon{holder} uses it"),
        )
    }
}

/// Locks that are shared within this process.
static SHARED: Mutex<Vec<Weak<LockFile>>> = Mutex::new(Vec::new());

impl LockFile {
    /// Takes the lock, or says who has it.
    fn take(path: &Path) -> Result<Self, LockError> {
        for _ in 0..ATTEMPTS {
            let (file, writable) = open(path).map_err(LockError::System)?;
            match file.try_lock() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => return Err(LockError::Held(holder(&file))),
                // Some file systems have no locks. There, carry on as if no other daemon existed.
                Err(TryLockError::Error(error)) if is_unsupported(&error) => tracing::warn!(
                    "cannot lock {}, so two daemons would not notice each other there: {error}",
                    path.display()
                ),
                Err(TryLockError::Error(error)) => return Err(LockError::System(error)),
            }
            let found = file.metadata().map_err(LockError::System)?;
            // Its owner has removed it meanwhile: the next one is made under the same name.
            if identity_at(path) != Some(identity(&found)) {
                continue;
            }
            writable.map_err(LockError::System)?;
            let own = OwnFile::new(path, &found);
            let lock = Self { own, file };
            // On a full disk this fails, and others cannot name the holder.
            let _ = lock.sign();
            return Ok(lock);
        }
        Err(LockError::Held(None))
    }

    /// Takes the lock beside this file, `FILE.lock`.
    pub fn beside(file: &Path) -> Result<Self, LockError> {
        let mut path = file.as_os_str().to_owned();
        path.push(NAME);
        Self::take(Path::new(&path))
    }

    /// Takes the lock of this folder, or shares it, if this process already holds it.
    pub fn of_folder(folder: &Path) -> Result<Arc<Self>, LockError> {
        Self::share(&folder.join(NAME))
    }

    /// Like `take`, but shares a lock that this process already holds.
    fn share(path: &Path) -> Result<Arc<Self>, LockError> {
        let mut shared = SHARED.lock().unwrap_or_else(PoisonError::into_inner);
        shared.retain(|lock| lock.strong_count() > 0);
        let found = identity_at(path);
        let mut held = shared.iter().filter_map(Weak::upgrade);
        if let Some(lock) = held.find(|lock| Some(lock.own.identity) == found) {
            return Ok(lock);
        }
        let lock = Arc::new(Self::take(path)?);
        shared.push(Arc::downgrade(&lock));
        Ok(lock)
    }

    fn sign(&self) -> io::Result<()> {
        self.file.set_len(0)?;
        writeln!(&self.file, "{}", process::id())
    }
}

impl Drop for OwnFile {
    fn drop(&mut self) {
        if identity_at(&self.path) == Some(self.identity)
            && let Err(error) = fs::remove_file(&self.path)
        {
            tracing::warn!("cannot remove {}: {error}", self.path.display());
        }
    }
}

fn identity_at(path: &Path) -> Option<(u64, u64)> {
    let found = fs::symlink_metadata(path).ok()?;
    Some(identity(&found))
}

/// Opens or makes the file. The second value is an error if it can only be read: that suffices to learn who holds the lock, not to take it.
fn open(path: &Path) -> io::Result<(File, io::Result<()>)> {
    let mut options = OpenOptions::new();
    // A link could lead anywhere, and a pipe would be waited for.
    options
        .read(true)
        .custom_flags(libc::O_NOFOLLOW | libc::O_NONBLOCK);
    let made = options
        .clone()
        .write(true)
        .create(true)
        .truncate(false)
        .mode(0o644)
        .open(path);
    let (file, writable) = match made {
        Err(error) if error.kind() == ErrorKind::PermissionDenied => match options.open(path) {
            Ok(file) => (file, Err(error)),
            Err(_) => return Err(error),
        },
        made => (made?, Ok(())),
    };
    if !file.metadata()?.is_file() {
        let what = format!("{} is no regular file: move it away", path.display());
        return Err(io::Error::new(ErrorKind::InvalidInput, what));
    }
    Ok((file, writable))
}

/// The process that has signed it; `None` for the moment between lock and signature.
fn holder(file: &File) -> Option<u32> {
    let mut text = String::new();
    file.take(LONGEST).read_to_string(&mut text).ok()?;
    text.strip_suffix('\n')?.parse().ok()
}

fn is_unsupported(error: &io::Error) -> bool {
    error.kind() == ErrorKind::Unsupported || error.raw_os_error() == Some(libc::ENOLCK)
}

fn identity(found: &fs::Metadata) -> (u64, u64) {
    (found.dev(), found.ino())
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::symlink;
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;

    #[test]
    fn one_has_it_the_other_is_told_who_and_it_can_be_had_afterwards() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("lock");
        // Of a process that was killed.
        fs::write(&path, "4000000\nand more").unwrap();
        let lock = LockFile::take(&path).unwrap();
        for _ in 0..2 {
            match LockFile::take(&path) {
                Err(LockError::Held(Some(pid))) => assert_eq!(pid, process::id()),
                other => panic!("{other:?}"),
            }
        }
        drop(lock);
        assert!(!path.exists());
        LockFile::take(&path).unwrap();
    }

    #[test]
    fn within_a_process_it_is_shared_until_the_last_one_lets_go() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("lock");
        let first = LockFile::share(&path).unwrap();
        let second = LockFile::share(&path).unwrap();
        drop(first);
        assert!(matches!(LockFile::take(&path), Err(LockError::Held(_))));
        // The folder is another one now: so is its lock.
        fs::rename(&path, folder.path().join("aside")).unwrap();
        let third = LockFile::share(&path).unwrap();
        drop((second, third));
        assert!(!path.exists());
        LockFile::take(&path).unwrap();
    }

    #[test]
    fn a_file_system_without_locks_is_told_from_one_that_fails() {
        for (number, right) in [
            (libc::EOPNOTSUPP, true),
            (libc::ENOSYS, true),
            (libc::ENOLCK, true),
            (libc::EIO, false),
            (libc::ENOSPC, false),
        ] {
            let error = io::Error::from_raw_os_error(number);
            assert_eq!(is_unsupported(&error), right, "{error}");
        }
    }

    #[test]
    fn what_is_no_regular_file_is_left_alone() {
        let folder = tempfile::tempdir().unwrap();
        let (pipe, link) = (folder.path().join("pipe"), folder.path().join("link"));
        let made = process::Command::new("mkfifo").arg(&pipe).status();
        assert!(made.unwrap().success());
        symlink("elsewhere", &link).unwrap();
        for path in [&pipe, &link, &folder.path().join("none/lock")] {
            assert!(matches!(LockFile::take(path), Err(LockError::System(_))));
        }
        assert!(!folder.path().join("elsewhere").exists());
        assert!(pipe.exists());
    }

    #[test]
    fn never_do_two_have_it_at_a_time() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("lock");
        let (holders, taken) = (AtomicUsize::new(0), AtomicUsize::new(0));
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    while taken.load(Ordering::SeqCst) < 300 {
                        let Ok(lock) = LockFile::take(&path) else {
                            continue;
                        };
                        assert_eq!(holders.fetch_add(1, Ordering::SeqCst), 0);
                        taken.fetch_add(1, Ordering::SeqCst);
                        std::thread::yield_now();
                        holders.fetch_sub(1, Ordering::SeqCst);
                        drop(lock);
                    }
                });
            }
        });
    }
}
