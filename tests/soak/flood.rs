//! A daemon that 31 clients ask nonsense at full speed, and one that only watches: its headings come all, and in time.

use std::io::{Read, Write};
use std::net::Shutdown;
use std::os::unix::net::UnixStream;
use std::time::{Duration, Instant};

use crate::PATIENT;
use crate::rig::{LONG, Rig};

const FLOODERS: usize = 31;

/// How late headings may be at the 99th percentile: half the age at which they are stale by default. A busy machine alone makes them
/// late by 35 ms.
const LATE: Duration = Duration::from_millis(250);

/// A machine that has other work to do is late by itself now and then; a daemon that is held up is so every time.
const ATTEMPTS: usize = 4;

/// Until then it is seen how early a heading can be.
const SETTLED: Duration = Duration::from_secs(2);

/// One heading: when it was taken, and when it came.
struct Seen {
    seq: u64,
    t_s: f64,
    at: Instant,
}

pub fn soak(length: Duration) {
    let mut attempts = (0..ATTEMPTS).map(|_| flood(length / 2));
    let late = attempts.find(|late| *late < LATE);
    assert!(late.is_some(), "each time a heading of a hundred was late");
}

/// How late the headings were at the 99th percentile.
fn flood(length: Duration) -> Duration {
    let rig = Rig::new(1.0, &format!("{LONG}{PATIENT}"));
    let (mut process, mut client) = rig.watched();
    let begun = Instant::now();
    let mut flooders = Vec::new();
    let mut seen = Vec::new();
    while begun.elapsed() < SETTLED + length {
        let message = client.next().expect("the daemon has hung up");
        if message["class"] == "ATT" {
            seen.push(Seen {
                seq: message["seq"].as_u64().unwrap(),
                t_s: message["t_s"].as_f64().unwrap(),
                at: Instant::now(),
            });
        }
        if flooders.is_empty() && begun.elapsed() > SETTLED {
            flooders = (0..FLOODERS).map(|_| Flooder::start(&rig)).collect();
        }
    }
    let answers: u64 = flooders.into_iter().map(Flooder::end).sum();
    assert!(answers > 50 * FLOODERS as u64, "{answers} answers");
    process.signal("TERM");
    assert!(process.wait().success(), "{}", process.said());

    for pair in seen.windows(2) {
        assert_eq!(pair[1].seq, pair[0].seq + 1, "headings were lost");
    }
    let lateness = lateness(&seen);
    let at = |share: f64| lateness[(share * (lateness.len() - 1) as f64) as usize];
    let (median, late, latest) = (at(0.5), at(0.99), at(1.0));
    println!(
        "soak: {} headings among {answers} answers to nonsense, late by {median:.1?}, at the 99th percentile by \
         {late:.1?}, at most by {latest:.1?}",
        seen.len()
    );
    late
}

/// How much later than the earliest each heading came, sorted.
fn lateness(seen: &[Seen]) -> Vec<Duration> {
    let first = &seen[0];
    let after_s = |heading: &Seen| {
        let came_s = heading.at.duration_since(first.at).as_secs_f64();
        came_s - (heading.t_s - first.t_s)
    };
    let earliest_s = seen.iter().map(after_s).fold(f64::INFINITY, f64::min);
    let mut late: Vec<_> = seen
        .iter()
        .map(|heading| Duration::from_secs_f64(after_s(heading) - earliest_s))
        .collect();
    late.sort();
    late
}

/// A client that sends `x;` as fast as it is taken, and reads every answer.
struct Flooder {
    stream: UnixStream,
    sender: std::thread::JoinHandle<()>,
    reader: std::thread::JoinHandle<u64>,
}

impl Flooder {
    fn start(rig: &Rig) -> Self {
        let stream = rig.connect("heading.sock");
        let (mut sending, mut reading) = (stream.try_clone().unwrap(), stream.try_clone().unwrap());
        Self {
            stream,
            sender: std::thread::spawn(move || {
                let nonsense = b"x;".repeat(512);
                while sending.write_all(&nonsense).is_ok() {}
            }),
            reader: std::thread::spawn(move || {
                let mut bytes = vec![0; 1 << 16];
                let mut lines = 0;
                while let Ok(count @ 1..) = reading.read(&mut bytes) {
                    lines += bytes[..count].iter().filter(|byte| **byte == b'\n').count() as u64;
                }
                lines
            }),
        }
    }

    /// Hangs up; how many answers there were.
    fn end(self) -> u64 {
        self.stream.shutdown(Shutdown::Both).unwrap();
        self.sender.join().unwrap();
        self.reader.join().unwrap()
    }
}
