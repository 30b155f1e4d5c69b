//! The control socket of the real program, and the commands that use it.

mod commands;
pub mod link;
mod long;
mod mounting;
mod requests;
mod socket;
mod trouble;
