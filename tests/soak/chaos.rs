//! Faults at random at a daemon that plays a log ten times as fast as it was made.

use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use rand::{Rng, RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use serde_json::Value;

use crate::health::{descriptors, resident_bytes, threads};
use crate::log;
use crate::rig::{PATIENCE, Process, Rig, SEE_ALL, until};
use crate::watcher::{Seen, watch};

const SPEED: f64 = 10.0;

/// What a life of the process may leave behind, bytes: the buffers of a full house of clients are used again.
const GROWTH: u64 = 4 << 20;

/// Lines that a daemon may log in a second: three a fault.
const LINES_A_SECOND: u64 = 50;

/// Whatever may be asked at the control socket without the calibration being lost.
const ORDERS: [&str; 7] = [
    r#"{"request":"status"}"#,
    r#"{"request":"list"}"#,
    r#"{"request":"start"}"#,
    r#"{"request":"cancel"}"#,
    r#"{"request":"lock"}"#,
    r#"{"request":"unlock"}"#,
    r#"{"request":"rollback","number":0}"#,
];

pub fn soak(length: Duration) {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(20_121);
    let rig = Rig::new(SPEED, "");
    let path = rig.path("log.csv");
    let truth = Arc::new(log::write(&path, &mut rng));
    let source = format!("kind = \"replay\"\nlog = {path:?}\n");
    rig.configure(SPEED, &rig.path("store"), &source);

    let begun = Instant::now();
    let seen = Arc::new(Seen::default());
    let (mut lives, mut kept) = (0, false);
    while begun.elapsed() < length {
        let left = length - begun.elapsed();
        // The log takes a minute.
        let life = left.min(Duration::from_secs_f64(rng.random_range(12.0..30.0)));
        // What was accepted while the store was broken, and the process killed before it was mended, was never kept.
        let kept_before = kept;
        kept = rig.path("store/calibration.json").exists();
        assert!(kept || !kept_before, "what was kept is lost");
        seen.calibrated.store(kept, Ordering::Relaxed);
        let process = rig.start();
        let watcher = watch(rig.client(), truth.clone(), seen.clone());
        // It is bound after the other.
        rig.connect("control.sock");
        // An answer means that the store was read: from now on it may break.
        order(&rig, ORDERS[0]);
        live(&rig, &process, life, &mut rng);
        end(&rig, process, life, &mut rng);
        watcher.join().expect("what the watcher saw");
        lives += 1;
    }
    assert!(
        seen.headings.load(Ordering::Relaxed) > 0,
        "never calibrated"
    );
    println!(
        "soak: {lives} lives, {} headings, each fresh and right",
        seen.headings.load(Ordering::Relaxed)
    );
}

/// Faults for so long, and then what they have left behind.
fn live(rig: &Rig, process: &Process, life: Duration, rng: &mut impl Rng) {
    let begun = Instant::now();
    // The first calibration is let be made: what it costs in memory is no leak.
    let settled = life.min(Duration::from_secs(3));
    let mut sleepers = Vec::new();
    let mut before = None;
    while begun.elapsed() < life {
        if before.is_none() && begun.elapsed() >= settled {
            // A full house once, so that its buffers count as there already.
            for _ in 0..8 {
                sleepers.push(watching(rig));
            }
            sleepers.clear();
            before = Some((alone(process), resident_bytes(process.id())));
        }
        fault(rig, process, &mut sleepers, rng);
        std::thread::sleep(Duration::from_millis(rng.random_range(5..80)));
    }
    drop(sleepers);
    let Some((held, bytes)) = before else {
        return;
    };
    until("what clients held to be given back", || {
        let now = alone(process);
        now.0 <= held.0 && now.1 <= held.1
    });
    let grown = resident_bytes(process.id()).saturating_sub(bytes);
    assert!(grown < GROWTH, "memory has grown by {grown} bytes");
}

/// Descriptors and threads once all clients but the watcher are seen to have gone.
fn alone(process: &Process) -> (usize, usize) {
    let mut least = (usize::MAX, usize::MAX);
    let begun = Instant::now();
    while begun.elapsed() < Duration::from_millis(300) {
        let now = (descriptors(process.id()), threads(process.id()));
        least = (least.0.min(now.0), least.1.min(now.1));
        std::thread::sleep(Duration::from_millis(10));
    }
    least
}

fn connect(rig: &Rig, name: &str) -> Option<UnixStream> {
    UnixStream::connect(rig.path(name)).ok()
}

/// A client that asks for everything and reads nothing.
fn watching(rig: &Rig) -> Option<UnixStream> {
    let mut stream = connect(rig, "heading.sock")?;
    writeln!(stream, "?WATCH={SEE_ALL};").ok()?;
    Some(stream)
}

/// One fault or another.
fn fault(rig: &Rig, process: &Process, sleepers: &mut Vec<Option<UnixStream>>, rng: &mut impl Rng) {
    match rng.random_range(0..12) {
        0..3 => drop(watching(rig)),
        3..5 => {
            sleepers.push(watching(rig));
            if sleepers.len() > 8 {
                sleepers.remove(rng.random_range(0..8));
            }
        }
        5..8 => {
            let name = ["heading.sock", "control.sock"][rng.random_range(0..2)];
            let length = 1 << rng.random_range(0..17);
            let babble: Vec<u8> = (0..length).map(|_| rng.random()).collect();
            // Whether it is hung up on in the middle is its own business.
            let _ = connect(rig, name).map(|mut stream| stream.write_all(&babble));
        }
        8..10 => order(rig, ORDERS[rng.random_range(0..ORDERS.len())]),
        10 => break_the_store(rig, rng),
        _ => wrong_configuration(rig, process, rng),
    }
}

/// Every order has an answer.
fn order(rig: &Rig, order: &str) {
    let mut stream = connect(rig, "control.sock").expect("the control socket");
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    // Where there was no room it is hung up on already, but has the answer that says so.
    let _ = writeln!(stream, "{order}");
    let mut line = String::new();
    BufReader::new(stream).read_line(&mut line).unwrap();
    let answer: Value = serde_json::from_str(&line).unwrap_or_else(|e| panic!("{e}: {line:?}"));
    assert!(
        answer["ok"].is_boolean() && answer["code"].is_string(),
        "{line}"
    );
}

/// A reload of a file that is wrong, and other signals.
fn wrong_configuration(rig: &Rig, process: &Process, rng: &mut impl Rng) {
    if rng.random_bool(0.5) {
        return process.signal("USR1");
    }
    let path = rig.path("headingd.toml");
    let right = fs::read_to_string(&path).unwrap();
    let wrong = right.replacen('=', "~", rng.random_range(0..3));
    // As a whole: half a file may be a good one.
    let replace = |text: String| {
        let new = rig.path("headingd.toml.new");
        fs::write(&new, text).unwrap();
        fs::rename(&new, &path).unwrap();
    };
    replace(wrong);
    process.signal("HUP");
    // Whether it is read before or after it is right again makes no difference.
    replace(right);
}

/// For a moment there is a file where the folder was.
fn break_the_store(rig: &Rig, rng: &mut impl Rng) {
    let (store, aside) = (rig.path("store"), rig.path("aside"));
    if fs::rename(&store, &aside).is_err() {
        return;
    }
    fs::write(&store, "not a folder").unwrap();
    std::thread::sleep(Duration::from_millis(rng.random_range(1..50)));
    fs::remove_file(&store).unwrap();
    fs::rename(&aside, &store).unwrap();
}

/// Ends the process in one way or another.
fn end(rig: &Rig, mut process: Process, life: Duration, rng: &mut impl Rng) {
    let name = ["TERM", "INT", "KILL"][rng.random_range(0..3)];
    process.signal(name);
    let status = process.wait();
    let said = process.said();
    if name != "KILL" {
        assert!(status.success(), "{status}: {said}");
        assert!(!rig.path("heading.sock").exists());
    }
    assert!(!said.contains("panicked"), "{said}");
    let lines = said.lines().count() as u64;
    let most = LINES_A_SECOND * (life.as_secs() + 1);
    assert!(lines < most, "{lines} lines:\n{said}");
}
