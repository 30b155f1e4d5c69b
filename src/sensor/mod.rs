//! Sources of readings.

pub mod replay;
pub mod serial;
pub mod simulator;
