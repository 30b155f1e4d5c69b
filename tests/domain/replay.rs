//! `headingd replay`: the lines that a client would get, from logs of every kind.

use std::io::{BufRead, BufReader};
use std::process::Stdio;

use crate::common::{
    Folder, Log, Ran, apart_deg, headingd, log, moving, of_class, program, rms, simulated, turning,
};
use headingd::frame::hypot;
use headingd::recording::Entry;
use headingd::sensor::simulator::{Scenario, Settings};
use serde_json::Value;

/// Keys of ATT that somebody may steer by.
const STEERING: [&str; 3] = ["mheading", "heading", "inst_heading"];

fn replay(log: &str, more: &[&str]) -> Ran {
    headingd(&[&["replay", log], more].concat())
}

/// The lines of a replay that must go well.
fn lines(log: &str, more: &[&str]) -> Vec<Value> {
    let ran = replay(log, more);
    assert_eq!((ran.status, ran.err.as_str()), (0, ""), "{more:?}");
    ran.lines()
}

/// The words of the conditions in their order, each as often as it was reported.
fn states(lines: &[Value]) -> Vec<String> {
    let word = |line: Value| line["cal_state"].as_str().unwrap().to_owned();
    let mut words: Vec<String> = of_class(lines, "STATE").into_iter().map(word).collect();
    // Turning is reported again with its progress.
    words.dedup();
    words
}

fn steers(att: &Value) -> bool {
    STEERING.iter().any(|key| att.get(key).is_some())
}

fn t_s(line: &Value) -> f64 {
    line["t_s"].as_f64().unwrap()
}

fn whole_field(entry: &Entry) -> bool {
    entry.reading.whole_field_mgauss().is_some()
}

/// A log of one turn, and a calibration of it in a file.
fn with_calibration(folder: &Folder, name: &str) -> (Log, String) {
    let whole = simulated(&turning(1.0));
    let path = folder.file(name, log(&whole));
    let out = folder.path("calibration.json");
    let ran = headingd(&["calibrate", &path, "--out", &out]);
    assert_eq!(ran.status, 0, "{ran:?}");
    (whole, out)
}

/// Published headings less the true ones, degrees, of every line that has one.
fn errors_deg(lines: &[Value], entries: &[Entry], key: &str) -> Vec<f64> {
    let atts = of_class(lines, "ATT");
    let truth = entries
        .iter()
        .filter(|entry| entry.reading.field_mgauss.is_some());
    assert_eq!(
        atts.len(),
        truth.clone().count(),
        "one ATT a magnetometer reading"
    );
    let mut errors = Vec::new();
    for (att, entry) in atts.iter().zip(truth) {
        assert!((t_s(att) - entry.reading.t_s).abs() < 1e-6);
        if let (Some(heading), Some(truth)) = (att.get(key), entry.heading_truth_deg) {
            errors.push(apart_deg(heading.as_f64().unwrap(), truth));
        }
    }
    errors
}

#[test]
fn the_same_log_and_seed_give_the_same_bytes() {
    let folder = Folder::new();
    let log = folder.log("a.csv", &moving(Scenario::Spatial));
    let config = folder.file("a.toml", "[calibration]\nprofile = \"paper\"\n");
    let before = folder.listing();
    let more = ["--config", &config, "--seed", "3"];
    let first = replay(&log, &more);
    assert_eq!((first.status, first.err.as_str()), (0, ""));
    assert_eq!(first.out, replay(&log, &more).out);
    assert_ne!(
        first.out,
        replay(&log, &["--config", &config, "--seed", "4"]).out
    );
    let calibrations = of_class(&first.lines(), "CALIBRATION");
    assert!(!calibrations.is_empty());
    for calibration in calibrations {
        assert_eq!(calibration["seed"], 3);
        assert_eq!(calibration["swarm"]["profile"], "paper");
        assert!(calibration["elapsed_us"].is_null());
    }
    assert_eq!(
        folder.listing(),
        before,
        "a replay without --store wrote a file"
    );
}

