//! A sensor board behind a serial line: bytes to readings, and a port that may come and go.
//!
//! The codecs are pure: bytes in, in pieces of any size, and readings out. Times come from the clocks, the
//! conversation from the session; only the port and the bridge touch the system.

mod bridge;
mod decoder;
mod device_clock;
mod diagnosis;
mod envelope;
mod log_rows;
mod port;
mod razor;
mod razor_binary;
mod razor_text;
mod session;
pub mod settings;
mod start;
mod steady_clock;

pub use bridge::Bridge;
pub use log_rows::LogRows;
pub use razor_binary::RazorBinary;
pub use razor_text::RazorText;
pub use steady_clock::SteadyClock;

use crate::reading::Reading;
use crate::recording::shown;

/// One item from a device.
#[derive(Clone, Debug, PartialEq)]
pub enum Item {
    /// The sensors at the device's next tick. The device sends no time: `t_s` is 0.
    Frame(Reading),
    /// The sensors at a time of the device's own clock.
    Timed(Reading),
    /// A row that will count if no header comes.
    Early,
    /// A header: the rows before it were read in other units or axes.
    NewUnits,
    /// The answer to a request for synchronisation, with the two bytes that were asked for.
    Synch([u8; 2]),
    /// The device sends, but in this mode, which is of no use here.
    OtherMode(&'static str),
    /// Bytes that cannot be used, and why.
    Bad(String),
    /// What is wrong with the device's header, at its line and at each row after it.
    BadHeader(String),
    /// A line that does not end.
    TooLong,
}
