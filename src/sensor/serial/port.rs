//! Opening a serial port, and why it cannot be opened.

use std::fs;
use std::io::{self, ErrorKind};
use std::os::unix::fs::FileTypeExt;

use tokio_serial::{ClearBuffer, SerialPort, SerialPortBuilderExt, SerialStream};

use super::settings::Settings;
use crate::condition::SourceFault;

/// How tokio_serial reports ENOTTY, for which it has no kind.
const NO_TERMINAL: &str = "Not a typewriter";

/// Opens the port for this process alone: 8 data bits, no parity, 1 stop bit, no flow control. Most boards
/// take that as a reset, since the system raises DTR. Needs a runtime.
pub(super) fn open(settings: &Settings) -> Result<SerialStream, SourceFault> {
    let path = settings.port.display();
    let fail = |code, what: &str| SourceFault {
        code,
        message: format!("cannot open serial port {path}: {what}"),
    };
    let by_system = |error: &io::Error| match error.kind() {
        ErrorKind::NotFound => fail(
            "no_device",
            "there is none; waiting until it is plugged in (or set serial.port to one in /dev/serial/by-id)",
        ),
        ErrorKind::PermissionDenied => fail(
            "permission",
            "permission denied; join the port's group (usually dialout) and log in again",
        ),
        ErrorKind::ResourceBusy | ErrorKind::WouldBlock => fail(
            "busy",
            "another program holds it; stop that one (a terminal, ModemManager, another headingd)",
        ),
        _ => fail("port", &error.to_string()),
    };
    let no_terminal = || fail("port", "it is no terminal device; set serial.port to one");
    let found = fs::metadata(&settings.port).map_err(|error| by_system(&error))?;
    if !found.file_type().is_char_device() {
        return Err(no_terminal());
    }
    let stream = tokio_serial::new(settings.port.to_string_lossy(), settings.baud)
        .open_native_async()
        .map_err(|error| match error.kind {
            tokio_serial::ErrorKind::Io(kind) => {
                by_system(&io::Error::new(kind, error.description))
            }
            // tokio_serial reports a locked port as NoDevice.
            tokio_serial::ErrorKind::NoDevice => by_system(&ErrorKind::ResourceBusy.into()),
            _ if error.description == NO_TERMINAL => no_terminal(),
            _ => fail("port", &error.description),
        })?;
    // What was sent at another speed, before the port was set up.
    let _ = stream.clear(ClearBuffer::Input);
    Ok(stream)
}
