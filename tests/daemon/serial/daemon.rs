//! The daemon on a simulated Razor: what comes out is what a replay of the same log gives.

use std::fs::{self, File};
use std::io::Write;
use std::os::unix::fs::symlink;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

use headingd::recording::Entry;
use headingd::sensor::replay::Replay;
use headingd::sensor::simulator::{Settings, Simulator};
use serde_json::Value;

use super::device::{Device, Firmware, Habits, counts_of};
use super::quiet::until_quiet;
use crate::rig::{Rig, apart_deg, folder, headingd, pty, until};

/// Rest, two turns in two seconds each, rest.
fn board() -> Simulator {
    let settings = Settings {
        turns: 2.0,
        turn_deg_s: 180.0,
        ..Settings::default()
    };
    Simulator::new(settings)
}

fn configure(rig: &Rig, chip: &str) {
    let port = rig.path("tty");
    let more = format!(
        "kind = \"serial\"\n[serial]\nport = {port:?}\nprotocol = \"razor\"\nchip = {chip:?}\n"
    );
    rig.configure(1.0, &rig.path("store"), &more);
}

/// Times, headings and their deviations, where there are any.
fn headings(messages: &[Value]) -> Vec<(f64, f64, f64)> {
    let of = |att: &Value| {
        let number = |key| att.get(key).and_then(Value::as_f64);
        Some((number("t_s")?, number("mheading")?, number("heading_sd")?))
    };
    messages
        .iter()
        .filter(|message| message["class"] == "ATT")
        .filter_map(of)
        .collect()
}

/// RMS difference of headings over the larger deviation of the two, the one's clock set forward by `offset_s`, and of how many.
fn apart(live: &[(f64, f64, f64)], direct: &[(f64, f64, f64)], offset_s: f64) -> (f64, usize) {
    let mut squares = Vec::new();
    for (t_s, heading_deg, sd_deg) in live {
        let after = direct.partition_point(|(direct_s, ..)| *direct_s < t_s - offset_s);
        if let Some((direct_s, right_deg, right_sd_deg)) = direct.get(after)
            && (direct_s - (t_s - offset_s)).abs() < 0.1
        {
            let apart_deg = apart_deg(*heading_deg, *right_deg);
            squares.push((apart_deg / sd_deg.max(*right_sd_deg)).powi(2));
        }
    }
    (
        (squares.iter().sum::<f64>() / squares.len() as f64).sqrt(),
        squares.len(),
    )
}

