//! A reload that takes long: the log to replay is a pipe by then, and nothing comes out of it before the test says so.

use std::fs::{self, File};
use std::io::Write;
use std::path::PathBuf;

use headingd::sensor::simulator::{Settings, Simulator};
use serde_json::Value;

use crate::control::link::Link;
use crate::rig::{Client, Process, Rig, log, until};

/// A log of a simulated board that makes these turns.
fn turning(turns: f64) -> Vec<u8> {
    let settings = Settings {
        turns,
        ..Settings::default()
    };
    let simulator = Simulator::new(settings);
    log(&simulator.header(), simulator)
}

fn seq(att: &Value) -> u64 {
    att["seq"].as_u64().unwrap()
}

/// A daemon that plays a log, and is in the midst of a reload that waits for the header of the next; a client, the pipe that
/// the header comes through, and the path of log and pipe.
fn reloading() -> (Rig, Process, Client, File, PathBuf) {
    let rig = Rig::new(1.0, "");
    let log = rig.path("log.csv");
    // It lasts longer than a test may.
    fs::write(&log, turning(10.0)).unwrap();
    rig.replay(1.0, &log);
    let (process, mut client) = rig.watched();
    client.find("ATT", |att| seq(att) > 20);

    let fifo = rig.pipe("fifo");
    // Open for both, so that neither end waits for the other.
    let pipe = File::options().read(true).write(true).open(&fifo).unwrap();
    fs::rename(&fifo, &log).unwrap();
    rig.replay(2.0, &log);
    process.signal("HUP");
    until("the daemon to open the pipe", || {
        let files = fs::read_dir(format!("/proc/{}/fd", process.id())).unwrap();
        files
            .filter_map(|file| fs::read_link(file.ok()?.path()).ok())
            .any(|file| file == log)
    });
    (rig, process, client, pipe, log)
}

#[test]
fn clients_are_served_while_a_reload_waits_for_its_source() {
    let (rig, mut process, mut client, mut pipe, log) = reloading();
    // Headings go on, more of them than had been sent before the reload began.
    let first = seq(&client.find("ATT", |_| true));
    client.find("ATT", |att| seq(att) > 2 * first);
    // So do whoever comes now, and the control socket.
    rig.client().find("ATT", |att| seq(att) > 2 * first);
    let status = Link::new(&rig).told("status");
    assert_eq!(status["source"], log.to_str().unwrap());
    assert!(!process.said().contains("reloaded"), "{}", process.said());

    let other = String::from_utf8(turning(0.1)).unwrap();
    let other = other.replacen("sensor = hmc5843", "sensor = hmc5883l", 1);
    pipe.write_all(other.as_bytes()).unwrap();
    let last = seq(&client.find("ATT", |_| true));
    client.find("ATT", |att| seq(att) < last.min(20));
    let said = process.said();
    assert!(said.contains("reloaded: source.speed"), "{said}");
    rig.client().find("DEVICES", |devices| {
        devices["devices"][0]["subtype"] == "hmc5883l"
    });

    // By now the source waits for the rest of the pipe, and does not end by itself.
    fs::remove_file(&log).unwrap();
    fs::write(&log, turning(10.0)).unwrap();
    rig.replay(1.0, &log);
    process.signal("HUP");
    until("the second reload", || {
        process.said().matches("reloaded: ").count() == 2
    });
    rig.client().find("ATT", |_| true);
    process.stop();
}

#[test]
fn a_stop_does_not_wait_for_a_reload() {
    let (rig, mut process, _client, _pipe, _) = reloading();
    process.stop();
    assert!(!rig.path("heading.sock").exists());
}

#[test]
fn of_two_reloads_the_second_follows_the_first() {
    let (rig, process, _client, mut pipe, log) = reloading();
    fs::remove_file(&log).unwrap();
    fs::write(&log, turning(10.0)).unwrap();
    rig.replay(4.0, &log);
    process.signal("HUP");
    // The signal has come before the answer to this.
    Link::new(&rig).told("status");
    pipe.write_all(&turning(0.1)).unwrap();
    until("both", || {
        process.said().matches("reloaded: source.speed").count() == 2
    });
    rig.client().find("ATT", |_| true);
}

#[test]
fn what_was_started_is_still_wanted_after_a_reload() {
    let (rig, process, _client, mut pipe, _) = reloading();
    Link::new(&rig).told("start");
    pipe.write_all(&turning(0.1)).unwrap();
    process.says("reloaded: source.speed");
    Link::new(&rig).status("it to be armed", |status| status["armed"] == true);
}
