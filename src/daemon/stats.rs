//! Counts what the daemon has done, for a line in the log.

use std::time::Instant;

/// What has been counted since the start.
#[derive(Debug)]
pub(super) struct Stats {
    pub(super) begun: Instant,
    pub(super) readings: u64,
    pub(super) headings: u64,
    pub(super) turns: u64,
    pub(super) accepted: u64,
    pub(super) refused: u64,
    pub(super) faults: u64,
}

impl Stats {
    pub(super) fn new() -> Self {
        Self {
            begun: Instant::now(),
            readings: 0,
            headings: 0,
            turns: 0,
            accepted: 0,
            refused: 0,
            faults: 0,
        }
    }
}
