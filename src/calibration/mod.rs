//! Calibration.
pub mod model;
pub mod outcome;
