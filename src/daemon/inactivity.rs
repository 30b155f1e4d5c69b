//! Inactivity timer on timerfd; re-arming tokio's timer for each message cost 5 % CPU (tests/board/cost).

use std::io::{self, ErrorKind};
use std::time::{Duration, Instant};

use rustix::time::{
    Itimerspec, TimerfdClockId, TimerfdFlags, TimerfdTimerFlags, Timespec, timerfd_create,
    timerfd_settime,
};
use tokio::net::unix::pipe::Receiver;

/// It fires when no input has arrived for this long.
const LIMIT: Duration = Duration::from_millis(100);

/// Fires when no input arrives for 100 ms.
pub(super) struct Inactivity {
    /// Readable once it has expired. It is no pipe, but is waited for and read like one.
    timer: Receiver,
    expires: Instant,
    restarted: Instant,
}

impl Inactivity {
    /// Starts to count now. Needs a runtime.
    pub(super) fn new() -> io::Result<Self> {
        let flags = TimerfdFlags::NONBLOCK | TimerfdFlags::CLOEXEC;
        let timer = timerfd_create(TimerfdClockId::Monotonic, flags)?;
        let now = Instant::now();
        let mut inactivity = Self {
            timer: Receiver::from_owned_fd_unchecked(timer)?,
            expires: now,
            restarted: now,
        };
        inactivity.arm();
        Ok(inactivity)
    }

    /// Counts anew: input has arrived.
    pub(super) fn restart(&mut self) {
        self.restarted = Instant::now();
        if self.expires < self.restarted + LIMIT / 2 {
            self.arm();
        }
    }

    /// When it was restarted last.
    pub(super) fn restarted(&self) -> Instant {
        self.restarted
    }

    /// Waits until it fires. Nothing is lost when the wait is given up.
    pub(super) async fn fires(&mut self) {
        loop {
            // An error means that the runtime is at its end, and then nobody waits any more.
            let _ = self.timer.readable().await;
            match self.timer.try_read(&mut [0; size_of::<u64>()]) {
                Err(error) if error.kind() == ErrorKind::WouldBlock => continue,
                _ if self.restarted.elapsed() >= LIMIT => return,
                _ => self.arm(),
            }
        }
    }

    fn arm(&mut self) {
        self.expires = self.restarted + LIMIT;
        // A time of 0 would disarm it.
        let left = self.expires.saturating_duration_since(Instant::now());
        let left = left.max(Duration::from_nanos(1));
        let once = Itimerspec {
            it_interval: Timespec::default(),
            it_value: Timespec {
                tv_sec: 0,
                tv_nsec: left.subsec_nanos().into(),
            },
        };
        timerfd_settime(&self.timer, TimerfdTimerFlags::empty(), &once)
            .expect("a timer can be set to less than a second");
    }
}

#[cfg(test)]
mod tests {
    use tokio::time::timeout;

    use super::*;

    #[tokio::test]
    async fn it_fires_long_enough_after_the_last_restart_and_again() {
        let mut inactivity = Inactivity::new().unwrap();
        for inputs in [0, 1, 30, 2] {
            for _ in 0..inputs {
                // Only a test that is held up itself waits for that long here.
                let fired = timeout(LIMIT / 10, inactivity.fires()).await;
                assert!(fired.is_err() || inactivity.restarted().elapsed() >= LIMIT);
                inactivity.restart();
            }
            let fired = timeout(Duration::from_secs(30), inactivity.fires()).await;
            assert!(fired.is_ok(), "after {inputs} inputs it never fired");
            assert!(inactivity.restarted().elapsed() >= LIMIT);
            inactivity.restart();
        }
    }
}
