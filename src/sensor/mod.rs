//! Sources of readings.

pub mod board;
pub mod bus;
pub mod chip;
pub mod clock;
pub mod i2c;
pub mod replay;
pub mod serial;
pub mod simulator;
