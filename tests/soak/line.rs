//! A daemon on a serial line with a board that comes and goes, loses bytes, resets and talks nonsense.

use std::time::{Duration, Instant};

use headingd::sensor::simulator::{Settings, Simulator};
use rand::{Rng, RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

use crate::device::{Device, Firmware, Habits, counts_of};
use crate::health::{descriptors, threads};
use crate::rig::{Rig, until};
use crate::watcher::is_fresh;

pub fn soak(length: Duration) {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(20_122);
    let rig = Rig::new(1.0, "");
    let port = rig.path("tty");
    let more = format!("kind = \"serial\"\n[serial]\nport = {port:?}\nprotocol = \"razor\"\n");
    rig.configure(1.0, &rig.path("store"), &more);
    let (mut process, mut client) = rig.watched();
    let reader = std::thread::spawn(move || {
        let mut samples = 0u64;
        while let Some(message) = client.next() {
            samples += u64::from(message["class"] == "ATT");
            assert!(is_fresh(&message), "{message}");
        }
        samples
    });

    let begun = Instant::now();
    let mut boards = 0;
    let mut before = None;
    while begun.elapsed() < length {
        let left = length.saturating_sub(begun.elapsed());
        let life = left.min(Duration::from_secs_f64(rng.random_range(4.0..9.0)));
        board(&rig, life, &mut rng);
        boards += 1;
        let pid = process.id();
        let held = || (descriptors(pid), threads(pid));
        let first = *before.get_or_insert_with(held);
        until("the line to be given back", || {
            let now = held();
            now.0 <= first.0 && now.1 <= first.1
        });
    }
    process.signal("TERM");
    let status = process.wait();
    let said = process.said();
    assert!(status.success() && !said.contains("panicked"), "{said}");
    assert!(said.lines().count() < 40 * (boards + 1), "{said}");
    let samples = reader.join().expect("what the reader saw");
    assert!(samples > 20, "{samples} samples of {boards} boards: {said}");
    println!("soak: {boards} boards on a line, {samples} samples, each fresh");
}

/// One board is plugged in for so long.
fn board(rig: &Rig, life: Duration, rng: &mut impl Rng) {
    let begun = Instant::now();
    let settings = Settings {
        turns: 20.0,
        seed: rng.random(),
        ..Settings::default()
    };
    let entries = Simulator::new(settings).collect();
    let noise = || (0..997u32).map(|i| (i * 97 % 251) as u8).collect();
    let firmware = match rng.random_range(0..4) {
        0 => Firmware::Flood(noise()),
        _ => Firmware::Razor(Box::new(counts_of(entries, 1300.0))),
    };
    let habits = Habits {
        burst: Duration::from_millis(rng.random_range(0..40)),
        lose: rng.random_bool(0.5).then_some(997),
        mag_fails: rng.random_bool(0.1),
    };
    let device = Device::plug(&rig.path("tty"), firmware, habits);
    while begun.elapsed() < life {
        std::thread::sleep(Duration::from_millis(rng.random_range(50..800)));
        if rng.random_bool(0.1) {
            device.brown_out();
        }
    }
}
