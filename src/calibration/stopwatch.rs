//! How long the steps of a calibration take.

use std::time::Duration;

/// A stopwatch over a clock that may not know the time.
pub struct Stopwatch<'a> {
    clock: &'a dyn Fn() -> Option<Duration>,
    start: Option<Duration>,
}

impl<'a> Stopwatch<'a> {
    pub fn start(clock: &'a dyn Fn() -> Option<Duration>) -> Self {
        Self {
            clock,
            start: clock(),
        }
    }

    pub fn elapsed_us(&self) -> Option<u64> {
        let elapsed = (self.clock)()?.checked_sub(self.start?)?;
        Some(u64::try_from(elapsed.as_micros()).unwrap_or(u64::MAX))
    }
}
