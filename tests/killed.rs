//! A process that is killed while it saves: whatever the instant, the file is whole, old or new.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use headingd::calibration::model::{Calibration, Parameters, Planar};
use headingd::store::{History, Identity, Loaded, Made, Store};
use nalgebra::{Vector2, Vector3};
use rand::{RngExt, SeedableRng};

/// The folder in which the other process saves.
const FOLDER: &str = "HEADINGD_TEST_FOLDER";

const KILLS: usize = 1000;

fn identity() -> Identity {
    Identity {
        sensor: "hmc5843".to_owned(),
        mag_axes: "+x +y +z".parse().unwrap(),
    }
}

/// The calibration with this number tells it in every value, so that no mixture of two would pass for one.
fn made(number: u64) -> Made {
    let value = number as f64;
    Made {
        saved_unix_s: Some(number),
        reason: None,
        gyro_rms_deg: Some(value),
        samples: Some(number as usize),
        calibration: Calibration {
            parameters: Parameters::Planar(Planar {
                basis: [Vector3::x(), Vector3::y()],
                bias_mgauss: Vector2::new(value, -value),
                scale: Vector2::new(1.0, 1.0),
                level: Vector2::zeros(),
            }),
            reference_mgauss: None,
            strength_mgauss: 200.0 + value,
            residual_mgauss: 2.0,
            heading_sd_deg: 0.5,
        },
    }
}

fn load(store: &Store) -> Option<History> {
    match store.load(&identity()).unwrap() {
        Loaded::Found(history) => Some(history),
        other => {
            assert_eq!(other, Loaded::None);
            None
        }
    }
}

/// What the other process does: it saves one calibration after the other, and tells each that is on disk.
#[test]
#[ignore = "the process that is killed; the other test starts it"]
fn saves_until_it_is_killed() {
    let Ok(folder) = std::env::var(FOLDER) else {
        return;
    };
    let store = Store::open(Path::new(&folder)).unwrap();
    let mut known = load(&store);
    loop {
        let mut history = known.clone().unwrap_or_else(|| History::new(identity()));
        history.keep(made(history.last_number + 1), 10);
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

fn start(folder: &Path) -> Saver {
    let child = Command::new(std::env::current_exe().unwrap())
        .args([
            "--exact",
            "saves_until_it_is_killed",
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
    let folder = tempfile::tempdir().unwrap();
    let store = Store::unchecked(folder.path());
    let mut random = rand_xoshiro::Xoshiro256PlusPlus::seed_from_u64(1);
    let mut in_the_midst = 0;
    for kill in 0..KILLS {
        let mut saver = start(folder.path());
        let mut lines = BufReader::new(saver.0.stdout.take().unwrap()).lines();
        let mut told = 0;
        let mut take = |line: String| {
            if let Some((_, number)) = line.split_once("saved ") {
                told = number.trim().parse().unwrap();
            }
            told > 0
        };
        assert!(
            lines.by_ref().any(|line| take(line.unwrap())),
            "kill {kill}"
        );
        // A save takes a millisecond or some; so the instant may be anywhere in one.
        let begun = Instant::now();
        let instant = Duration::from_micros(random.random_range(0..5_000));
        while begun.elapsed() < instant {
            std::hint::spin_loop();
        }
        saver.0.kill().unwrap();
        saver.0.wait().unwrap();
        // What it told before its death and was not yet read.
        for line in lines {
            take(line.unwrap());
        }
        let history = load(&store).expect("the file is gone");
        let newest = history.last_number;
        assert!(
            newest == told || newest == told + 1,
            "kill {kill}: {newest} in the file, {told} was told"
        );
        assert_eq!(history.in_force, Some(newest));
        for entry in &history.entries {
            assert_eq!(entry.made, made(entry.number), "kill {kill}");
        }
        in_the_midst += usize::from(std::fs::read_dir(folder.path()).unwrap().count() > 1);
    }
    // Otherwise it was never in the midst of a save.
    assert!(in_the_midst > KILLS / 20, "{in_the_midst}");
    let last = load(&store);
    Store::open(folder.path()).unwrap();
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    assert_eq!(load(&store), last);
}