#[test]
fn the_lines_are_those_of_the_socket() {
    let folder = Folder::new();
    let (header, entries) = simulated(&Settings::default());
    let log = folder.file("a \"b\".csv", log(&(header, entries.clone())));
    let ran = replay(&log, &[]);
    assert_eq!((ran.status, ran.err.as_str()), (0, ""));
    for line in ran.out.lines() {
        assert!(line.starts_with("{\"class\":\""), "{line}");
    }
    let lines = ran.lines();
    let class = |i: usize| lines[i]["class"].as_str().unwrap();
    assert_eq!(
        [class(0), class(1), class(2)],
        ["VERSION", "DEVICES", "WATCH"]
    );
    assert_eq!(lines[1]["devices"][0]["path"], log);
    for key in ["enable", "json", "calibration", "state"] {
        assert_eq!(lines[2][key], true);
    }
    for line in &lines[3..] {
        let class = line["class"].as_str().unwrap();
        assert!(["ATT", "STATE", "CALIBRATION"].contains(&class), "{line}");
        assert!(
            class == "CALIBRATION" || line.get("t_s").is_some(),
            "{line}"
        );
    }
    let atts = of_class(&lines, "ATT");
    for (i, att) in atts.iter().enumerate() {
        assert_eq!(att["seq"], i + 1);
        assert_eq!(att["device"], log);
        assert_eq!(att["age_ms"], 0);
        for (key, value) in att.as_object().unwrap() {
            assert!(
                !value.is_object() && !value.is_array() && !value.is_null(),
                "{key}: {value}"
            );
        }
        assert!(att["raw_heading"].is_f64());
    }
    assert!(atts.windows(2).all(|pair| t_s(&pair[0]) < t_s(&pair[1])));
    errors_deg(&lines, &entries, "raw_heading");
}

/// gpsd's names, units and signs.
#[test]
fn rate_force_and_dip_are_told() {
    let folder = Folder::new();
    let settings = Settings {
        turns: -1.0,
        tilt_deg: 10.0,
        ..Settings::default()
    };
    let log = folder.file("a.csv", log(&simulated(&settings)));
    let lines = lines(&log, &[]);
    let near = |att: &Value, key: &str, right: f64, by: f64| {
        let found = att[key].as_f64().unwrap_or_else(|| panic!("{key}: {att}"));
        assert!(
            (found - right).abs() < by,
            "{key} is {found}, not {right}: {att}"
        );
    };
    let atts = of_class(&lines, "ATT");
    // While it turns, counter-clockwise, its nose up.
    let turning = atts.iter().find(|att| t_s(att) > 8.0).unwrap();
    let rate_deg_s = -settings.turn_deg_s;
    near(turning, "rot", 60.0 * rate_deg_s, 120.0);
    let (sine, cosine) = 10f64.to_radians().sin_cos();
    near(turning, "gyro_x", -rate_deg_s * sine, 2.0);
    near(turning, "gyro_z", rate_deg_s * cosine, 2.0);
    near(turning, "acc_len", 9.8, 0.2);
    near(turning, "acc_x", 9.8 * sine, 0.2);
    near(turning, "acc_z", -9.8 * cosine, 0.2);
    assert!(turning.get("dip").is_none(), "not before it is calibrated");
}

