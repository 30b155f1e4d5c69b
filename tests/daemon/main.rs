//! The real program: `run` and `demo`, their sockets, their store and how they end.

mod demo;
mod rig;
mod run;
