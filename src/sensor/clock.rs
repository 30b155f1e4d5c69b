//! The clock of a live source. Tests bring their own, which does not wait.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use rustix::time::{ClockId, clock_gettime};

/// A waiting thread checks this often whether it must stop.
const LOOK: Duration = Duration::from_millis(50);

/// Time from an origin of its own, and waiting.
pub trait Clock {
    /// Seconds since the origin; never goes back.
    fn now_s(&self) -> f64;

    /// Waits until `t_s`; false as soon as the clock is told to stop.
    #[must_use]
    fn wait_until(&mut self, t_s: f64) -> bool;
}

/// Time since boot, suspended time included, so that readings show a gap in which the board may have turned; an `Instant` leaves
/// that time out.
pub(super) fn since_boot() -> Duration {
    let now = clock_gettime(ClockId::Boottime);
    // The kernel's value is normalised and not negative.
    Duration::new(now.tv_sec as u64, now.tv_nsec as u32)
}

/// Seconds since then, by the same clock.
pub(super) fn elapsed_s(since: Duration) -> f64 {
    since_boot().saturating_sub(since).as_secs_f64()
}

/// The system's clock, which never goes back.
#[derive(Clone, Debug)]
pub struct SystemClock {
    origin: Duration,
    stop: Arc<AtomicBool>,
}

impl SystemClock {
    /// A clock that begins now, and whose waiting ends when `stop` becomes true.
    pub fn new(stop: Arc<AtomicBool>) -> Self {
        Self {
            origin: since_boot(),
            stop,
        }
    }
}

impl Clock for SystemClock {
    fn now_s(&self) -> f64 {
        elapsed_s(self.origin)
    }

    fn wait_until(&mut self, t_s: f64) -> bool {
        loop {
            if self.stop.load(Ordering::Relaxed) {
                return false;
            }
            let left_s = t_s - self.now_s();
            if left_s <= 0.0 {
                return true;
            }
            thread::sleep(Duration::from_secs_f64(left_s.min(LOOK.as_secs_f64())));
        }
    }
}