#[test]
fn headings_come_with_the_calibration_and_are_right() {
    let folder = Folder::new();
    for turns in [2.0, -2.0] {
        let (header, entries) = simulated(&turning(turns));
        let log = folder.file("a.csv", log(&(header, entries.clone())));
        let lines = lines(&log, &[]);
        let states = states(&lines);
        assert_eq!(states[..2], ["uncalibrated", "turning"]);
        assert!(["degraded", "good"].contains(&states.last().unwrap().as_str()));
        // The first is that of the first turn, or what motion had taught before it.
        let calibrated = lines
            .iter()
            .position(|l| l["class"] == "CALIBRATION")
            .unwrap();
        assert_eq!(lines[calibrated]["verdict"], "accepted");
        let turned = |l: &Value| l["class"] == "CALIBRATION" && l["method"] == "turn";
        assert!(lines.iter().any(turned));
        for (i, line) in lines
            .iter()
            .enumerate()
            .filter(|(_, l)| l["class"] == "ATT")
        {
            let uncertain = line.get("heading_sd").is_none();
            assert_eq!(steers(line), !uncertain, "{line}");
            if t_s(line) < 5.0 {
                // At rest nothing tells north from iron.
                assert!(uncertain, "{line}");
                assert_eq!(line["mag_st"], "C");
            } else if i > calibrated {
                assert!(line["heading_sd"].as_f64().unwrap() <= 10.0, "{line}");
                assert!(
                    line["mheading"].is_f64() && line["inst_heading"].is_f64(),
                    "{line}"
                );
                assert_eq!(line["mag_st"], "N");
            }
            assert!(
                line.get("mag_z").is_none(),
                "level turns tell nothing of Z: {line}"
            );
            // True heading needs a declination, which nobody gave.
            assert!(line.get("heading").is_none());
        }
        // Three seconds of rest are enough to learn the gyro's bias.
        for (key, largest, typical) in [("mheading", 2.5, 1.0), ("inst_heading", 4.0, 1.2)] {
            let errors = errors_deg(&lines, &entries, key);
            assert!(errors.len() > 400, "{}", errors.len());
            assert_within(&format!("{turns} turns, {key}"), &errors, largest, typical);
        }
    }
}

#[test]
fn level_turns_tell_the_strength_in_their_plane() {
    let folder = Folder::new();
    let ((header, mut entries), calibration) = with_calibration(&folder, "a.csv");
    let horizontal_mgauss = Settings::default().horizontal_mgauss;
    // By the estimate, and by the kept calibration alone.
    for gyro in [true, false] {
        for entry in entries.iter_mut().filter(|_| !gyro) {
            entry.reading.rate_rad_s = None;
        }
        let path = folder.file("b.csv", log(&(header.clone(), entries.clone())));
        let lines = lines(&path, &["--calibration", &calibration]);
        let atts = of_class(&lines, "ATT");
        assert!(atts.len() > 400, "{}", atts.len());
        for att in &atts {
            let number = |key| att.get(key).and_then(Value::as_f64);
            let [Some(x), Some(y), Some(length), None] =
                ["mag_x", "mag_y", "mag_len", "mag_z"].map(number)
            else {
                panic!("with a gyro {gyro}: {att}");
            };
            assert!((length - hypot(x, y)).abs() < 1.0, "{att}");
            // The scale is known as far as the axes' mean is 1.
            assert!((length / horizontal_mgauss - 1.0).abs() < 0.15, "{att}");
        }
    }
}

/// Holds heading errors below a largest and a root mean square.
fn assert_within(what: &str, errors: &[f64], largest: f64, typical: f64) {
    let found = errors.iter().fold(0.0f64, |a, e| a.max(e.abs()));
    assert!(found < largest, "{what}: {found:.2} degrees off");
    assert!(
        rms(errors) < typical,
        "{what}: {:.2} degrees RMS",
        rms(errors)
    );
}

#[test]
fn a_spatial_calibration_carries_any_attitude() {
    let folder = Folder::new();
    let (header, entries) = simulated(&moving(Scenario::Demo));
    let log = folder.file("demo.csv", log(&(header, entries.clone())));
    let spatial = folder.log("a.csv", &moving(Scenario::Spatial));
    let out = folder.path("calibration.json");
    assert_eq!(headingd(&["calibrate", &spatial, "--out", &out]).status, 0);
    let lines = lines(&log, &["--calibration", &out]);
    let atts = of_class(&lines, "ATT");
    assert!(
        atts.iter()
            .all(|att| att["mheading"].is_f64() && att["mag_z"].is_f64())
    );
    let settings = Settings::default();
    let dip_deg = (settings.vertical_mgauss.atan2(settings.horizontal_mgauss)).to_degrees();
    for att in &atts {
        assert!(
            (att["dip"].as_f64().unwrap() - dip_deg).abs() < 3.0,
            "{att}"
        );
    }
    let errors = errors_deg(&lines, &entries, "mheading");
    assert_eq!(errors.len(), atts.len());
    // The first seconds, in which the gyro's bias is learnt, tilt the frame by a degree.
    assert_within("all", &errors, 4.5, 1.5);
    assert_within("from 10 s on", &errors[400..], 2.0, 0.8);
    let single = errors_deg(&lines, &entries, "inst_heading");
    assert_within("of single samples", &single[400..], 4.0, 1.2);
    assert_eq!(states(&lines).last().unwrap(), "good");
}

