//! What helps against an error of the store.

use std::io::{self, ErrorKind};

use crate::store::StoreError;

/// The error, and what helps.
pub(super) fn with_remedy(error: &StoreError) -> String {
    use StoreError::{Directory, Read, Write};
    let remedy = match error {
        Directory(_, cause) | Read(_, cause) | Write(_, cause) if is_out_of_files(cause) => {
            "have fewer clients, or raise the limit, LimitNOFILE= in the systemd unit"
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
