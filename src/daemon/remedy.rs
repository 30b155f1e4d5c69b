//! What helps against an error of the store, or of the recording.

use std::io::{self, ErrorKind};

use crate::store::StoreError;

const OUT_OF_FILES: &str =
    "have fewer clients, or raise the limit, LimitNOFILE= in the systemd unit";

/// The error, and what helps.
pub(super) fn with_remedy(error: &StoreError) -> String {
    use StoreError::{Directory, Read, Write};
    let remedy = match error {
        Directory(_, cause) | Read(_, cause) | Write(_, cause) if is_out_of_files(cause) => {
            OUT_OF_FILES
        }
        Directory(..) => {
            "make room on the disk, set store.directory to a folder that this user may write, or start the daemon with \
             StateDirectory=headingd in its systemd unit"
        }
        Read(_, cause) if cause.kind() == ErrorKind::PermissionDenied => {
            "make the file readable to the daemon's user (chown)"
        }
        Write(..) => "make room on the disk, or see to the folder's permissions",
        _ => return error.to_string(),
    };
    format!("{error}; {remedy}")
}

/// What helps a recording that this error stops.
pub(super) fn of_recording(error: &io::Error) -> &'static str {
    match error.kind() {
        _ if is_full(error) => "make room on the disk",
        _ if is_out_of_files(error) => OUT_OF_FILES,
        ErrorKind::FileTooLarge => {
            "set record.file_mib below the limit to the size of files (ulimit -f)"
        }
        ErrorKind::NotFound
        | ErrorKind::PermissionDenied
        | ErrorKind::NotADirectory
        | ErrorKind::ReadOnlyFilesystem => {
            "set record.directory to a folder that this user may write; as a service, to one below /var/lib/headingd"
        }
        _ => "check the disk, or set record.directory to a folder on another one",
    }
}

/// Whether the disk is full, or what the user may have of it.
pub(super) fn is_full(error: &io::Error) -> bool {
    [ErrorKind::StorageFull, ErrorKind::QuotaExceeded].contains(&error.kind())
}

/// Whether the process, or the system, has as many files open as it may.
fn is_out_of_files(error: &io::Error) -> bool {
    [libc::EMFILE, libc::ENFILE]
        .map(Some)
        .contains(&error.raw_os_error())
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::*;

    #[test]
    fn a_recording_needs_room_only_where_there_is_none() {
        for (number, right) in [
            (libc::ENOSPC, "make room"),
            (libc::EDQUOT, "make room"),
            (libc::EFBIG, "set record.file_mib"),
            (libc::EMFILE, "LimitNOFILE="),
            (libc::ENOENT, "set record.directory"),
            (libc::EACCES, "set record.directory"),
        ] {
            let remedy = of_recording(&io::Error::from_raw_os_error(number));
            assert!(remedy.contains(right), "{number}: {remedy}");
        }
    }

    #[test]
    fn an_error_comes_with_what_helps() {
        use StoreError::{Directory, Read, Write};
        type Failed = fn(PathBuf, io::Error) -> StoreError;
        for (failed, number, right) in [
            (Directory as Failed, libc::ENOSPC, "make room"),
            (Write, libc::ENOSPC, "make room"),
            (Directory, libc::EMFILE, "LimitNOFILE="),
            (Write, libc::ENFILE, "LimitNOFILE="),
            (Read, libc::EMFILE, "LimitNOFILE="),
            (Read, libc::EACCES, "(chown)"),
        ] {
            let error = failed("/folder".into(), io::Error::from_raw_os_error(number));
            let message = with_remedy(&error);
            let remedy = message.strip_prefix(&format!("{error}; ")).unwrap();
            for part in ["make room", "LimitNOFILE=", "(chown)"] {
                assert_eq!(remedy.contains(part), part == right, "{message}");
            }
        }
    }
}