/// Plays a log to the daemon as a Razor would, and asks for the headings of its direct replay, `within` their deviations.
///
/// A Razor sends its newest counts 50 times a second: some of the log's readings, rounded and at times of its own. Two
/// estimates that learn from one and from the other differ by degrees at first, and say so.
fn assert_same_headings(log: &Path, chip: &str, counts_per_gauss: f64, within: f64) {
    let mut replay = Replay::open(log).unwrap();
    let mountings = replay.header().mountings;
    // The Razor turns its readings into the board's frame.
    let entries: Vec<Entry> = replay
        .by_ref()
        .map(|entry| {
            let mut entry = entry.unwrap();
            let reading = &mut entry.reading;
            reading.field_mgauss = reading
                .whole_field_mgauss()
                .map(|field| <[f64; 3]>::from(mountings.mag.to_body(field)).map(Some));
            reading.rate_rad_s = reading.rate_rad_s.map(|rate| mountings.gyro.to_body(rate));
            reading.specific_force_m_s2 = reading
                .specific_force_m_s2
                .map(|force| mountings.accel.to_body(force));
            entry
        })
        .collect();
    let end_s = entries[entries.len() - 1].reading.t_s;

    let rig = Rig::new(1.0, "");
    configure(&rig, chip);
    let (mut process, mut client) = rig.watched();
    let fault = client.find("STATE", |state| state["cal_state"] == "fault");
    assert_eq!(fault["reason"], "no_device", "{fault}");
    let habits = Habits {
        burst: Duration::from_millis(30),
        ..Habits::default()
    };
    let firmware = Firmware::Razor(Box::new(counts_of(entries, counts_per_gauss)));
    let _device = Device::plug(&rig.path("tty"), firmware, habits);
    let begun = client.find("ATT", |_| true);
    assert_eq!(begun["device"], rig.path("tty").to_str().unwrap());
    let time = begun["time"].as_str().unwrap();
    assert!(
        time.starts_with("20") && time.ends_with('Z') && time.len() == 24,
        "{time}"
    );
    assert!(begun["age_ms"].is_u64(), "{begun}");
    let begun_s = begun["t_s"].as_f64().unwrap();
    let mut live = vec![begun];
    let over = |message: &Value| {
        message["t_s"]
            .as_f64()
            .is_some_and(|t_s| t_s > begun_s + end_s)
    };
    while !over(&live[live.len() - 1]) {
        live.push(client.next().unwrap());
    }
    let said = process.stop();
    assert_eq!(said.matches("cannot open serial port").count(), 1, "{said}");
    // On a turn made by hand the first candidate may be refused.
    let outcomes: Vec<_> = live
        .iter()
        .filter(|message| message["class"] == "CALIBRATION")
        .collect();
    assert!(
        outcomes
            .iter()
            .any(|outcome| outcome["verdict"] == "accepted"),
        "{outcomes:?}"
    );

    let (_, replayed, _) = headingd(&["replay", log.to_str().unwrap()]);
    let lines = replayed.lines();
    let replayed: Vec<Value> = lines
        .filter_map(|line| serde_json::from_str(line).ok())
        .collect();
    let (live, direct) = (headings(&live), headings(&replayed));
    // The first headings came with the burst after the board's first frames.
    let best = (0..200)
        .map(|step| apart(&live, &direct, begun_s - f64::from(step) * 0.005))
        .filter(|(_, count)| *count * 10 > live.len() * 7)
        .min_by(|a, b| a.0.total_cmp(&b.0));
    let (apart, count) = best.expect("headings at the same times");
    assert!(apart < within && count > 100, "{apart} over {count}");
}

#[test]
fn a_log_through_bridge_and_daemon_gives_the_headings_of_its_replay() {
    let folder = folder();
    let log = folder.path().join("log.csv");
    fs::write(&log, crate::rig::log(&board().header(), board())).unwrap();
    until_quiet(|| assert_same_headings(&log, "hmc5843", 1300.0, 0.5));
}

#[test]
fn unplugged_and_plugged_in_again_readings_go_on() {
    until_quiet(|| {
        let rig = Rig::new(1.0, "");
        configure(&rig, "hmc5843");
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
        let said = process.stop();
        assert_eq!(said.matches("is gone").count(), 2, "{said}");
    });
}

