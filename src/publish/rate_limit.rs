//! How often a client is sent headings.

use std::time::{Duration, Instant};

/// Lets through as many of what comes as a rate allows, evenly; everything without a rate. Pure: time comes in.
#[derive(Debug, Default)]
pub(super) struct RateLimit {
    period: Option<Duration>,
    due: Option<Instant>,
}

impl RateLimit {
    /// At most so many a second.
    pub(super) fn new(rate_hz: Option<f64>) -> Self {
        Self {
            period: rate_hz.map(|rate_hz| Duration::from_secs_f64(1.0 / rate_hz)),
            due: None,
        }
    }

    /// Whether what was taken then may go out. What is due is counted from the first, so that readings that come a little
    /// early or late do not lower the rate; after a gap it is counted anew.
    pub(super) fn admits(&mut self, taken: Instant) -> bool {
        let Some(period) = self.period else {
            return true;
        };
        let due = *self.due.get_or_insert(taken);
        if taken < due {
            return false;
        }
        let next = due + period;
        self.due = Some(if next < taken { taken + period } else { next });
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// How many of ten seconds of readings go out, each some milliseconds late.
    fn admitted(rate_hz: Option<f64>, period_ms: u64, late_ms: impl Fn(u64) -> u64) -> usize {
        let begun = Instant::now();
        let mut pace = RateLimit::new(rate_hz);
        (0..10_000 / period_ms)
            .filter(|n| pace.admits(begun + Duration::from_millis(n * period_ms + late_ms(*n))))
            .count()
    }

    #[test]
    fn a_rate_is_kept_whatever_that_of_the_readings() {
        let even = |_| 0;
        assert_eq!(admitted(None, 20, even), 500);
        assert_eq!(admitted(Some(10.0), 25, even), 100);
        assert_eq!(admitted(Some(10.0), 20, even), 100);
        // No reading is sent twice.
        assert_eq!(admitted(Some(100.0), 25, even), 400);
        // Four out of ten.
        assert_eq!(admitted(Some(20.0), 20, even), 200);
        assert_eq!(admitted(Some(0.1), 20, even), 1);
        for jitter in [1, 7, 19] {
            let count = admitted(Some(10.0), 20, |n| n * 7919 % jitter);
            assert!((99..=101).contains(&count), "{jitter} ms: {count}");
        }
    }

    #[test]
    fn after_a_gap_nothing_is_made_up_for() {
        let begun = Instant::now();
        let mut pace = RateLimit::new(Some(10.0));
        let at = |ms| begun + Duration::from_millis(ms);
        let found = [0, 50, 100, 60_000, 60_020, 60_099, 60_100].map(|ms| pace.admits(at(ms)));
        assert_eq!(found, [true, false, true, true, false, false, true]);
    }
}
