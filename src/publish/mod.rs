//! What goes out of the daemon, and how.

mod client;
mod clients;
pub mod control;
mod feed;
pub mod gpsd;
mod json;
mod link;
mod place;
pub mod raw;
pub mod request;
pub mod server;
mod socket_file;
