//! The control socket of the real program, and the commands that use it.

#[path = "../daemon/rig.rs"]
#[allow(dead_code)]
mod rig;

mod commands;
mod link;
mod orders;
mod socket;
mod trouble;
