//! The commands that show a running daemon, and those that wait for it.

mod monitor;
mod readme;
mod usual;
mod wait;
mod watch;
