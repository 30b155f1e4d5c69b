//! What goes out of the daemon, and how.

mod client;
mod feed;
pub mod gpsd;
mod json;
mod link;
pub mod raw;
pub mod request;
pub mod server;
mod socket_file;
