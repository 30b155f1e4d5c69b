//! The real program and its edges: processes, sockets, serial lines, disks, and how it starts and ends.

mod control;
mod demo;
mod disk;
mod i2c;
mod record;
mod rig;
mod run;
mod serial;
mod service;
mod socket;
mod units;
