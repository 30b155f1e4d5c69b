//! The gpsd-dialect server at its real edge: a Unix socket, and clients that behave well, badly or not at all.

mod dialect;
mod file;
mod load;
mod outputs;
mod rig;