/// The kernel goes on to take what the board sends while the daemon is stopped.
#[test]
fn what_waited_for_a_stopped_daemon_is_as_old_as_it_is() {
    until_quiet(|| {
        const TURN_DEG_S: f64 = 60.0;
        const FRAMES: u64 = 150;
        let rig = Rig::new(1.0, "");
        configure(&rig, "hmc5843");
        let (mut process, mut client) = rig.watched();
        // It turns evenly: each field says when it was taken.
        let made = Arc::new(AtomicU64::new(0));
        let count = made.clone();
        let turning = move |t_s: f64| {
            count.fetch_add(1, Ordering::Relaxed);
            let (sin, cos) = (TURN_DEG_S * t_s).to_radians().sin_cos();
            let field = [300.0 * cos, -300.0 * sin, 500.0].map(|axis: f64| axis.round() as i32);
            [[0, 0, 256], field, [0, 0, (TURN_DEG_S * 14.375) as i32]]
        };
        let firmware = Firmware::Razor(Box::new(turning));
        let _device = Device::plug(&rig.path("tty"), firmware, Habits::default());

        let age_s = |att: &Value| att["age_ms"].as_f64().unwrap() / 1000.0;
        let t_s = |att: &Value| att["t_s"].as_f64().unwrap();
        // What its time says, less what its field says, degrees.
        let ahead_deg = |att: &Value| TURN_DEG_S * t_s(att) - att["raw_heading"].as_f64().unwrap();
        let before: Vec<Value> = (0..100).map(|_| client.find("ATT", |_| true)).collect();
        let last = &before[99];
        let stopped_s = t_s(last) + age_s(last);

        process.signal("STOP");
        let state = format!("/proc/{}/stat", process.id());
        until("the daemon to be stopped", || {
            fs::read_to_string(&state).unwrap().contains(") T ")
        });
        let begun = made.load(Ordering::Relaxed);
        until("frames to wait", || {
            made.load(Ordering::Relaxed) >= begun + FRAMES
        });
        process.signal("CONT");

        let mut unread = 0;
        let mut after = 0;
        while after < 100 {
            let att = client.find("ATT", |_| true);
            let apart_deg = apart_deg(ahead_deg(&att), ahead_deg(last));
            assert!(apart_deg.abs() < 0.3 * TURN_DEG_S, "{apart_deg}: {att}");
            // What it had sent before it was stopped may have been on its way.
            if t_s(&att) + age_s(&att) < stopped_s + 2.0 {
                unread += 1;
                assert!(unread < 20, "{att}");
            } else {
                after += 1;
            }
        }
        process.stop();
    });
}

/// The board is not reset when its port is opened: its header came once, at its own start.
#[test]
fn a_reload_keeps_what_the_rows_of_the_same_device_mean() {
    until_quiet(|| {
        let rig = Rig::new(1.0, "");
        let (pty, node) = pty();
        rustix::io::ioctl_fionbio(&pty, true).unwrap();
        // The line stays up while the daemon opens it anew.
        let _line = File::open(&node).unwrap();
        symlink(node, rig.path("tty")).unwrap();
        let more = format!(
            "kind = \"serial\"\n[serial]\nport = {:?}\nprotocol = \"log_rows\"\n[mounting]\nmag_axes = \"+x +y +z\"\n",
            rig.path("tty")
        );
        rig.configure(1.0, &rig.path("store"), &more);

        let (starting, over) = (AtomicBool::new(true), AtomicBool::new(false));
        std::thread::scope(|scope| {
            scope.spawn(|| {
                let mut pty = File::from(pty);
                for row in 0.. {
                    let mut text = format!("{},20,{},40\r\n", f64::from(row) * 0.02, row % 2);
                    if starting.load(Ordering::Relaxed) {
                        text.insert_str(
                            0,
                            "# headingd-log 1\r\n# mag_unit = uT\r\nt_s,mx,my,mz\r\n",
                        );
                    }
                    // Before anybody reads, the line may be full.
                    let _ = pty.write_all(text.as_bytes());
                    if over.load(Ordering::Relaxed) {
                        return;
                    }
                    std::thread::sleep(Duration::from_millis(20));
                }
            });
            let ended = std::panic::catch_unwind(|| {
                let (mut process, mut client) = rig.watched();
                client.find("ATT", |_| true);
                starting.store(false, Ordering::Relaxed);
                let seq = |att: &Value| att["seq"].as_u64().unwrap();
                client.find("ATT", |att| seq(att) > 20);
                rig.edit("+x +y +z", "-x -y +z");
                process.signal("HUP");
                let next = loop {
                    let message = client.next().unwrap();
                    let begun_anew = message["class"] == "ATT" && seq(&message) < 10;
                    if begun_anew || message["reason"] == "no_header" {
                        break message;
                    }
                };
                // The board is turned half round.
                let heading = next["raw_heading"].as_f64();
                assert!(
                    heading.is_some_and(|deg| apart_deg(deg, 180.0).abs() < 5.0),
                    "{next}"
                );
                process.stop();
            });
            over.store(true, Ordering::Relaxed);
            ended.unwrap();
        });
    });
}
