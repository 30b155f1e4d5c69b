//! The daemon on a simulated Razor: what comes out is what a replay of the same log gives.

use std::fs;
use std::process::Command;
use std::time::Duration;

use headingd::recording::{Entry, Writer};
use headingd::sensor::simulator::{Settings, Simulator};
use serde_json::Value;

use crate::device::{Device, Firmware, Habits, counts_of};
use crate::rig::{Rig, until};

/// Rest, a turn in two seconds, rest.
fn board() -> Simulator {
    let settings = Settings {
        turns: 1.0,
        turn_deg_s: 180.0,
        ..Settings::default()
    };
    Simulator::new(settings).unwrap()
}

fn configure(rig: &Rig) {
    let port = rig.path("tty");
    let more = format!("kind = \"serial\"\n[serial]\nport = {port:?}\nprotocol = \"razor\"\n");
    rig.configure(1.0, &rig.path("store"), &more);
}

fn headings(messages: &[Value]) -> Vec<f64> {
    let of = |att: &Value| att.get("mheading")?.as_f64();
    messages
        .iter()
        .filter(|message| message["class"] == "ATT")
        .filter_map(of)
        .collect()
}

fn apart_deg(a: f64, b: f64) -> f64 {
    ((a - b + 540.0).rem_euclid(360.0) - 180.0).abs()
}

#[test]
fn a_log_through_bridge_and_daemon_gives_the_headings_of_its_replay() {
    let rig = Rig::new(1.0, "");
    configure(&rig);
    let (mut process, mut client) = rig.watched();
    let fault = client.find("STATE", |state| state["cal_state"] == "fault");
    assert_eq!(fault["reason"], "no_device", "{fault}");
    let entries: Vec<Entry> = board().collect();
    let end_s = entries[entries.len() - 1].reading.t_s;
    let habits = Habits {
        burst: Duration::from_millis(30),
        ..Habits::default()
    };
    let firmware = Firmware::Razor(Box::new(counts_of(entries.clone(), 1300.0)));
    let _device = Device::plug(&rig.path("tty"), firmware, habits);
    let begun = client.find("ATT", |_| true);
    assert_eq!(begun["device"], rig.path("tty").to_str().unwrap());
    let time = begun["time"].as_str().unwrap();
    assert!(
        time.starts_with("20") && time.ends_with('Z') && time.len() == 24,
        "{time}"
    );
    assert!(begun["age_ms"].as_u64().unwrap() < 1000, "{begun}");
    let begun_s = begun["t_s"].as_f64().unwrap();
    let mut live = vec![begun];
    while live[live.len() - 1]["t_s"]
        .as_f64()
        .is_none_or(|t_s| t_s < begun_s + end_s + 0.5)
    {
        live.push(client.next().unwrap());
    }
    process.signal("TERM");
    assert!(process.wait().success(), "{}", process.said());
    let said = process.said();
    assert_eq!(said.matches("cannot open serial port").count(), 1, "{said}");
    let outcome = live
        .iter()
        .find(|message| message["class"] == "CALIBRATION")
        .unwrap();
    assert_eq!(outcome["verdict"], "accepted", "{outcome}");

    // The same log, read directly.
    let log = rig.path("log.csv");
    let mut writer = Writer::new(Vec::new(), &board().header()).unwrap();
    entries
        .iter()
        .for_each(|entry| writer.write(entry).unwrap());
    fs::write(&log, writer.into_inner().unwrap()).unwrap();
    let replay = Command::new(env!("CARGO_BIN_EXE_headingd"))
        .arg("replay")
        .arg(&log)
        .output()
        .unwrap();
    let replayed: Vec<Value> = replay
        .stdout
        .split(|byte| *byte == b'\n')
        .filter_map(|line| serde_json::from_slice(line).ok())
        .collect();
    let (live, direct) = (headings(&live), headings(&replayed));
    assert!(
        live.len() > 20 && direct.len() > 20,
        "{} and {}",
        live.len(),
        direct.len()
    );
    // At the end the board rests, so that no time has to be known.
    let (last, right) = (live[live.len() - 1], direct[direct.len() - 1]);
    assert!(apart_deg(last, right) < 1.5, "{last} against {right}");
}

#[test]
fn unplugged_and_plugged_in_again_readings_go_on() {
    let rig = Rig::new(1.0, "");
    configure(&rig);
    let (mut process, mut client) = rig.watched();
    for _ in 0..2 {
        let firmware = Firmware::Razor(Box::new(counts_of(board().collect(), 1300.0)));
        let device = Device::plug(&rig.path("tty"), firmware, Habits::default());
        client.find("STATE", |state| state["reason"] == "no_calibration");
        client.find("ATT", |_| true);
        device.unplug();
        client.find("STATE", |state| state["reason"] == "unplugged");
    }
    until("the second to be told of", || {
        process.said().matches("is gone").count() == 2
    });
    process.signal("TERM");
    assert!(process.wait().success(), "{}", process.said());
    assert_eq!(
        process.said().matches("is gone").count(),
        2,
        "{}",
        process.said()
    );
}
