//! `headingd run` and `check` on a bus that is not there, and on one that a preloaded library makes.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::LazyLock;

use crate::rig::{Process, Rig, finished};

/// The last number that a bus can have: no machine has so many.
const NO_BUS: &str = "kind = \"i2c\"\n[i2c]\nbus = 255\n";

#[test]
fn a_missing_bus_is_a_fault_told_once_and_does_not_hinder_the_end() {
    let rig = Rig::new(1.0, NO_BUS);
    let (mut process, mut client) = rig.watched();
    let state = client.find("STATE", |state| state["cal_state"] == "fault");
    assert_eq!(state["reason"], "no_bus");
    let message = state["message"].as_str().unwrap();
    assert!(
        message.contains("/dev/i2c-255") && message.contains("modprobe i2c-dev"),
        "{message}"
    );
    let said = process.stop();
    assert_eq!(said.matches("WARN ").count(), 1, "{said}");
    // There was no reading, and so there is no time of one.
    assert!(said.contains("no_bus") && !said.contains("t_s="), "{said}");
}

#[test]
fn the_check_says_it_too() {
    let rig = Rig::new(1.0, NO_BUS);
    let (status, shown, _) = finished(&mut rig.command(&["check", "--json"]));
    assert_eq!(status, 3);
    let report: serde_json::Value = serde_json::from_str(&shown).unwrap();
    assert_eq!(report["problems"][0]["code"], "no_bus");
    assert_eq!(report["problems"].as_array().unwrap().len(), 1);
}

/// The program on the bus of tests/board/bus.c, with these variables of the environment.
fn on_bus(rig: &Rig, variables: &[(&str, &str)], verb: &[&str]) -> Process {
    // Not with the rig's files: in a container, nothing in /dev/shm may be run.
    static LIBRARY: LazyLock<PathBuf> = LazyLock::new(|| {
        let library = Path::new(env!("CARGO_TARGET_TMPDIR")).join("bus.so");
        let source = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/board/bus.c");
        let compiler = std::env::var("CC").unwrap_or_else(|_| "cc".to_owned());
        let mut compile = Command::new(compiler);
        compile.args(["-shared", "-fPIC", "-o"]).arg(&library);
        let compiled = compile.args([source, "-ldl", "-lm"]).status();
        assert!(compiled.unwrap().success());
        library
    });
    let mut command = rig.command(verb);
    command.env("LD_PRELOAD", &*LIBRARY);
    command.envs(variables.iter().copied());
    rig.spawn(&mut command)
}

/// What the check reports on such a bus.
fn checked(rig: &Rig, variables: &[(&str, &str)]) -> serde_json::Value {
    on_bus(rig, variables, &["check", "--json"]).wait();
    let shown = std::fs::read_to_string(rig.path("stdout")).unwrap();
    serde_json::from_str(&shown).unwrap()
}

#[test]
fn a_qmc5883l_is_found_and_read() {
    let rig = Rig::new(1.0, "kind = \"i2c\"\n[i2c]\nbus = 9\nboard = \"gy-271\"\n");
    let chip = [("BUS_MAGNETOMETER", "qmc5883l")];
    let process = on_bus(&rig, &chip, &["run"]);
    let mut client = rig.client();
    client.find("STATE", |state| state["reason"] == "no_calibration");
    let heading = client.find("ATT", |att| att["raw_heading"].is_number());
    // 2560 to 2567 counts on X and 512 to 519 on Y, which is to the left.
    let right_deg = (512.0f64 / 2560.0).atan().to_degrees();
    let found_deg = heading["raw_heading"].as_f64().unwrap();
    assert!((found_deg - right_deg).abs() < 0.5, "{heading}");
    assert!(process.said().contains("magnetometer: QMC5883L"));
    let report = checked(&rig, &chip);
    // A busy machine may read too slowly.
    let problems = report["problems"].as_array().unwrap();
    assert!(problems.iter().all(|it| it["code"] == "rate"), "{report}");
    assert_eq!(report["magnetometer"]["kind"], "QMC5883L");
    assert_eq!(report["self_test"], serde_json::json!([]));
}

#[test]
fn a_stick_is_checked_and_turned_as_a_new_user_would() {
    let rig = Rig::new(
        1.0,
        "kind = \"i2c\"\n[i2c]\nbus = 9\nboard = \"sparkfun-9dof-stick\"\n",
    );
    let report = checked(&rig, &[("BUS_BOARD", "stick")]);
    // A busy machine may read too slowly, and then the chip is the likely one.
    let problems = report["problems"].as_array().unwrap();
    assert!(problems.iter().all(|it| it["code"] == "rate"), "{report}");
    assert_eq!(report["magnetometer"]["kind"], "HMC5843", "{report}");
    let tests = report["self_test"].as_array().unwrap();
    assert_eq!(tests.len(), 3);
    for axis in tests {
        // 0.55 gauss at 780 counts a gauss.
        let measured = axis["measured"].as_f64().unwrap();
        assert!(
            axis["passed"] == true && (measured - 429.0).abs() < 5.0,
            "{axis}"
        );
    }
    let force = &report["accel_m_s2"];
    assert!((force[2].as_f64().unwrap() + 9.81).abs() < 0.1, "{force}");
    let variables = [("BUS_BOARD", "stick"), ("BUS_MOTION", "turn")];
    let process = on_bus(&rig, &variables, &["run"]);
    let mut client = rig.client();
    client.find("STATE", |state| {
        state["cal_state"] == "turning" || state["reason"] == "learning"
    });
    client.heading();
    let said = process.said();
    assert!(!said.contains("gyro_"), "{said}");
}
