//! The time of day, where the system knows it.

use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use crate::date::CREDIBLE;

/// The time of day at a recent moment, since 1970; `None` if the system's clock was never set.
pub fn at(moment: Instant) -> Option<Duration> {
    since_1970(SystemTime::now().checked_sub(moment.elapsed())?)
}

/// Now, as [`at`] has it.
pub fn now() -> Option<Duration> {
    since_1970(SystemTime::now())
}

/// Seconds since 1970 by the system's clock; `None` if that was never set.
pub fn unix_now_s() -> Option<u64> {
    now().map(|since| since.as_secs())
}

fn since_1970(time: SystemTime) -> Option<Duration> {
    let since = time.duration_since(UNIX_EPOCH).ok()?;
    (since >= CREDIBLE).then_some(since)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_moment_ago_is_earlier_than_now() {
        let now = Instant::now();
        let (earlier, later) = (at(now - Duration::from_secs(2)), at(now));
        assert!(earlier.is_some() && earlier < later);
    }
}
