//! A leaky bucket per client: each answer, error and byte adds a cost, and each second pays off a second of it. Beyond
//! the limit the client is not read from, so that no client keeps the daemon's main thread from its headings. Pure: time
//! comes in as an argument.

use std::time::{Duration, Instant};

/// Debt at which a client has to wait: 100 answers or 10 errors at once.
const MOST: Duration = Duration::from_millis(200);

/// A client that waits is read again once its debt has fallen to this: shorter waits would wake the daemon for each answer.
const REST: Duration = Duration::from_millis(100);

/// An answer: 500 a second.
pub(super) const ANSWER: Duration = Duration::from_millis(2);

/// An answer to what is no request: 50 a second.
pub(super) const ERROR: Duration = Duration::from_millis(20);

/// So many bytes, read and looked at: 250 kB a second.
pub(super) fn bytes(count: usize) -> Duration {
    Duration::from_micros(4 * count as u64)
}

/// What a client has cost lately.
#[derive(Debug)]
pub(super) struct Allowance {
    /// When its debt is, or was, paid off: a second pays off a second.
    paid_off: Instant,
}

impl Allowance {
    /// A client without debt.
    pub(super) fn new(now: Instant) -> Self {
        Self { paid_off: now }
    }

    pub(super) fn spend(&mut self, now: Instant, cost: Duration) {
        self.paid_off = self.paid_off.max(now) + cost;
    }

    /// How long the client has to wait before it is read from again.
    pub(super) fn pause(&self, now: Instant) -> Option<Duration> {
        let debt = self.paid_off.saturating_duration_since(now);
        (debt >= MOST).then(|| debt - REST)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// How often something is done in ten seconds by whoever does it whenever it may, and how often it had to wait.
    fn in_ten_seconds(cost: Duration) -> (u32, u32) {
        let begun = Instant::now();
        let mut now = begun;
        let mut allowance = Allowance::new(now);
        let (mut count, mut pauses) = (0, 0);
        while now < begun + Duration::from_secs(10) {
            match allowance.pause(now) {
                Some(pause) => {
                    now += pause;
                    pauses += 1;
                }
                None => {
                    allowance.spend(now, cost);
                    count += 1;
                }
            }
        }
        (count, pauses)
    }

    #[test]
    fn each_kind_has_its_rate_and_pauses_are_few() {
        for (cost, right) in [
            (ANSWER, 5000..=5100),
            (ERROR, 500..=510),
            (bytes(1024), 2440..=2500),
        ] {
            let (count, pauses) = in_ten_seconds(cost);
            assert!(right.contains(&count), "{count}, {right:?}");
            assert!(pauses <= 100, "{pauses}");
        }
    }

    #[test]
    fn whoever_asks_at_leisure_never_waits() {
        let mut now = Instant::now();
        let mut allowance = Allowance::new(now);
        for _ in 0..10_000 {
            now += Duration::from_millis(10);
            allowance.spend(now, bytes(200));
            allowance.spend(now, ANSWER);
            assert_eq!(allowance.pause(now), None);
        }
    }

    #[test]
    fn a_long_request_is_waited_for_once() {
        let now = Instant::now();
        let mut allowance = Allowance::new(now);
        allowance.spend(now, bytes(262_144));
        let pause = allowance.pause(now).unwrap();
        assert_eq!(allowance.pause(now + pause), None);
    }
}