#[test]
fn without_motion_nothing_is_calibrated_and_with_little_nothing_is_wrong() {
    let folder = Folder::new();
    for turns in [0.5, -0.9] {
        let (header, entries) = simulated(&turning(turns));
        let log = folder.file("a.csv", log(&(header, entries.clone())));
        let errors = errors_deg(&lines(&log, &[]), &entries, "mheading");
        let largest = errors.iter().fold(0.0f64, |a, e| a.max(e.abs()));
        assert!(largest < 20.0, "{turns} turns: {largest}");
    }
    for turns in [0.0, 0.1] {
        let log = folder.log("a.csv", &turning(turns));
        let lines = lines(&log, &[]);
        assert!(of_class(&lines, "CALIBRATION").is_empty());
        assert!(!of_class(&lines, "ATT").iter().any(steers), "{turns} turns");
        let last = of_class(&lines, "STATE").pop().unwrap();
        assert!(["uncalibrated", "turning"].contains(&last["cal_state"].as_str().unwrap()));
    }
    let log = folder.log(
        "a.csv",
        &Settings {
            with_gyro: false,
            ..Settings::default()
        },
    );
    let lines = lines(&log, &[]);
    assert!(!of_class(&lines, "ATT").iter().any(steers));
    assert_eq!(
        of_class(&lines, "STATE").pop().unwrap()["reason"],
        "no_gyro"
    );
}

#[test]
fn a_store_is_touched_only_if_it_is_named() {
    let folder = Folder::new();
    let log = folder.log("a.csv", &Settings::default());
    let store = folder.path("store");
    let first = lines(&log, &["--store", &store]);
    assert!(!steers(&of_class(&first, "ATT")[0]));
    let path = folder.path("store/calibration.json");
    let kept = || -> Value { serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap() };
    assert!(kept()["sensors"][0]["in_force"].is_u64(), "{}", kept());

    let second = lines(&log, &["--store", &store]);
    let atts = of_class(&second, "ATT");
    assert!(steers(&atts[0]));
    let steering = atts.iter().filter(|att| steers(att)).count();
    assert!(steering * 100 >= atts.len() * 95, "{steering}");
    assert!(!of_class(&second, "CALIBRATION").is_empty());

    let files = || (folder.listing(), std::fs::read(&path).unwrap());
    let before = files();
    let third = lines(&log, &[]);
    assert_eq!(third, first, "a replay without --store knew of the store");
    assert_eq!(files(), before);

    // Nor is a locked calibration replaced.
    let mut locked: Value = serde_json::from_slice(&before.1).unwrap();
    locked["sensors"][0]["mode"] = "locked".into();
    std::fs::write(&path, locked.to_string()).unwrap();
    let other = Settings {
        bias_mgauss: [-150.0, -200.0, 50.0],
        ..Settings::default()
    };
    lines(&folder.log("b.csv", &other), &["--store", &store]);
    assert_eq!(
        kept()["sensors"][0]["in_force"],
        locked["sensors"][0]["in_force"]
    );

    // One log's calibration file and one store cannot both be active.
    let both = replay(&log, &["--store", &store, "--calibration", &store]);
    assert_eq!(both.status, 2);
}

