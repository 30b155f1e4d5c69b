//! The daemon under faults and load, for as long as the first argument says, seconds:
//! `cargo test --test soak -- 60`. Without one it is short. `tests/slow` runs it.
//!
//! A board turns without end, ten times as fast as in real time, in a log with gaps and garbage; clients come, go,
//! babble and sleep; signals arrive; the store breaks and is mended; and now and then the process is ended or
//! killed. Another daemon hangs on a serial line full of noise. At the end nothing may be lost or left over.
//!
//! Then 31 clients flood a daemon with nonsense, and its headings must come in time; and a thousand take the headings of
//! another, which must lose none. With `crowd` as second argument only that.

mod chaos;
mod crowd;
#[path = "../daemon/serial/device.rs"]
#[allow(dead_code)]
mod device;
mod flood;
mod health;
mod lateness;
mod line;
mod log;
#[path = "../daemon/rig.rs"]
#[allow(dead_code)]
mod rig;
mod watcher;

use std::time::Duration;

/// Without an argument.
const SHORT: Duration = Duration::from_secs(10);

/// Where every heading must arrive: a machine that stands still for half a second makes headings stale, and those are rightly sent
/// to nobody.
const PATIENT: &str = "[heading]\nstale_s = 10\n";

/// The flood is the same all the time.
const FLOOD: Duration = Duration::from_secs(20);

fn main() {
    let mut arguments = std::env::args().skip(1);
    let length = arguments.next().map_or(SHORT, |argument| {
        Duration::from_secs(
            argument
                .parse()
                .expect("the argument is a number of seconds"),
        )
    });
    if arguments.next().is_some_and(|argument| argument == "crowd") {
        return crowd::soak(length);
    }
    let line = std::thread::spawn(move || line::soak(length));
    chaos::soak(length);
    line.join().expect("the daemon on the line");
    flood::soak(length.min(FLOOD));
    crowd::soak(length.min(FLOOD));
    println!("soak: {} s, all is well", length.as_secs());
}
