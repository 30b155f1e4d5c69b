//! The examination, over a bus of simulated chips.

use super::*;
use crate::sensor::bus::Cause;
use crate::sensor::bus::fake::{FakeBus, World};
use crate::sensor::clock::Clock;

const CONFIG: &str = "[source]\nkind = \"i2c\"\n[i2c]\nboard = \"sparkfun-9dof-stick\"\nmagnetometer = \"hmc5843\"\n";

/// A clock under which gyro and accelerometer lie still and level, with noise.
struct Still {
    bus: FakeBus,
    now_s: f64,
}

impl Clock for Still {
    fn now_s(&self) -> f64 {
        self.now_s
    }

    fn wait_until(&mut self, t_s: f64) -> bool {
        self.now_s = self.now_s.max(t_s);
        let world = &mut *self.bus.world.borrow_mut();
        let noise = (self.now_s * 1e4) as u64 as u8 % 8;
        for (chip, register, bytes) in [(0x68, 0x1D, [0, noise]), (0x53, 0x32, [noise, 0])] {
            if world.chips.contains_key(&chip) {
                world.set(chip, register, &bytes);
            }
        }
        true
    }
}

/// An HMC5843 that measures about 500 mG, and its own field well.
fn measuring(world: &mut World, chip: u8, register: u8, value: u8) {
    if (chip, register, value) != (0x1E, 0x02, 1) {
        return;
    }
    let counts: i16 = match world.get(0x1E, 0) & 3 {
        1 => 429,
        2 => -429,
        _ => 375 + (world.transfers.len() % 7) as i16,
    };
    let [high, low] = counts.to_be_bytes();
    world.set(0x1E, 0x03, &[high, low, high, low, high, low, 1]);
}

fn stick() -> FakeBus {
    let bus = FakeBus::default();
    bus.set(0x1E, 0x0A, b"H43");
    bus.set(0x68, 0x00, &[0x68]);
    bus.set(0x53, 0x00, &[0xE5]);
    // Level: +1 g on chip Z.
    bus.set(0x53, 0x36, &[0x00, 0x01]);
    bus.world.borrow_mut().on_write = Some(measuring);
    bus
}

fn examined(bus: &FakeBus, config: &str) -> CheckReport {
    let config = Config::parse("a.toml", config).unwrap();
    let mut clock = Still {
        bus: bus.clone(),
        now_s: 0.0,
    };
    let report = examine(&expected(&config), &mut bus.clone(), &mut clock);
    assert!(clock.now_s < 10.0);
    report
}

fn codes(report: &CheckReport) -> Vec<&'static str> {
    report.problems.iter().map(|problem| problem.code).collect()
}

#[test]
fn a_good_board_is_well() {
    let report = examined(&stick(), CONFIG);
    assert_eq!(codes(&report), [""; 0], "{:?}", report.problems);
    let names: Vec<_> = report
        .chips
        .iter()
        .map(|found| (found.address, found.chip))
        .collect();
    let right = [
        (0x1E, "HMC5843 or variant"),
        (0x68, "ITG-3200"),
        (0x53, "ADXL345"),
    ];
    assert_eq!(names, right);
    assert!(
        report
            .self_test
            .iter()
            .all(|axis| axis.measured == Some(429.0) && axis.passed)
    );
    assert!((report.mag_rate_hz.unwrap() - 40.0).abs() < 1.0);
    assert!((99.0..=125.0).contains(&report.gyro_rate_hz.unwrap()));
    assert!((report.accel_m_s2.unwrap()[2] + 9.8).abs() < 0.1);
    // 378 counts an axis at 1300 a gauss.
    assert!((report.field_mgauss.unwrap() - 504.0).abs() < 5.0);
    let text = report.to_string();
    for part in [
        "0x1e  HMC5843",
        "self-test X: 429 counts, expected 429",
        "all is well",
    ] {
        assert!(text.contains(part), "{text}");
    }
    let json = serde_json::to_value(&report).unwrap();
    assert_eq!(json["problems"], serde_json::json!([]));
    assert_eq!(json["self_test"][2]["axis"], "Z");
}

