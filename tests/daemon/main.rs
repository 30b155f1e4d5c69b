//! The real program: `run` and `demo`, their sockets, their store and how they end.

mod demo;
mod i2c;
mod rig;
mod run;
mod service;
