//! Whether the machine was quiet enough for a device to be in time.
//!
//! The kernel hands on the bytes of a pseudo-terminal in a thread of its own, which has to wait for its turn: beside
//! other work it may be seconds, and a board seems silent.

use std::fs::OpenOptions;
use std::io::{ErrorKind, Read, Write};
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use super::device::pty;

/// Whoever hears nothing for this long may notice it.
const STILL: Duration = Duration::from_millis(100);

/// A machine on which it is never quiet has other troubles.
const ATTEMPTS: usize = 8;

/// From one look to the next.
const LOOK: Duration = Duration::from_millis(2);

/// Checks it until it is well. A failure while the machine was quiet is one; any other proves nothing.
pub fn until_quiet(check: impl Fn()) {
    for attempt in 1.. {
        let over = AtomicBool::new(false);
        let (failed, longest) = std::thread::scope(|scope| {
            let probe = scope.spawn(|| longest_way(&over));
            let failed = catch_unwind(AssertUnwindSafe(&check)).err();
            over.store(true, Ordering::Relaxed);
            (failed, probe.join().unwrap())
        });
        match failed {
            None => return,
            Some(why) if longest < STILL || attempt == ATTEMPTS => resume_unwind(why),
            Some(_) => {}
        }
    }
}

/// The longest that a byte was on its way through a pseudo-terminal until it is over.
fn longest_way(over: &AtomicBool) -> Duration {
    let (mut host, node) = pty();
    let mut device = OpenOptions::new().write(true).open(node).unwrap();
    let mut longest = Duration::ZERO;
    while !over.load(Ordering::Relaxed) {
        let sent = Instant::now();
        device.write_all(b"x").unwrap();
        loop {
            std::thread::sleep(LOOK);
            match host.read(&mut [0]) {
                Ok(count) => {
                    assert_eq!(count, 1);
                    break;
                }
                Err(error) => assert_eq!(error.kind(), ErrorKind::WouldBlock),
            }
        }
        longest = longest.max(sent.elapsed());
    }
    longest
}