#[test]
fn each_thing_that_is_wrong_has_its_sentence() {
    type Harm = fn(&mut World);
    #[rustfmt::skip]
    let cases: [(Harm, &str, &str); 9] = [
        (|w| w.broken = Some(Cause::NoBus), "no_bus", "modprobe i2c-dev"),
        (|w| w.broken = Some(Cause::Permission), "permission", "group i2c"),
        (|w| w.chips.retain(|chip, _| *chip != 0x1E), "no_answer", "bypass"),
        (|w| { w.chips.remove(&0x1E); w.set(0x0D, 0x0D, &[0xFF]); }, "clone", "0x0d is another one, QMC5883L"),
        (|w| { w.chips.remove(&0x1E); w.set(0x2C, 0, &[0x80]); }, "clone", "headingd does not support it"),
        (|w| w.set(0x1E, 0x0A, b"H44"), "wrong_identity", "H43"),
        (|w| w.on_write = None, "not_ready", "power and wiring"),
        (|w| w.set(0x53, 0x36, &[0x00, 0xFF]), "accel_sign", "on its back"),
        (|w| w.set(0x53, 0x36, &[0x00, 0x02]), "accel_strength", "9.8"),
    ];
    for (harm, code, part) in cases {
        let bus = stick();
        harm(&mut bus.world.borrow_mut());
        let report = examined(&bus, CONFIG);
        let found = report.problems.iter().find(|problem| problem.code == code);
        let found = found.unwrap_or_else(|| panic!("{code}: {:?}", report.problems));
        assert!(found.message.contains(part), "{}", found.message);
        assert!(report.to_string().contains(&found.message));
    }
}

#[test]
fn a_dead_a_turned_and_a_constant_magnetometer_are_told() {
    let turned = |world: &mut World, chip: u8, register: u8, value: u8| {
        measuring(world, chip, register, value);
        if register == 0x02 && world.get(0x1E, 0) & 3 != 0 {
            // Positive and negative bias changed.
            let sign = if world.get(0x1E, 0) & 3 == 1 {
                -1i16
            } else {
                1
            };
            let [high, low] = (429 * sign).to_be_bytes();
            world.set(0x1E, 0x03, &[high, low]);
        }
    };
    let bus = stick();
    bus.world.borrow_mut().on_write = Some(turned);
    let report = examined(&bus, CONFIG);
    assert_eq!(codes(&report), ["self_test"]);
    assert!(
        report.problems[0]
            .message
            .contains("axis X measured -429 counts, the wrong sign")
    );

    let bus = stick();
    bus.world.borrow_mut().on_write = None;
    bus.set(0x1E, 0x03, &[1, 0, 1, 0, 1, 0, 1]);
    let report = examined(&bus, CONFIG);
    assert_eq!(
        codes(&report),
        ["self_test", "self_test", "self_test", "frozen"]
    );
}

#[test]
fn a_claimed_chip_hides_no_other_and_is_no_problem_where_it_is_not_configured() {
    let with_claimed = |address: u8| {
        let bus = stick();
        let claimed = vec![Cause::Busy; 20].into();
        bus.world.borrow_mut().faults.insert(address, claimed);
        examined(&bus, CONFIG)
    };
    let report = with_claimed(0x68);
    assert!(codes(&report).contains(&"claimed"));
    assert_eq!(report.self_test.len(), 3);
    let report = with_claimed(0x69);
    assert_eq!(codes(&report), [""; 0], "{:?}", report.problems);
    assert!(report.to_string().contains("0x69  claimed"));
}

#[test]
fn a_chip_that_only_answers_h43_is_refused_as_a_fake() {
    // Named, it is tried as what it is said to be; otherwise it is not even that.
    for named in ["hmc5883l", "auto"] {
        let bus = FakeBus::default();
        bus.set(0x1E, 0x0A, b"H43");
        let config = CONFIG.replace("hmc5843", named) + "companions = \"none\"\n";
        let report = examined(&bus, &config);
        assert_eq!(codes(&report), ["fake_hmc5883l"], "{:?}", report.problems);
        assert!(report.problems[0].message.contains("revision A"));
    }
}

#[test]
fn nothing_has_no_sign() {
    let shown = [-0.3, 0.3, -0.6, 428.5].map(super::whole);
    assert_eq!(shown, ["0", "0", "-1", "429"]);
}
