//! The real program and its edges: processes, sockets, serial lines, disks, and how it starts and ends.

mod control;
mod demo;
mod disk;
#[path = "../domain/effort.rs"]
mod effort;
#[path = "../soak/health.rs"]
#[allow(dead_code)]
mod health;
mod i2c;
mod north;
mod record;
mod reload;
mod rig;
mod room;
mod run;
mod serial;
mod service;
mod socket;
mod units;
mod views;
