//! The one state, and what is ordered of the pipeline: a board moved about, reading by reading.

mod board;
mod gyro;
mod orders;
mod transitions;
