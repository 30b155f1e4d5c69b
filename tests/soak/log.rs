//! The log that is played: a board that turns all the time, and all that can be wrong with a log.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use headingd::recording::Writer;
use headingd::sensor::simulator::{Settings, Simulator};
use rand::{Rng, RngExt};

/// The true headings of the samples that may be published, degrees, by time in microseconds.
pub type Truth = BTreeMap<u64, f64>;

/// A time as a key.
pub fn micros(t_s: f64) -> u64 {
    (t_s * 1e6).round() as u64
}

/// Writes a log of a board that rests for a moment and turns for ten minutes.
pub fn write(path: &Path, rng: &mut impl Rng) -> Truth {
    let settings = Settings {
        turns: 85.0,
        ..Settings::default()
    };
    let simulator = Simulator::new(settings);
    let mut clean = Vec::new();
    let mut writer = Writer::new(&mut clean, &simulator.header()).unwrap();
    let mut truth = Truth::new();
    let mut gap_until_s = 0.0;
    let mut garbage: Vec<(usize, Vec<u8>)> = Vec::new();
    let mut written = 0;
    for mut entry in simulator {
        let t_s = entry.reading.t_s;
        // A gap about every 20 s, after there was time to calibrate.
        if t_s > 25.0 && t_s > gap_until_s + 2.0 && rng.random_bool(1.0 / 2800.0) {
            gap_until_s = t_s + rng.random_range(0.3..3.0);
        }
        if t_s < gap_until_s {
            continue;
        }
        if t_s > 25.0 && rng.random_bool(0.002) {
            let length = rng.random_range(1..300);
            let bytes = (0..length).map(|_| rng.random_range(0x20..=0xff));
            garbage.push((written, bytes.collect()));
        }
        if let Some(field) = &mut entry.reading.field_mgauss {
            if t_s > 25.0 && rng.random_bool(0.01) {
                field[rng.random_range(0..3)] = None;
            } else if let Some(heading) = entry.heading_truth_deg {
                truth.insert(micros(t_s), heading);
            }
        }
        written += writer.write(&entry).unwrap();
    }
    let header = clean.len() - written;
    let mut bytes = Vec::with_capacity(clean.len());
    let mut from = 0;
    for (at, spoilt) in garbage {
        let at = header + at;
        bytes.extend(&clean[from..at]);
        bytes.extend(spoilt);
        bytes.push(b'\n');
        from = at;
    }
    bytes.extend(&clean[from..]);
    fs::write(path, bytes).unwrap();
    truth
}
