//! Notices that nothing is heard any more. By a timer of the kernel, which is set now and then: one of tokio's would be
//! put in and taken out with each message, and each wait given a deadline (a twentieth of tests/board/cost).

use std::io::{self, ErrorKind};
use std::time::{Duration, Instant};

use rustix::time::{
    Itimerspec, TimerfdClockId, TimerfdFlags, TimerfdTimerFlags, Timespec, timerfd_create,
    timerfd_settime,
};
use tokio::net::unix::pipe::Receiver;

/// Silence has fallen when nothing was heard for this long.
const SILENCE: Duration = Duration::from_millis(100);

/// Listens for silence.
pub(super) struct Silence {
    /// Readable once it has run out. No pipe, but waited for and read like one.
    timer: Receiver,
    runs_out: Instant,
    heard: Instant,
}

impl Silence {
    /// From now on. Needs a runtime.
    pub(super) fn new() -> io::Result<Self> {
        let flags = TimerfdFlags::NONBLOCK | TimerfdFlags::CLOEXEC;
        let timer = timerfd_create(TimerfdClockId::Monotonic, flags)?;
        let now = Instant::now();
        let mut silence = Self {
            timer: Receiver::from_owned_fd_unchecked(timer)?,
            runs_out: now,
            heard: now,
        };
        silence.set();
        Ok(silence)
    }

    /// Something is heard now.
    pub(super) fn hear(&mut self) {
        self.heard = Instant::now();
        if self.runs_out < self.heard + SILENCE / 2 {
            self.set();
        }
    }

    /// When something was heard last.
    pub(super) fn heard(&self) -> Instant {
        self.heard
    }

    /// Waits until nothing was heard for long enough. Nothing is lost when the wait is given up.
    pub(super) async fn falls(&mut self) {
        loop {
            // An error means that the runtime is at its end, and then nobody waits any more.
            let _ = self.timer.readable().await;
            match self.timer.try_read(&mut [0; size_of::<u64>()]) {
                Err(error) if error.kind() == ErrorKind::WouldBlock => continue,
                _ if self.heard.elapsed() >= SILENCE => return,
                _ => self.set(),
            }
        }
    }

    fn set(&mut self) {
        self.runs_out = self.heard + SILENCE;
        // One that has run out already: nothing would come of a time of 0.
        let left = self.runs_out.saturating_duration_since(Instant::now());
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
    async fn silence_falls_long_enough_after_the_last_word_and_again() {
        let mut silence = Silence::new().unwrap();
        for words in [0, 1, 30, 2] {
            for _ in 0..words {
                // Only a test that is held up itself is silent for that long here.
                let word = timeout(SILENCE / 10, silence.falls()).await;
                assert!(word.is_err() || silence.heard().elapsed() >= SILENCE);
                silence.hear();
            }
            let fell = timeout(Duration::from_secs(30), silence.falls()).await;
            assert!(fell.is_ok(), "after {words} words it never fell");
            assert!(silence.heard().elapsed() >= SILENCE);
            silence.hear();
        }
    }
}
