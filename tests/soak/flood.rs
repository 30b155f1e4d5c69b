//! A daemon that 31 clients ask nonsense at full speed, and one that only watches: its headings come all, and in time.

use std::io::{Read, Write};
use std::net::Shutdown;
use std::os::unix::net::UnixStream;
use std::time::{Duration, Instant};

use crate::PATIENT;
use crate::lateness::{at_most, earliest_s, sorted};
use crate::rig::{LONG, Rig};

const FLOODERS: usize = 31;

/// How late headings may be at the 99th percentile: half the age at which they are stale by default. A busy machine alone makes them
/// late by 35 ms.
const LATE: Duration = Duration::from_millis(250);

/// A machine that has other work to do is late by itself now and then; a daemon that is held up is so every time.
const ATTEMPTS: usize = 4;

/// Until then it is seen how early a heading can be.
const SETTLED: Duration = Duration::from_secs(2);

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
    let mut last_seq = None;
    let mut after_s = Vec::new();
    while begun.elapsed() < SETTLED + length {
        let message = client.next().expect("the daemon has hung up");
        if message["class"] == "ATT" {
            let seq = message["seq"].as_u64().unwrap();
            if let Some(last) = last_seq.replace(seq) {
                assert_eq!(seq, last + 1, "headings were lost");
            }
            let t_s = message["t_s"].as_f64().unwrap();
            after_s.push(begun.elapsed().as_secs_f64() - t_s);
        }
        if flooders.is_empty() && begun.elapsed() > SETTLED {
            flooders = (0..FLOODERS).map(|_| Flooder::start(&rig)).collect();
        }
    }
    let answers: u64 = flooders.into_iter().map(Flooder::end).sum();
    assert!(answers > 50 * FLOODERS as u64, "{answers} answers");
    process.signal("TERM");
    assert!(process.wait().success(), "{}", process.said());

    let late_s = sorted(&after_s, earliest_s(&after_s));
    let at = |share: f64| Duration::from_secs_f64(at_most(share, &late_s));
    let (median, late, latest) = (at(0.5), at(0.99), at(1.0));
    println!(
        "soak: {} headings among {answers} answers to nonsense, late by {median:.1?}, at the 99th percentile by \
         {late:.1?}, at most by {latest:.1?}",
        late_s.len()
    );
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
