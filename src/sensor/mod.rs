//! Sources of readings.

pub mod replay;
pub mod simulator;
