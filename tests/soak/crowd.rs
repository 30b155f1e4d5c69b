//! A thousand clients that take every heading at 50 Hz, and one that takes nothing.
//!
//! One thread reads for all of them, so that they cost no more than the daemon. How late headings come is printed, beside
//! the same for a few clients: a slow machine is late by itself.

use std::fs;
use std::io::{Read, Write};
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::time::{Duration, Instant};

use rustix::buffer::spare_capacity;
use rustix::event::{Timespec, epoll};
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

use crate::PATIENT;
use crate::health::{resident_bytes, running_time};
use crate::lateness::{at_most, earliest_s, sorted};
use crate::rig::{LONG, PATIENCE, Rig};

const FEW: usize = 3;
const MANY: usize = 1000;

/// Headings a second.
const RATE_HZ: usize = 50;

/// Resident memory that the daemon may take, bytes.
const MEMORY: u64 = 64 << 20;

/// What the daemon needs, which inherits the limit, with some to spare; this process needs half of it.
const FILES: u64 = 2 * MANY as u64 + 100;

pub fn soak(length: Duration) {
    raise_limit_of_files();
    let rig = Rig::new(1.0, &format!("{LONG}mag_rate_hz = {RATE_HZ}\n{PATIENT}"));
    let config = rig.path("headingd.toml");
    let text = fs::read_to_string(&config).unwrap();
    // One that takes nothing is kept to the end.
    let places = format!("[socket]\nmax_clients = {}\nwrite_timeout_s = 60", MANY + 1);
    fs::write(&config, text.replace("[socket]", &places)).unwrap();
    let mut process = rig.start();

    let begun = Instant::now();
    let few = Crowd::gather(&rig, FEW).watch(process.id(), begun, length / 4);
    let stalled = connect(&rig);
    let many = Crowd::gather(&rig, MANY).watch(process.id(), begun, length);
    let resident = resident_bytes(process.id());
    drop(stalled);
    process.signal("TERM");
    assert!(process.wait().success(), "{}", process.said());

    let earliest_s = earliest_s(&few.after_s).min(earliest_s(&many.after_s));
    few.print(FEW, earliest_s);
    many.print(MANY, earliest_s);
    println!(
        "soak: the daemon has {:.1} MiB",
        resident as f64 / (1 << 20) as f64
    );
    assert!(resident < MEMORY, "{resident} bytes of memory");
    assert_eq!((few.lost, many.lost), (0, 0), "headings were lost");
}

fn raise_limit_of_files() {
    let limit = getrlimit(Resource::Nofile);
    if limit.current.is_some_and(|current| current < FILES) {
        let current = Some(FILES.min(limit.maximum.unwrap_or(FILES)));
        setrlimit(Resource::Nofile, Rlimit { current, ..limit }).unwrap();
    }
}

/// A client that asks for headings, and has not taken any yet.
fn connect(rig: &Rig) -> UnixStream {
    let mut stream = rig.connect("heading.sock");
    stream.write_all(b"?WATCH={\"enable\":true}").unwrap();
    stream
}

/// Clients that take what they are sent.
struct Crowd {
    clients: Vec<Client>,
    epoll: OwnedFd,
}

struct Client {
    stream: UnixStream,
    /// A line of which the end has not come yet.
    begun: Vec<u8>,
    seq: Option<u64>,
}

/// What a crowd has seen.
#[derive(Default)]
struct Seen {
    /// How long after its sample's own time each heading came, seconds, from an unknown origin.
    after_s: Vec<f64>,
    lost: u64,
    /// Shares of one core.
    daemon: f64,
    own: f64,
}

impl Crowd {
    fn gather(rig: &Rig, count: usize) -> Self {
        let epoll = epoll::create(epoll::CreateFlags::CLOEXEC).unwrap();
        let client = |number| {
            let stream = connect(rig);
            let number = epoll::EventData::new_u64(number as u64);
            epoll::add(&epoll, &stream, number, epoll::EventFlags::IN).unwrap();
            Client {
                stream,
                begun: Vec::new(),
                seq: None,
            }
        };
        Self {
            clients: (0..count).map(client).collect(),
            epoll,
        }
    }

