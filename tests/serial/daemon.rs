//! The daemon on a simulated Razor: what comes out is what a replay of the same log gives.

use headingd::sensor::simulator::{Settings, Simulator};

use crate::device::{Device, Firmware, Habits, counts_of};
use crate::rig::{Client, Rig, until};