#[test]
fn each_way_to_fail_has_its_status() {
    let folder = Folder::new();
    let log = folder.log("a.csv", &turning(0.0));
    let bad = folder.file("bad", "hello\n");
    let missing = folder.path("missing");
    let directory = folder.path("");
    let cases: [(i32, Vec<&str>, &str); 11] = [
        (66, vec![&missing], ""),
        (66, vec![&directory], ""),
        (65, vec![&bad], ""),
        (66, vec![&log, "--calibration", &missing], ""),
        (66, vec![&log, "--calibration", &directory], ""),
        (65, vec![&log, "--calibration", &bad], ""),
        (66, vec![&log, "--config", &missing], ""),
        (78, vec![&log, "--config", &bad], ""),
        (
            73,
            vec![&log, "--store", &bad],
            "name a folder with --store",
        ),
        (2, vec![&log, "--seed", "x"], ""),
        (2, vec![], ""),
    ];
    for (status, args, why) in cases {
        let ran = headingd(&[&["replay"], args.as_slice()].concat());
        assert_eq!(ran.status, status, "{args:?}: {}", ran.err);
        assert_eq!(ran.out, "", "{args:?}");
        assert!(!ran.err.is_empty() && ran.err.contains(why), "{}", ran.err);
    }
}

#[test]
fn another_sensors_calibration_is_refused_but_not_that_of_a_sensor_without_a_name() {
    let folder = Folder::new();
    let ((mut header, entries), calibration) = with_calibration(&folder, "a.csv");
    for (name, status) in [(Some("qmc5883l"), 65), (None, 0)] {
        header.sensor = name.map(str::to_owned);
        let path = folder.file("b.csv", log(&(header.clone(), entries.clone())));
        let ran = headingd(&["replay", &path, "--calibration", &calibration]);
        assert_eq!(ran.status, status, "{}", ran.err);
        assert!(ran.err.contains("hmc5843 mounted"), "{}", ran.err);
    }
}

#[test]
fn an_overflow_gives_no_heading() {
    let folder = Folder::new();
    let ((header, mut entries), calibration) = with_calibration(&folder, "a.csv");
    let mut count = 0;
    for entry in &mut entries {
        if let Some(field) = &mut entry.reading.field_mgauss {
            count += 1;
            // One axis now and then, and all the while from 5 to 6.5 seconds.
            if count % 10 == 0 || (5.0..6.5).contains(&entry.reading.t_s) {
                field[count % 3] = None;
            }
        }
    }
    let path = folder.file("overflow.csv", log(&(header, entries.clone())));
    let lines = lines(&path, &["--calibration", &calibration]);
    let atts = of_class(&lines, "ATT");
    let readings: Vec<&Entry> = entries
        .iter()
        .filter(|entry| entry.reading.field_mgauss.is_some())
        .collect();
    assert_eq!(atts.len(), readings.len());
    for (att, entry) in atts.iter().zip(readings) {
        assert_eq!(steers(att), whole_field(entry), "{att}");
        if !whole_field(entry) {
            assert!(
                att.get("raw_heading").is_none() && att.get("mag_x").is_none(),
                "{att}"
            );
            assert!(
                att.get("mag_len").is_none() && att.get("heading_sd").is_none(),
                "{att}"
            );
        }
    }
    let stale: Vec<Value> = of_class(&lines, "STATE")
        .into_iter()
        .filter(|s| s["reason"] == "overflow")
        .collect();
    assert_eq!(stale.len(), 1);
    assert!((5.4..5.6).contains(&t_s(&stale[0])), "{}", stale[0]);
}

