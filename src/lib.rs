//! headingd turns a cheap three-axis magnetometer into a compass that calibrates itself.

pub mod alignment;
pub mod attitude;
pub mod calibration;
pub mod check;
pub mod command;
pub mod condition;
pub mod config;
pub mod daemon;
pub mod date;
pub mod estimate;
pub mod frame;
pub mod frozen;
pub mod heading;
mod lock_file;
pub mod logging;
pub mod outliers;
pub mod pipeline;
pub mod publish;
pub mod reading;
pub mod recording;
pub mod sensor;
pub mod service;
pub mod store;
pub mod true_north;
pub mod turn;
pub mod wall_clock;
