//! What goes out of the daemon, and how.

mod admission;
mod allowance;
mod client;
mod clients;
mod connection;
pub(crate) mod control;
mod feed;
pub mod framing;
pub mod gpsd;
mod inbox;
mod json;
pub mod nmea;
pub mod outputs;
mod rate_limit;
pub(crate) mod raw;
pub mod request;
pub mod server;
mod signalk;
mod socket_file;

pub(crate) use clients::OUT_OF_FILES;
