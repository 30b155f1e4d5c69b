//! `headingd run` and `check` on a bus that is not there.

use crate::rig::{Rig, start};

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
    process.signal("TERM");
    assert!(process.wait().success(), "{}", process.said());
    let said = process.said();
    assert_eq!(said.matches("WARN magnetometer: ").count(), 1, "{said}");
    // There was no reading, and so there is no time of one.
    assert!(said.contains("no_bus") && !said.contains("t_s="), "{said}");
}

#[test]
fn the_check_says_it_too() {
    let rig = Rig::new(1.0, NO_BUS);
    let config = rig.path("headingd.toml");
    let arguments = ["check", "--json", "--config", config.to_str().unwrap()];
    let mut process = start(rig.folder.path(), &arguments);
    assert_eq!(process.wait().code(), Some(3));
    let shown = std::fs::read_to_string(rig.path("stdout")).unwrap();
    let report: serde_json::Value = serde_json::from_str(&shown).unwrap();
    assert_eq!(report["problems"][0]["code"], "no_bus");
    assert_eq!(report["problems"].as_array().unwrap().len(), 1);
}
