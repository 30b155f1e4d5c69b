//! A sensor board behind a serial line: bytes to readings, and a port that may come and go.
//!
//! The codecs are pure: bytes in, in pieces of any size, and readings out. Times come from the clocks, the
//! conversation from the session; only the port and the bridge touch the system.

mod bridge;
mod decoder;
mod device_clock;
mod diagnosis;
mod envelope;
mod item;
mod lateness;
mod lines;
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
pub use device_clock::DeviceClock;
pub use item::Item;
pub use log_rows::LogRows;
pub use razor_binary::RazorBinary;
pub use razor_text::RazorText;
pub use steady_clock::SteadyClock;

use crate::recording::shown;
