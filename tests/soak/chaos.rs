//! Faults at random at a daemon that plays a log ten times as fast as it was made.

use std::fs;
use std::io::Write;
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use rand::{Rng, RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

use crate::health::{descriptors, resident_bytes, threads};
use crate::log;
use crate::rig::{Process, Rig, SEE_ALL, until};
use crate::watcher::{Seen, watch};

const SPEED: f64 = 10.0;

/// What a life of the process may leave behind, bytes: the buffers of a full house of clients are used again.
const GROWTH: u64 = 4 << 20;

/// Lines that a daemon may log in a second: ten times what there is to say.
const LINES_A_SECOND: u64 = 50;

pub fn soak(length: Duration) {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(20_121);
    let rig = Rig::new(SPEED, "");
    let path = rig.path("log.csv");
    let truth = Arc::new(log::write(&path, &mut rng));
    let source = format!("kind = \"replay\"\nlog = {path:?}\n");
    rig.configure(SPEED, &rig.path("store"), &source);

    let begun = Instant::now();
    let seen = Arc::new(Seen::default());
    let mut lives = 0;
    while begun.elapsed() < length {
        let left = length - begun.elapsed();
        // The log takes a minute.
        let life = left.min(Duration::from_secs_f64(rng.random_range(12.0..30.0)));
        let kept = seen.calibrated.load(Ordering::Relaxed);
        let process = rig.start();
        let watcher = watch(rig.client(), truth.clone(), seen.clone(), kept);
        live(&rig, &process, life, &mut rng);
        end(&rig, process, &mut rng);
        watcher.join().expect("what the watcher saw");
        lives += 1;
    }
    assert!(seen.calibrated.load(Ordering::Relaxed), "never calibrated");
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
                sleepers.push(sleeper(rig));
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
        alone(process) <= held
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

fn connect(rig: &Rig) -> Option<UnixStream> {
    UnixStream::connect(rig.path("heading.sock")).ok()
}

/// A client that asks for everything and reads nothing.
fn sleeper(rig: &Rig) -> Option<UnixStream> {
    let mut stream = connect(rig)?;
    writeln!(stream, "?WATCH={SEE_ALL};").ok()?;
    Some(stream)
}

/// One fault or another.
fn fault(rig: &Rig, process: &Process, sleepers: &mut Vec<Option<UnixStream>>, rng: &mut impl Rng) {
    match rng.random_range(0..10) {
        0..3 => drop(sleeper(rig)),
        3..5 => {
            sleepers.push(sleeper(rig));
            if sleepers.len() > 8 {
                sleepers.remove(rng.random_range(0..8));
            }
        }
        5..8 => {
            // Whether it is hung up on in the middle is its own business.
            let length = 1 << rng.random_range(0..17);
            let babble: Vec<u8> = (0..length).map(|_| rng.random()).collect();
            let _ = connect(rig).map(|mut stream| stream.write_all(&babble));
        }
        8 => break_the_store(rig, rng),
        _ => process.signal(["HUP", "USR1"][rng.random_range(0..2)]),
    }
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
fn end(rig: &Rig, mut process: Process, rng: &mut impl Rng) {
    let begun = Instant::now();
    let name = ["TERM", "INT", "KILL"][rng.random_range(0..3)];
    process.signal(name);
    let status = process.wait();
    let said = process.said();
    if name != "KILL" {
        assert!(status.success(), "{status}: {said}");
        assert!(
            begun.elapsed() < Duration::from_secs(1),
            "{:?}",
            begun.elapsed()
        );
        assert!(!rig.path("heading.sock").exists());
    }
    assert!(!said.contains("panicked"), "{said}");
    let lines = said.lines().count() as u64;
    let most = LINES_A_SECOND * (process.age().as_secs() + 1);
    assert!(lines < most, "{lines} lines:\n{said}");
}
