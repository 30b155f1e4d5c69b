//! What goes out of the daemon, and how.

mod allowance;
mod client;
mod clients;
pub mod control;
mod feed;
mod framing;
pub mod gpsd;
mod inbox;
mod json;
mod link;
pub mod nmea;
mod outgoing;
pub mod outputs;
mod pace;
mod place;
mod places;
pub mod raw;
pub mod request;
pub mod server;
mod signalk;
mod socket_file;
