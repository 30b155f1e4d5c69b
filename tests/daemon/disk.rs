//! A process that is killed while it saves, and disks that are full or may not be written: the file is whole, old or
//! new.

use std::fs;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use headingd::calibration::model::{Calibration, Parameters, Planar};
use headingd::store::{CalibrationRecord, History, Identity, Store};
use nalgebra::{Vector2, Vector3};
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

use crate::effort::times;

/// The folder in which the other process saves.
const FOLDER: &str = "HEADINGD_TEST_FOLDER";

const MANY_KILLS: usize = 1000;
const FEW_KILLS: usize = 100;
const ROUNDS: usize = 4;

fn identity() -> Identity {
    Identity {
        sensor: "hmc5843".to_owned(),
        mag_axes: "+x +y +z".parse().unwrap(),
    }
}

/// The calibration with this number tells it in every value, so that no mixture of two would pass for one.
fn record(number: u64) -> CalibrationRecord {
    let value = number as f64;
    let parameters = Parameters::Planar(Planar {
        basis: [Vector3::x(), Vector3::y()],
        bias_mgauss: Vector2::new(value, -value),
        scale: Vector2::new(1.0, 1.0),
        level: Vector2::zeros(),
    });
    CalibrationRecord {
        saved_unix_s: Some(number),
        origin: None,
        gyro_rms_deg: Some(value),
        samples: Some(number as usize),
        calibration: Calibration::of(parameters, 200.0 + value, 2.0, 0.5),
    }
}

fn load(folder: &Path) -> Option<History> {
    let contents = Store::contents(folder).unwrap();
    assert!(contents.sensors.len() < 2);
    contents.find(&identity()).cloned()
}

/// What the other process does: it saves one calibration after the other, and tells each that is on disk.
#[test]
#[ignore = "the process that is killed; the other test starts it"]
fn saves_until_it_is_killed() {
    let Ok(folder) = std::env::var(FOLDER) else {
        return;
    };
    let store = Store::open(Path::new(&folder)).unwrap();
    let mut known = load(Path::new(&folder));
    loop {
        let mut history = known.clone().unwrap_or_else(|| History::new(identity()));
        history.keep(record(history.last_number + 1), 10);
        assert_eq!(store.save(&history, known.as_ref()).unwrap(), None);
        println!("saved {}", history.last_number);
        known = Some(history);
    }
}

/// Killed if a test fails.
struct Saver(Child);

impl Drop for Saver {
    fn drop(&mut self) {
        // It has been killed already, as a rule.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Saves once, and prints what came of it.
#[test]
#[ignore = "the process whose disk is full; another test starts it"]
fn saves_once() {
    let Ok(folder) = std::env::var(FOLDER) else {
        return;
    };
    let folder = Path::new(&folder);
    let store = match Store::open(folder) {
        Ok(store) => store,
        Err(error) => {
            println!("open: {error}");
            return;
        }
    };
    let known = load(folder);
    let mut history = known.clone().unwrap();
    history.keep(record(history.last_number + 1), 10);
    match store.save(&history, known.as_ref()) {
        Ok(_) => println!("saved"),
        Err(error) => println!("save: {error}"),
    }
}

/// A limit to the size of files does what a full disk does: a write fails, at once or after some bytes.
#[test]
fn on_a_full_disk_the_old_file_stays_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let mut history = History::new(identity());
    for number in 1..=5 {
        history.keep(record(number), 10);
    }
    // Dropped at once: the other processes open it.
    let store = Store::open(folder.path()).unwrap();
    store.save(&history, None).unwrap();
    drop(store);
    let run = |blocks: &str| {
        let script = format!(
            "trap '' XFSZ; ulimit -f {blocks}; exec \"$0\" --exact disk::saves_once --ignored --nocapture"
        );
        let output = Command::new("sh")
            .args(["-c", &script])
            .arg(std::env::current_exe().unwrap())
            .env(FOLDER, folder.path())
            .output()
            .unwrap();
        String::from_utf8(output.stdout).unwrap()
    };
    // Not even the probe; the probe, but not all of a file; all.
    for (blocks, said) in [
        ("0", "open: cannot keep calibrations in folder"),
        ("1", "save: cannot save calibration"),
    ] {
        let out = run(blocks);
        assert!(out.contains(said), "{out}");
        assert_eq!(load(folder.path()), Some(history.clone()));
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }
    assert!(run("unlimited").contains("saved"));
    assert_eq!(load(folder.path()).unwrap().last_number, 6);
}

fn start(folder: &Path) -> Saver {
    let child = Command::new(std::env::current_exe().unwrap())
        .args([
            "--exact",
            "disk::saves_until_it_is_killed",
            "--ignored",
            "--nocapture",
        ])
        .env(FOLDER, folder)
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn();
    Saver(child.unwrap())
}

#[test]
fn killed_at_any_instant_it_leaves_a_whole_file_old_or_new() {
    let kills = times(FEW_KILLS, MANY_KILLS);
    // Side by side, since most of the time a disk is waited for.
    let rounds: Vec<_> = (0..ROUNDS)
        .map(|seed| std::thread::spawn(move || kill_again_and_again(seed, kills / ROUNDS)))
        .collect();
    let in_the_midst: usize = rounds.into_iter().map(|round| round.join().unwrap()).sum();
    println!("{kills} kills, {in_the_midst} of them in the midst of a save");
}

/// How many of the kills were in the midst of a save.
fn kill_again_and_again(seed: usize, kills: usize) -> usize {
    let folder = tempfile::tempdir().unwrap();
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed as u64);
    let mut in_the_midst = 0;
    for kill in 0..kills {
        let mut saver = start(folder.path());
        let mut lines = BufReader::new(saver.0.stdout.take().unwrap()).lines();
        let mut told = 0;
        let mut take = |line: String| {
            if let Some((_, number)) = line.split_once("saved ") {
                told = number.trim().parse().unwrap();
            }
            told > 0
        };
        assert!(lines.by_ref().any(|line| take(line.unwrap())));
        // A save takes a millisecond or some; so the instant may be anywhere in one.
        std::thread::sleep(Duration::from_micros(random.random_range(0..4_000)));
        saver.0.kill().unwrap();
        saver.0.wait().unwrap();
        // What it told before its death and was not yet read.
        for line in lines {
            take(line.unwrap());
        }
        let history = load(folder.path()).expect("the file is gone");
        let newest = history.last_number;
        assert!(
            newest == told || newest == told + 1,
            "seed {seed}, kill {kill}: {newest} in the file, {told} was told"
        );
        assert_eq!(history.active, Some(newest));
        for entry in &history.entries {
            let right = record(entry.number);
            assert_eq!(entry.record, right, "seed {seed}, kill {kill}");
        }
        // Besides the file there is the lock, which nobody holds any more.
        in_the_midst += usize::from(fs::read_dir(folder.path()).unwrap().count() > 2);
    }
    let last = load(folder.path());
    Store::open(folder.path()).unwrap();
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    assert_eq!(load(folder.path()), last);
    in_the_midst
}
