//! What helps against an error of the store, or of the recording.

use std::io::{self, ErrorKind};

use crate::publish::OUT_OF_FILES;
use crate::store::StoreError;

/// The error, and what helps.
pub(super) fn with_remedy(error: &StoreError) -> String {
    use StoreError::{Directory, Read, Write};
    let remedy = match error {
        Read(_, cause) if cause.kind() == ErrorKind::PermissionDenied => {
            "make the file readable to the daemon's user (chown)".to_owned()
        }
        Directory(_, cause) | Read(_, cause) | Write(_, cause) => {
            of_folder(cause, "store.directory")
        }
        _ => return error.to_string(),
    };
    format!("{error}; {remedy}")
}

/// What helps against this error in the folder that `key` of the configuration names.
pub(super) fn of_folder(error: &io::Error, key: &str) -> String {
    match error.kind() {
        _ if is_full(error) => "make room on the disk".to_owned(),
        _ if is_out_of_files(error) => OUT_OF_FILES.to_owned(),
        ErrorKind::ResourceBusy => format!("stop it, or set another {key}"),
        ErrorKind::FileTooLarge => {
            "raise the limit on file size (ulimit -f; LimitFSIZE= in the unit)".to_owned()
        }
        ErrorKind::NotFound
        | ErrorKind::PermissionDenied
        | ErrorKind::AlreadyExists
        | ErrorKind::NotADirectory
        | ErrorKind::ReadOnlyFilesystem => format!(
            "set {key} to a folder that this user may write; for a service, /var/lib/headingd, with StateDirectory=headingd in its \
             unit"
        ),
        _ => format!("check the disk, or set {key} to a folder on another one"),
    }
}

/// Whether the disk, or the user's quota, is full.
pub(super) fn is_full(error: &io::Error) -> bool {
    [ErrorKind::StorageFull, ErrorKind::QuotaExceeded].contains(&error.kind())
}

/// Whether the process, or the system, has reached its limit of open files.
fn is_out_of_files(error: &io::Error) -> bool {
    [libc::EMFILE, libc::ENFILE]
        .map(Some)
        .contains(&error.raw_os_error())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_needs_room_only_where_there_is_none() {
        for (number, right) in [
            (libc::ENOSPC, "make room"),
            (libc::EDQUOT, "make room"),
            (libc::EFBIG, "ulimit -f"),
            (libc::EMFILE, "LimitNOFILE="),
            (
                libc::ENOENT,
                "set record.directory to a folder that this user",
            ),
            (
                libc::EACCES,
                "set record.directory to a folder that this user",
            ),
            (libc::ENODEV, "set record.directory to a folder on another"),
        ] {
            let remedy = of_folder(&io::Error::from_raw_os_error(number), "record.directory");
            assert!(remedy.contains(right), "{number}: {remedy}");
        }
    }

    #[test]
    fn a_file_that_may_not_be_read_is_given_to_the_user() {
        let error = io::Error::from_raw_os_error(libc::EACCES);
        let message = with_remedy(&StoreError::Read("/folder".into(), error));
        assert!(message.contains("(chown)"), "{message}");
    }
}
