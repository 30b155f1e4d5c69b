//! What the tests of whole commands share: simulated logs, and running the program on them.
use std::fs;

use headingd::reading::Reading;
use headingd::recording::{Entry, Header, written};
use headingd::sensor::simulator::{Scenario, Settings, Simulator};
use nalgebra::{Rotation3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use serde_json::Value;
use tempfile::TempDir;

pub use crate::shared::{apart_deg, finished, program};

/// What a run of the program came to.
#[derive(Debug)]
pub struct Ran {
    pub status: i32,
    pub out: String,
    pub err: String,
}

impl Ran {
    /// Standard output as one JSON object.
    pub fn json(&self) -> Value {
        serde_json::from_str(&self.out).unwrap_or_else(|error| panic!("{error}: {self:?}"))
    }

    /// Standard output as one JSON object a line.
    pub fn lines(&self) -> Vec<Value> {
        let parse = |line| serde_json::from_str(line).unwrap_or_else(|e| panic!("{e}: {line}"));
        self.out.lines().map(parse).collect()
    }
}

/// Runs the program.
pub fn headingd(args: &[&str]) -> Ran {
    let (status, out, err) = finished(program().args(args));
    Ran { status, out, err }
}

/// A folder of files that goes away with its handle.
pub struct Folder(pub TempDir);

impl Folder {
    pub fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    /// The path of a file in it, which need not exist.
    pub fn path(&self, name: &str) -> String {
        self.0.path().join(name).to_str().unwrap().to_owned()
    }

    /// Writes a file and returns its path.
    pub fn file(&self, name: &str, bytes: impl AsRef<[u8]>) -> String {
        let path = self.path(name);
        fs::write(&path, bytes).unwrap();
        path
    }

    /// Writes the log of a simulated board and returns its path.
    pub fn log(&self, name: &str, settings: &Settings) -> String {
        self.file(name, log(&simulated(settings)))
    }

    /// Writes the log of a simulated board, with each reading changed, and returns its path.
    pub fn changed_log(
        &self,
        name: &str,
        settings: &Settings,
        mut change: impl FnMut(&mut Reading),
    ) -> String {
        let (header, mut entries) = simulated(settings);
        for entry in &mut entries {
            change(&mut entry.reading);
        }
        self.file(name, log(&(header, entries)))
    }

    /// The names of its files, and how long each is.
    pub fn listing(&self) -> Vec<(String, u64)> {
        let mut files: Vec<_> = fs::read_dir(self.0.path())
            .unwrap()
            .map(|entry| {
                let entry = entry.unwrap();
                let name = entry.file_name().into_string().unwrap();
                (name, entry.metadata().unwrap().len())
            })
            .collect();
        files.sort();
        files
    }
}

/// A simulated board that makes so many level turns.
pub fn turning(turns: f64) -> Settings {
    Settings {
        turns,
        ..Settings::default()
    }
}

/// One that moves like this.
pub fn moving(scenario: Scenario) -> Settings {
    Settings {
        scenario,
        ..Settings::default()
    }
}

/// A log's header and rows.
pub type Log = (Header, Vec<Entry>);

/// What a simulated board records.
pub fn simulated(settings: &Settings) -> Log {
    let simulator = Simulator::new(settings.clone());
    (simulator.header(), simulator.collect())
}

/// A log as bytes.
pub fn log((header, entries): &Log) -> Vec<u8> {
    written(header, entries.iter().copied()).unwrap()
}

/// The objects of this class.
pub fn of_class(lines: &[Value], class: &str) -> Vec<Value> {
    lines
        .iter()
        .filter(|line| line["class"] == class)
        .cloned()
        .collect()
}

/// Errors of headings in a noise-free turn of this board, degrees. `correct` makes a field of what its magnetometer reads;
/// `ahead` is where its nose and its right side lie in the plane of the turn.
pub fn turn_errors_deg(
    board: &Settings,
    ahead: [Vector3<f64>; 2],
    correct: impl Fn(&Vector3<f64>) -> Vector3<f64>,
) -> Vec<f64> {
    let earth = Vector3::new(board.horizontal_mgauss, 0.0, board.vertical_mgauss);
    let error = |heading_deg: i32| {
        let yaw = f64::from(heading_deg).to_radians();
        let pose = UnitQuaternion::from_euler_angles(0.0, board.tilt_deg.to_radians(), yaw);
        let field = pose.inverse_transform_vector(&earth);
        let iron = Vector3::from(board.bias_mgauss);
        let corrected = correct(&(field.component_mul(&Vector3::from(board.scale)) + iron));
        let [forward, right] = ahead.map(|axis| corrected.dot(&axis));
        apart_deg((-right).atan2(forward).to_degrees(), f64::from(heading_deg))
    };
    (0..360).map(error).collect()
}

/// Root mean square.
pub fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt()
}

/// The earth's field, north, east and down, and hard iron, milligauss.
pub const EARTH: Vector3<f64> = Vector3::new(163.0, 0.0, 527.0);
pub const BIAS: Vector3<f64> = Vector3::new(87.0, 54.0, 135.0);

/// The readings, 50 a second, of a board that lies like this at each time. `gyro` is what its gyro makes of the rate at a time.
pub fn carried(
    until_s: f64,
    lies: impl Fn(f64) -> Rotation3<f64>,
    gyro: impl Fn(f64, Vector3<f64>) -> Vector3<f64>,
) -> impl Iterator<Item = Reading> {
    const STEP_S: f64 = 0.02;
    let mut random = Xoshiro256PlusPlus::seed_from_u64(1);
    (0..(until_s / STEP_S).round() as u32).map(move |step| {
        let mut noise = |most: f64| Vector3::from_fn(|_, _| random.random_range(-most..most));
        let t_s = f64::from(step) * STEP_S;
        let now = lies(t_s);
        let rate = (lies(t_s - STEP_S).inverse() * now).scaled_axis() / STEP_S;
        Reading {
            t_s,
            field_mgauss: Some((now.inverse() * EARTH + BIAS + noise(2.0)).map(Some).into()),
            rate_rad_s: Some(gyro(t_s, rate) + noise(0.002)),
            specific_force_m_s2: Some(now.inverse() * Vector3::z() * -9.8 + noise(0.05)),
        }
    })
}
