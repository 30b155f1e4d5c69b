//! What follows from readings alone, in memory or from logs: calibrations, headings, conditions, and the commands
//! that play a log. No daemon is started.

mod accuracy;
mod align;
mod calibrate;
mod common;
mod condition;
mod config;
mod effort;
mod manual;
mod paper;
mod pipeline;
mod replay;
mod report;
mod shared;
mod silence;
mod store;
mod true_north;
