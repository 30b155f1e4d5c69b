//! Notices that no input arrives.

use std::time::{Duration, Instant};

use tokio::time::{Interval, MissedTickBehavior, interval};

/// It fires when no input has arrived for this long.
const LIMIT: Duration = Duration::from_millis(100);

/// Fires 100 to 150 ms after the last `restart`. The caller restarts it at each input, and each time that it has fired.
pub(super) struct Inactivity {
    /// Ticks on, whatever arrives: to set a timer anew for each input cost 5 % of the daemon's time (tests/board/cost).
    ticks: Interval,
    /// When the count last began: input arrived, or it fired.
    since: Instant,
}

impl Inactivity {
    /// Starts to count now. Needs a runtime.
    pub(super) fn new() -> Self {
        let mut ticks = interval(LIMIT / 2);
        ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
        Self {
            ticks,
            since: Instant::now(),
        }
    }

    /// Counts anew from now.
    pub(super) fn restart(&mut self) {
        self.since = Instant::now();
    }

    /// Waits until it fires. Nothing is lost when the wait is given up.
    pub(super) async fn fires(&mut self) {
        while self.since.elapsed() < LIMIT {
            self.ticks.tick().await;
        }
    }
}

#[cfg(test)]
mod tests {
    use tokio::time::timeout;

    use super::*;

    #[tokio::test]
    async fn it_fires_long_enough_after_the_last_restart_and_again() {
        let mut inactivity = Inactivity::new();
        for inputs in [0, 1, 30, 2] {
            for _ in 0..inputs {
                // Only a test that is held up itself waits for that long here.
                let fired = timeout(LIMIT / 10, inactivity.fires()).await;
                assert!(fired.is_err() || inactivity.since.elapsed() >= LIMIT);
                inactivity.restart();
            }
            let fired = timeout(Duration::from_secs(30), inactivity.fires()).await;
            assert!(fired.is_ok(), "after {inputs} inputs it never fired");
            assert!(inactivity.since.elapsed() >= LIMIT);
            inactivity.restart();
        }
    }
}
