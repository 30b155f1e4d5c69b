//! Where a socket is, and who may connect to it.

use std::os::unix::ffi::OsStrExt;
use std::path::Path;

use crate::check::Fault;

/// The longest path of a socket, bytes: the system takes 107, and the name under which it is made needs some.
const LONGEST_PATH: usize = 100;

/// Finds what is wrong with the path of a socket.
pub(super) fn check_path(faults: &mut Vec<Fault>, key: &str, path: &Path) {
    let length = path.as_os_str().as_bytes().len();
    if !path.is_absolute() || path.file_name().is_none() || length > LONGEST_PATH {
        faults.push(Fault {
            key: key.into(),
            found: format!("{path:?} ({length} bytes)"),
            right: format!("an absolute path of up to {LONGEST_PATH} bytes"),
        });
    }
}

/// Finds what is wrong with permissions that are at most `most`.
pub(super) fn check_mode(faults: &mut Vec<Fault>, key: &str, mode: &str, most: u32) {
    if mode_bits(mode, most).is_none() {
        faults.push(Fault {
            key: key.into(),
            found: format!("{mode:?}"),
            right: format!(
                "octal permissions in quotes, from \"0600\" to \"{most:04o}\", without execution"
            ),
        });
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
