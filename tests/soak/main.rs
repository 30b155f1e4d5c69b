//! The daemon under faults and load, for as long as the first argument says, seconds:
//! `cargo test --test soak -- 60`. Without one it is short.
//!
//! A board turns without end, ten times as fast as in real time, in a log with gaps and garbage; clients come, go,
//! babble and sleep; signals arrive; the store breaks and is mended; and now and then the process is ended or
//! killed. Another daemon hangs on a serial line full of noise. At the end nothing may be lost or left over.
//!
//! Then, if a length was given, 31 clients flood a daemon with nonsense, and its headings must come in time.

mod chaos;
#[path = "../daemon/serial/device.rs"]
#[allow(dead_code)]
mod device;
mod flood;
mod health;
mod line;
mod log;
#[path = "../daemon/rig.rs"]
#[allow(dead_code)]
mod rig;
mod watcher;

use std::time::Duration;

/// Of a plain `cargo test`.
const SHORT: Duration = Duration::from_secs(10);

/// The flood is the same all the time.
const FLOOD: Duration = Duration::from_secs(20);

fn main() {
    let mut wanted = None;
    for argument in std::env::args().skip(1) {
        match argument.parse() {
            Ok(seconds) => wanted = Some(Duration::from_secs(seconds)),
            // The name of some other test, or a listing: not meant for this one.
            Err(_) if !argument.starts_with("--") && !"soak".contains(&argument) => return,
            Err(_) if argument == "--list" => return println!("soak: test"),
            Err(_) => {}
        }
    }
    let length = wanted.unwrap_or(SHORT);
    let line = std::thread::spawn(move || line::soak(length));
    chaos::soak(length);
    line.join().expect("the daemon on the line");
    // How late they are is no question for a machine that runs other tests at the same time.
    if let Some(length) = wanted {
        flood::soak(length.min(FLOOD));
    }
    println!("soak: {} s, all is well", length.as_secs());
}