#[test]
fn a_silent_magnetometer_is_stale_and_recovers() {
    let folder = Folder::new();
    let ((header, mut entries), calibration) = with_calibration(&folder, "a.csv");
    let silent = 6.0..7.0;
    entries.retain(|e| e.reading.field_mgauss.is_none() || !silent.contains(&e.reading.t_s));
    let path = folder.file("silent.csv", log(&(header, entries.clone())));
    let lines = lines(&path, &["--calibration", &calibration]);
    let atts = of_class(&lines, "ATT");
    assert!(atts.iter().all(|att| !silent.contains(&t_s(att))));
    let changes: Vec<(String, f64)> = of_class(&lines, "STATE")
        .iter()
        .map(|s| (s["cal_state"].as_str().unwrap().to_owned(), t_s(s)))
        .filter(|(_, t_s)| *t_s > 6.0)
        .collect();
    assert_eq!(changes[0].0, "stale");
    assert!(
        ["degraded", "good"].contains(&changes[1].0.as_str()),
        "{changes:?}"
    );
    // The last sample before is at 5.978 s, and half a second is the limit.
    assert!((6.47..6.5).contains(&changes[0].1), "{changes:?}");
    assert!((7.0..7.03).contains(&changes[1].1), "{changes:?}");
    let back = atts.iter().find(|att| t_s(att) > 7.0).unwrap();
    assert!(back["mheading"].is_f64(), "{back}");
    let errors = errors_deg(&lines, &entries, "mheading");
    assert!(errors.iter().all(|error| error.abs() < 5.0));
    assert!(rms(&errors) < 2.0, "{}", rms(&errors));
}

#[test]
fn rows_that_are_no_rows_are_skipped_and_counted() {
    let folder = Folder::new();
    let whole = simulated(&Settings::default());
    let clean = log(&whole);
    let rows: Vec<&[u8]> = clean.split_inclusive(|byte| *byte == b'\n').collect();
    let garbage: Vec<u8> = (0..=255u8)
        .filter(|b| *b != b'\n')
        .cycle()
        .take(3000)
        .collect();
    let long = [b'1'; 10_000];
    let back = b"1.5,10000,10000,10000,9,9,9,,,,\n";
    let odd = |time: &str| format!("{time},1,2,3,1,2,3,1,2,3,\n").into_bytes();
    let path = folder.file("a.csv", &clean);
    let right = replay(&path, &[]);
    assert_eq!(right.status, 0);
    for (what, bad, count) in [
        ("garbage", [&garbage[..], b"\n"].concat(), 1),
        ("a long line", [&long[..], b"\n"].concat(), 1),
        ("time goes back", back.repeat(3), 3),
        ("a time beyond all others", odd("999999999"), 1),
        ("a time before all others", odd("-5"), 1),
        ("a time that is too late", odd("40"), 1),
        (
            "not numbers",
            b"NaN,1,2,3,,,,,,,\n9,inf,1,1,,,,,,,\n9,1,1\n".to_vec(),
            3,
        ),
    ] {
        let middle = rows.len() / 2;
        let bytes = [&rows[..middle].concat()[..], &bad, &rows[middle..].concat()].concat();
        folder.file("a.csv", bytes);
        let ran = replay(&path, &[]);
        assert_eq!(ran.status, 0, "{what}");
        assert!(ran.out == right.out, "{what} changed the lines");
        let message = format!(
            "{count} {} skipped; the first: log {path}, line {}",
            if count == 1 { "row" } else { "rows" },
            middle + 1
        );
        assert!(ran.err.contains(&message), "{what}: {}", ran.err);
        assert_eq!(ran.err.lines().count(), 1, "{what}: {}", ran.err);
    }
}

#[test]
fn a_time_that_jumps_begins_a_stretch_and_the_calibration_stays() {
    let folder = Folder::new();
    let (header, entries) = simulated(&Settings::default());
    let once = replay(
        &folder.file("a.csv", log(&(header.clone(), entries.clone()))),
        &[],
    );
    let seen = |lines: &[Value]| of_class(lines, "ATT").len();
    for later_s in [-1e6, 0.0, 999_999_999.0] {
        let mut twice = entries.clone();
        twice.extend(entries.iter().map(|entry| {
            let mut entry = *entry;
            entry.reading.t_s += later_s;
            entry
        }));
        let path = folder.file("b.csv", log(&(header.clone(), twice)));
        let found = lines(&path, &[]);
        assert_eq!(seen(&found), 2 * seen(&once.lines()), "{later_s}");
        // The second time it is calibrated from the start, and turns as truly as the first time.
        let second = &of_class(&found, "ATT")[seen(&once.lines())..];
        assert!(second.iter().skip(20).all(steers), "{later_s}");
        assert!(of_class(&found, "CALIBRATION").len() >= 2, "{later_s}");
        let ran = headingd(&["calibrate", &path, "--json"]);
        assert_eq!(ran.status, 0, "{later_s}: {}", ran.err);
    }
}