    /// Takes what comes for so long, after everybody has got something.
    fn watch(mut self, daemon: u32, begun: Instant, length: Duration) -> Seen {
        self.take(begun, PATIENCE, |clients| {
            clients.iter().all(|client| client.seq.is_some())
        });
        let cost = || [daemon, std::process::id()].map(running_time);
        let (from, before) = (Instant::now(), cost());
        let mut seen = self.take(begun, length, |_| false);
        let passed_s = from.elapsed().as_secs_f64();
        let after = cost();
        let [of_daemon, own] = [0, 1].map(|i| (after[i] - before[i]).as_secs_f64() / passed_s);
        (seen.daemon, seen.own) = (of_daemon, own);
        seen
    }

    fn take(
        &mut self,
        begun: Instant,
        length: Duration,
        enough: impl Fn(&[Client]) -> bool,
    ) -> Seen {
        let mut seen = Seen::default();
        let mut events = Vec::with_capacity(self.clients.len());
        let mut bytes = vec![0; 1 << 16];
        let patience = Timespec::try_from(PATIENCE).unwrap();
        let from = Instant::now();
        while from.elapsed() < length && !enough(&self.clients) {
            events.clear();
            let there = epoll::wait(&self.epoll, spare_capacity(&mut events), Some(&patience));
            assert!(there.unwrap() > 0, "waited in vain for headings");
            for event in &events {
                let number = event.data.u64() as usize;
                let client = &mut self.clients[number];
                let count = client.stream.read(&mut bytes).unwrap();
                assert!(count > 0, "the daemon has hung up");
                client.take(&bytes[..count], begun.elapsed().as_secs_f64(), &mut seen);
            }
        }
        seen
    }
}

impl Client {
    fn take(&mut self, bytes: &[u8], at_s: f64, seen: &mut Seen) {
        let whole;
        let mut lines = bytes;
        if !self.begun.is_empty() {
            self.begun.extend_from_slice(bytes);
            whole = std::mem::take(&mut self.begun);
            lines = &whole;
        }
        while let Some(end) = lines.iter().position(|byte| *byte == b'\n') {
            if lines.starts_with(br#"{"class":"ATT""#) {
                self.take_heading(&lines[..end], at_s, seen);
            }
            lines = &lines[end + 1..];
        }
        self.begun.extend_from_slice(lines);
    }

    fn take_heading(&mut self, line: &[u8], at_s: f64, seen: &mut Seen) {
        let seq = number(line, b"\"seq\":") as u64;
        if let Some(last) = self.seq.replace(seq) {
            seen.lost += seq - last - 1;
        }
        seen.after_s.push(at_s - number(line, b"\"t_s\":"));
    }
}

/// The number behind this key: to parse the JSON of each line would cost more than the daemon.
fn number(line: &[u8], key: &[u8]) -> f64 {
    let at = line.windows(key.len()).position(|window| window == key);
    let rest = &line[at.unwrap() + key.len()..];
    let end = rest.iter().position(|byte| matches!(byte, b',' | b'}'));
    let text = std::str::from_utf8(&rest[..end.unwrap()]).unwrap();
    text.parse().unwrap()
}

impl Seen {
    fn print(&self, clients: usize, earliest_s: f64) {
        let late_s = sorted(&self.after_s, earliest_s);
        let at_ms = |share: f64| 1000.0 * at_most(share, &late_s);
        let came = late_s.len() as f64;
        println!(
            "soak: {clients} clients at {RATE_HZ} Hz: {came} headings, {:.3} % of all; late by {:.1} ms (median), \
             {:.1} ms (99 %), {:.1} ms (99.9 %), {:.1} ms (most); the daemon takes {:.1} % of a core, the clients {:.1} %",
            100.0 * came / (came + self.lost as f64),
            at_ms(0.5),
            at_ms(0.99),
            at_ms(0.999),
            at_ms(1.0),
            100.0 * self.daemon,
            100.0 * self.own
        );
    }
}