#[test]
fn a_log_in_milliseconds_is_refused_as_such() {
    let folder = Folder::new();
    let path = folder.changed_log("a.csv", &Settings::default(), |reading| {
        reading.t_s = (1000.0 * reading.t_s).round();
    });
    for command in ["replay", "calibrate", "align"] {
        let ran = headingd(&[command, &path]);
        assert_eq!((ran.status, ran.out.as_str()), (65, ""), "{command}");
        let message = "the gyro's readings are 10 apart in column 1 (t_s), as in milliseconds";
        assert!(ran.err.contains(message), "{command}: {}", ran.err);
    }
}

#[test]
fn a_log_of_which_most_is_skipped_is_a_failure() {
    let folder = Folder::new();
    let clean = log(&simulated(&Settings::default()));
    let rows = clean.iter().filter(|byte| **byte == b'\n').count();
    let path = folder.file("a.csv", [&clean[..], &b"nonsense\n".repeat(rows)].concat());
    for command in ["replay", "calibrate"] {
        let ran = headingd(&[command, &path]);
        assert_eq!(ran.status, 65, "{command}: {}", ran.err);
        let message =
            format!("most of the log cannot be used: {rows} rows skipped; the first: log");
        assert!(ran.err.contains(&message), "{command}: {}", ran.err);
    }
}

#[test]
fn each_command_tells_a_log_without_a_row_and_reads_standard_input() {
    let folder = Folder::new();
    let page = folder.path("a.html");
    let header =
        "it must begin with \"# headingd-log 1\" and its column names, and rows must follow";
    let rows = "it ends after the line of column names, but rows must follow, one a reading";
    for (text, why) in [
        ("", header),
        ("# headingd-log 1\n# a remark\n", header),
        ("# headingd-log 1\nt_s,mx,my,mz", header),
        ("# headingd-log 1\nt_s,mx,my,mz\n", rows),
    ] {
        let path = folder.file("a.csv", text);
        for arguments in [
            &["replay", "-"][..],
            &["calibrate", "-"],
            &["align", "-"],
            &["report", "-", "--out", &page],
        ] {
            let mut command = program();
            let log = std::fs::File::open(&path).unwrap();
            let output = command.args(arguments).stdin(log).output().unwrap();
            let err = String::from_utf8(output.stderr).unwrap();
            assert_eq!(output.status.code(), Some(65), "{arguments:?}: {err}");
            assert_eq!(err, format!("headingd: log - has no reading: {why}\n"));
        }
    }
}

#[test]
fn a_reader_that_goes_away_is_no_failure() {
    let folder = Folder::new();
    let log = folder.log("a.csv", &Settings::default());
    let mut child = program()
        .args(["replay", &log])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut first = String::new();
    BufReader::with_capacity(16, child.stdout.take().unwrap())
        .read_line(&mut first)
        .unwrap();
    assert!(first.starts_with("{\"class\":\"VERSION\""));
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0));
    assert_eq!(String::from_utf8(output.stderr).unwrap(), "");
}

#[test]
fn a_full_disk_is_a_failure() {
    let folder = Folder::new();
    let log = folder.log("a.csv", &Settings::default());
    for args in [&["replay", &log][..], &["calibrate", &log, "--json"]] {
        let full = std::fs::File::options()
            .write(true)
            .open("/dev/full")
            .unwrap();
        let output = program()
            .args(args)
            .stdout(full)
            .stderr(Stdio::piped())
            .output()
            .unwrap();
        assert_eq!(output.status.code(), Some(74), "{args:?}");
        let err = String::from_utf8(output.stderr).unwrap();
        assert!(err.contains("cannot write to standard output"), "{err}");
    }
}
