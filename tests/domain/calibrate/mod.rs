//! `headingd calibrate`: what other programs rely on, and how good its figures are.

use crate::common::{Folder, Ran, apart_deg, headingd, log, of_class, rms, simulated};
use headingd::frame::Mounting;
use headingd::sensor::simulator::{Scenario, Settings};
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use serde::Deserialize;
use serde::de::{Deserializer, MapAccess, Visitor};
use serde_json::{Value, json};

/// The keys of a JSON object in the order they are written, each with its value.
struct Ordered(Vec<(String, Value)>);

impl<'de> Deserialize<'de> for Ordered {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Keys;
        impl<'de> Visitor<'de> for Keys {
            type Value = Ordered;
            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str("an object")
            }
            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Ordered, A::Error> {
                let mut pairs = Vec::new();
                while let Some(pair) = map.next_entry()? {
                    pairs.push(pair);
                }
                Ok(Ordered(pairs))
            }
        }
        deserializer.deserialize_map(Keys)
    }
}

/// Every key of the outcome; flat ones first, since some clients stop at the first array.
const KEYS: [&str; 21] = [
    "verdict",
    "reason",
    "message",
    "method",
    "mode",
    "model",
    "reference_mgauss",
    "residual_mgauss",
    "heading_sd_deg",
    "gyro_rms_deg",
    "seed",
    "basis",
    "bias_mgauss",
    "scale",
    "matrix",
    "alignment_deg",
    "unobserved",
    "samples",
    "window",
    "swarm",
    "elapsed_us",
];

fn calibrate(log: &str, more: &[&str]) -> Ran {
    headingd(&[&["calibrate", log, "--json"], more].concat())
}

/// The outcome of a calibration that must be accepted.
fn accepted(log: &str, more: &[&str]) -> Value {
    let ran = calibrate(log, more);
    assert_eq!(ran.status, 0, "{more:?}: {ran:?}");
    let outcome = ran.json();
    assert_eq!(outcome["verdict"], "accepted", "{more:?}");
    outcome
}

fn numbers(value: &Value) -> Vec<f64> {
    let array = value.as_array().unwrap_or_else(|| panic!("{value}"));
    array.iter().map(|n| n.as_f64().unwrap()).collect()
}

/// The basis in chip axes: of a planar outcome its own, of a spatial one the chip axes.
fn basis(outcome: &Value) -> Vec<Vector3<f64>> {
    match outcome["mode"].as_str() {
        Some("planar") => outcome["basis"]
            .as_array()
            .unwrap()
            .iter()
            .map(vector)
            .collect(),
        _ => (0..3).map(|axis| Vector3::ith(axis, 1.0)).collect(),
    }
}

fn vector(value: &Value) -> Vector3<f64> {
    Vector3::from_column_slice(&numbers(value))
}

fn count(value: &Value) -> u64 {
    value.as_u64().unwrap_or_else(|| panic!("{value}"))
}

fn assert_near(what: &str, found: &[f64], right: &[f64], tolerance: f64) {
    assert_eq!(found.len(), right.len(), "{what}");
    for (f, r) in found.iter().zip(right) {
        assert!(
            (f - r).abs() < tolerance,
            "{what}: {found:?}, not {right:?}"
        );
    }
}

/// Holds an outcome's parameters against the truth, along the outcome's own axes.
fn assert_true(what: &str, outcome: &Value, truth: &Settings, bias_tolerance: f64) {
    let basis = basis(outcome);
    let planar = outcome["mode"] == "planar";
    let matrix = Matrix3::from_diagonal(&Vector3::from(truth.scale));
    // In the plane of a turn the vertical field is a bias like any other.
    let vertical = if planar { truth.vertical_mgauss } else { 0.0 };
    let offset = matrix * Vector3::new(0.0, 0.0, vertical) + Vector3::from(truth.bias_mgauss);
    let bias: Vec<f64> = basis.iter().map(|e| e.dot(&offset)).collect();
    let mut scale: Vec<f64> = basis.iter().map(|e| e.dot(&(matrix * e))).collect();
    if outcome["reference_mgauss"].is_null() {
        let mean = scale.iter().sum::<f64>() / scale.len() as f64;
        scale.iter_mut().for_each(|s| *s /= mean);
        let found = numbers(&outcome["scale"]);
        let mean = found.iter().sum::<f64>() / found.len() as f64;
        assert!((mean - 1.0).abs() < 1e-9, "{what}: mean scale {mean}");
    }
    assert_near(
        what,
        &numbers(&outcome["bias_mgauss"]),
        &bias,
        bias_tolerance,
    );
    assert_near(what, &numbers(&outcome["scale"]), &scale, 0.005);
}

#[test]
fn the_object_has_every_key_in_its_place() {
    let folder = Folder::new();
    let log = folder.log("a.csv", &Settings::default());
    let ran = calibrate(&log, &["--reference-mgauss", "162.8", "--seed", "7"]);
    assert_eq!((ran.status, ran.out.lines().count()), (0, 1));
    let Ordered(pairs) = serde_json::from_str(&ran.out).unwrap();
    let keys: Vec<&str> = pairs.iter().map(|(key, _)| key.as_str()).collect();
    assert_eq!(keys, KEYS);

    let o = ran.json();
    assert_eq!(o["verdict"], "accepted");
    assert_eq!(o["reason"], "good");
    assert!(o["message"].as_str().unwrap().len() > 20);
    assert_eq!(
        (&o["mode"], &o["model"]),
        (&json!("planar"), &json!("diagonal"))
    );
    assert_eq!(
        (&o["reference_mgauss"], &o["seed"]),
        (&json!(162.8), &json!(7))
    );
    assert!(o["matrix"].is_null() && o["alignment_deg"].is_null());
    assert_eq!(o["method"], "turn");
    let [e1, e2] = [&basis(&o)[0], &basis(&o)[1]];
    assert!((e1.norm() - 1.0).abs() < 1e-9 && (e2.norm() - 1.0).abs() < 1e-9);
    assert!(e1.dot(e2).abs() < 1e-9 && e1.cross(e2).z > 0.9999);
    for key in ["bias_mgauss", "scale"] {
        assert_eq!(numbers(&o[key]).len(), 2);
        assert_eq!(numbers(&o["swarm"][key]).len(), 2);
    }
    assert!((1.7..2.3).contains(&o["residual_mgauss"].as_f64().unwrap()));
    assert!((0.01..0.2).contains(&o["heading_sd_deg"].as_f64().unwrap()));
    assert!((0.1..2.0).contains(&o["gyro_rms_deg"].as_f64().unwrap()));

    let samples = ["used", "window", "turn", "total"].map(|key| count(&o["samples"][key]));
    let [used, window, turn, total] = samples;
    assert!(
        0 < window && window <= turn && used <= turn && turn <= total,
        "{samples:?}"
    );
    let mag_rows = simulated(&Settings::default())
        .1
        .iter()
        .filter(|e| e.reading.field_mgauss.is_some())
        .count();
    assert_eq!(total, mag_rows as u64);
    let (start, end) = (count(&o["window"]["start"]), count(&o["window"]["end"]));
    assert!(start < end && end <= total);
    assert_eq!(end - start, window);

    let swarm = &o["swarm"];
    assert_eq!(
        (&swarm["profile"], &swarm["particles"]),
        (&json!("standard"), &json!(30))
    );
    assert!((1..=1000).contains(&count(&swarm["iterations"])));
    assert_eq!(swarm["stop"], "change");
    assert!(swarm["fit_value"].as_f64().unwrap() > 0.0);
    let keys = |value: &Value| -> Vec<String> {
        let mut keys: Vec<String> = value.as_object().unwrap().keys().cloned().collect();
        keys.sort();
        keys
    };
    assert_eq!(
        keys(swarm),
        [
            "bias_mgauss",
            "fit_value",
            "iterations",
            "particles",
            "profile",
            "scale",
            "stop"
        ]
    );
    assert_eq!(keys(&o["samples"]), ["total", "turn", "used", "window"]);
    assert_eq!(keys(&o["window"]), ["end", "start"]);
    let steps = ["refine", "rist", "swarm", "verdict"];
    assert_eq!(
        keys(&o["elapsed_us"]),
        ["refine", "rist", "swarm", "total", "verdict"]
    );
    let sum: u64 = steps
        .iter()
        .map(|step| count(&o["elapsed_us"][*step]))
        .sum();
    assert!(sum <= count(&o["elapsed_us"]["total"]));
}

#[test]
fn a_spatial_outcome_has_three_of_each_and_no_basis() {
    let folder = Folder::new();
    let settings = Settings {
        scenario: Scenario::Spatial,
        ..Settings::default()
    };
    let log = folder.log("a.csv", &settings);
    let outcome = accepted(&log, &[]);
    assert_eq!(outcome["mode"], "spatial");
    assert!(outcome["basis"].is_null() && outcome["matrix"].is_null());
    assert!(outcome["reference_mgauss"].is_null());
    assert_eq!(numbers(&outcome["swarm"]["scale"]).len(), 3);
    assert_true("spatial", &outcome, &settings, 1.0);
}

#[test]
fn what_is_not_known_is_null() {
    let folder = Folder::new();
    let head = "# headingd-log 1\nt_s,mx,my,mz,gx,gy,gz\n";
    for rows in [
        "",
        "0,1,2,3,,,\n",
        "0,1,2,3,,,\n0.1,1,2,3,0,0,0.1\n",
        "0,,,,0,0,1\n",
    ] {
        let ran = calibrate(&folder.file("a.csv", format!("{head}{rows}")), &[]);
        assert_eq!(ran.status, 3, "{rows}: {ran:?}");
        assert_eq!(ran.err, "", "what was to be said stands in the outcome");
        let Ordered(pairs) = serde_json::from_str(&ran.out).unwrap();
        let keys: Vec<&str> = pairs.iter().map(|(key, _)| key.as_str()).collect();
        assert_eq!(keys, KEYS);
        let o = ran.json();
        assert_eq!(
            (&o["verdict"], &o["reason"]),
            (&json!("rejected"), &json!("too_few_samples"))
        );
        let mag_rows = rows.matches("1,2,3").count();
        assert_eq!(
            o["samples"],
            json!({"total": mag_rows, "turn": 0, "window": 0, "used": 0})
        );
        for key in [
            "mode",
            "model",
            "reference_mgauss",
            "residual_mgauss",
            "heading_sd_deg",
            "gyro_rms_deg",
            "basis",
            "bias_mgauss",
            "scale",
            "matrix",
            "alignment_deg",
            "window",
            "swarm",
        ] {
            assert!(o[key].is_null(), "{key}: {}", o[key]);
        }
        for step in ["rist", "swarm", "refine", "verdict"] {
            assert!(o["elapsed_us"][step].is_null());
        }
        assert!(o["elapsed_us"]["total"].is_u64());
    }
}

#[test]
fn a_refused_fit_still_shows_its_figures() {
    let folder = Folder::new();
    // Half a turn: a fit, but too little of the circle.
    let log = folder.log(
        "a.csv",
        &Settings {
            turns: 0.5,
            ..Settings::default()
        },
    );
    let out = folder.path("out.json");
    for (more, reason, axes) in [
        (&[][..], "heading_uncertainty", 3),
        (&["--window", "all"], "coverage", 2),
    ] {
        let ran = calibrate(&log, &[&["--out", &out], more].concat());
        assert_eq!(ran.status, 3);
        let outcome = ran.json();
        assert_eq!(
            (&outcome["verdict"], &outcome["reason"]),
            (&json!("rejected"), &json!(reason))
        );
        assert_eq!(numbers(&outcome["bias_mgauss"]).len(), axes);
        assert_eq!(numbers(&outcome["scale"]).len(), axes);
        assert!(
            !std::path::Path::new(&out).exists(),
            "a refused calibration was written"
        );
        // A person gets the same answer.
        let ran = headingd(&[&["calibrate", &log], more].concat());
        assert_eq!(ran.status, 3);
        let begins = format!("rejected ({reason}): ");
        assert!(ran.out.starts_with(&begins), "{}", ran.out);
    }
}

/// Heading errors that a spatial outcome leaves on a level turn without noise, RMS, degrees.
fn level_error_deg(outcome: &Value, truth: &Settings) -> f64 {
    let bias = vector(&outcome["bias_mgauss"]);
    let matrix = Matrix3::from_row_slice(&numbers(&outcome["matrix"]));
    let inverse = matrix.try_inverse().unwrap();
    let earth = Vector3::new(truth.horizontal_mgauss, 0.0, truth.vertical_mgauss);
    let errors: Vec<f64> = (0..360)
        .map(|heading| {
            let yaw = f64::from(heading).to_radians();
            let pose = UnitQuaternion::from_euler_angles(0.0, 0.0, yaw);
            let field = pose.inverse_transform_vector(&earth);
            let raw =
                field.component_mul(&Vector3::from(truth.scale)) + Vector3::from(truth.bias_mgauss);
            let corrected = inverse * (raw - bias);
            let found = (-corrected.y).atan2(corrected.x).to_degrees();
            apart_deg(found, f64::from(heading))
        })
        .collect();
    rms(&errors)
}

#[test]
fn motion_without_a_full_turn_calibrates_by_the_estimate() {
    let folder = Folder::new();
    for seed in 1..=8 {
        let truth = Settings {
            scenario: Scenario::Free,
            seed,
            ..Settings::default()
        };
        let log = folder.log("a.csv", &truth);
        let out = folder.path("out.json");
        let outcome = accepted(&log, &["--out", &out]);
        assert_eq!(
            (&outcome["method"], &outcome["mode"], &outcome["model"]),
            (&json!("motion"), &json!("spatial"), &json!("general"))
        );
        assert!(outcome["swarm"].is_null() && outcome["window"].is_null());
        let claimed = outcome["heading_sd_deg"].as_f64().unwrap();
        let error = level_error_deg(&outcome, &truth);
        assert!(
            claimed < 3.0 && error < claimed,
            "{seed}: {error}, {claimed}"
        );
        assert_near(
            "bias",
            &numbers(&outcome["bias_mgauss"]),
            &truth.bias_mgauss,
            5.0,
        );
        let alignment = vector(&outcome["alignment_deg"]).norm();
        assert!(
            alignment < 1.0,
            "{seed}: the chips are parallel: {alignment}"
        );
        // It serves from the first reading on.
        let ran = headingd(&["replay", &log, "--calibration", &out]);
        assert!(of_class(&ran.lines(), "ATT")[0]["mheading"].is_f64());
    }
}

#[test]
fn motion_must_teach_as_much_as_the_daemon_asks_for() {
    let folder = Folder::new();
    let free = folder.log(
        "free.csv",
        &Settings {
            scenario: Scenario::Free,
            ..Settings::default()
        },
    );
    let strict = folder.file("strict.toml", "[heading]\ngood_sd_deg = 0.5\n");
    let nod = folder.log(
        "nod.csv",
        &Settings {
            turns: 0.1,
            ..Settings::default()
        },
    );
    for (log, more, says) in [
        (&free, &["--config", &strict][..], "at most 0.5"),
        (&nod, &[], "at most 3.0"),
    ] {
        let ran = calibrate(log, more);
        assert_eq!(ran.status, 3, "{ran:?}");
        let outcome = ran.json();
        assert_eq!(
            (&outcome["reason"], &outcome["method"]),
            (&json!("heading_uncertainty"), &json!("motion"))
        );
        let message = outcome["message"].as_str().unwrap();
        assert!(
            message.contains("no full turn") && message.contains(says),
            "{message}"
        );
        // The deviation it names is the one that it reports.
        let claimed = outcome["heading_sd_deg"].as_f64().unwrap();
        assert!(
            message.contains(&format!("{claimed:.1} degrees")),
            "{message}"
        );
    }
}

#[test]
fn a_magnet_at_the_end_of_the_motion_is_told() {
    let folder = Folder::new();
    let (header, mut entries) = simulated(&Settings {
        scenario: Scenario::Free,
        ..Settings::default()
    });
    let end_s = entries.last().unwrap().reading.t_s;
    for entry in &mut entries {
        if let (true, Some(field)) = (
            entry.reading.t_s > end_s - 1.5,
            &mut entry.reading.field_mgauss,
        ) {
            field[0] = field[0].map(|b| b + 400.0);
        }
    }
    let log = folder.file("a.csv", log(&(header, entries)));
    let ran = calibrate(&log, &[]);
    assert_eq!(
        (ran.status, &ran.json()["reason"]),
        (3, &json!("outliers")),
        "{ran:?}"
    );
}

#[test]
fn a_stuck_magnetometer_is_refused() {
    let folder = Folder::new();
    let (header, mut entries) = simulated(&Settings::default());
    for entry in &mut entries {
        if let Some(field) = &mut entry.reading.field_mgauss {
            *field = [Some(100.0), Some(-50.0), Some(400.0)];
        }
    }
    let log = folder.file("a.csv", log(&(header, entries)));
    for more in [
        &[][..],
        &["--mode", "spatial"],
        &["--plane", "xy"],
        &["--profile", "paper"],
    ] {
        let ran = calibrate(&log, more);
        assert_eq!(ran.status, 3, "{more:?}: {ran:?}");
        assert_eq!(ran.json()["verdict"], "rejected");
    }
}

/// The chip reads the end of its range over an arc, and does not say so.
#[test]
fn a_turn_in_which_an_axis_clips_is_refused() {
    let folder = Folder::new();
    let (header, entries) = simulated(&Settings::default());
    let fields = entries.iter().filter_map(|e| e.reading.field_mgauss?[0]);
    let (low, high) = fields.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| {
        (low.min(x), high.max(x))
    });
    // Of what X swings through; an arc of 51°, 74° and 127°.
    for share in [0.05, 0.1, 0.28] {
        let mut clipped = entries.clone();
        for field in clipped
            .iter_mut()
            .filter_map(|e| e.reading.field_mgauss.as_mut())
        {
            field[0] = field[0].map(|x| x.min(high - share * (high - low)));
        }
        let log = folder.file("a.csv", log(&(header.clone(), clipped)));
        let ran = calibrate(&log, &[]);
        let reason = &ran.json()["reason"];
        assert_eq!(
            (ran.status, reason),
            (3, &json!("stuck_axis")),
            "{share}: {ran:?}"
        );
    }
}

#[test]
fn each_way_to_fail_has_its_status() {
    let folder = Folder::new();
    let good = folder.log("good.csv", &Settings::default());
    let no_gyro = folder.log(
        "no_gyro.csv",
        &Settings {
            with_gyro: false,
            ..Settings::default()
        },
    );
    let good_config = folder.file("good.toml", "[calibration]\nseed = 5\n");
    let bad_config = folder.file("bad.toml", "[calibration]\nparticles = 1\n");
    let no_toml = folder.file("no.toml", "[calibration\n");
    let not_text = folder.file("binary.toml", [0xff, 0xfe, 0]);
    let missing = folder.path("missing");
    let directory = folder.path("");
    let head = |lines: &str| format!("# headingd-log 1\n{lines}\nt_s,mx,my,mz\n0,1,2,3\n");
    let mut cases: Vec<(i32, Vec<&str>, &str)> = vec![
        (2, vec![&no_gyro], "--mode spatial"),
        (2, vec![&no_gyro, "--mode", "planar"], "--plane xy"),
        (
            2,
            vec![&good, "--plane", "xy", "--mode", "spatial"],
            "--plane and --mode",
        ),
        (2, vec![&good, "--mode", "round"], "round"),
        (2, vec![&good, "--plane", "zz"], "zz"),
        (2, vec![&good, "--profile", "best"], "best"),
        (2, vec![&good, "--window", "half"], "half"),
        (2, vec![&good, "--stop", "never"], "never"),
        (2, vec![&good, "--seed", "-1"], "-1"),
        (2, vec![&good, "--seed", "x"], "--seed"),
        (2, vec![&good, "--reference-mgauss", "0"], "milligauss"),
        (2, vec![&good, "--reference-mgauss=-160"], "milligauss"),
        (2, vec![&good, "--reference-mgauss", "NaN"], "milligauss"),
        (2, vec![&good, "--reference-mgauss", "inf"], "milligauss"),
        (2, vec![&good, "--frobnicate"], "--frobnicate"),
        (2, vec![], "<LOG>"),
        (2, vec![&good, &good], "unexpected"),
        (66, vec![&missing], "no such file"),
        (66, vec![&directory], "directory"),
        (
            66,
            vec![&good, "--config", &missing],
            "cannot read configuration",
        ),
        (
            66,
            vec![&good, "--config", &directory],
            "cannot read configuration",
        ),
        (78, vec![&good, "--config", &bad_config], "particles"),
        (78, vec![&good, "--config", &no_toml], "no.toml"),
        (78, vec![&good, "--config", &not_text], "UTF-8"),
        (
            73,
            vec![&good, "--out", "/proc/none/out.json"],
            "/proc/none",
        ),
    ];
    let faults = [
        (String::new(), "the log is empty"),
        ("hello\n".to_owned(), "the first line is"),
        ("# headingd-log 2\nt_s\n".to_owned(), "format version 2"),
        ("# headingd-log 1\n".to_owned(), "ends within its header"),
        (
            "# headingd-log 1\nt_s,mx,my,mz".to_owned(),
            "ends within its header",
        ),
        ("# headingd-log 1\nmx,my,mz\n".to_owned(), "t_s"),
        ("# headingd-log 1\nt_s,mx\n".to_owned(), "my"),
        ("# headingd-log 1\nt_s,mx,my,mz,mx\n".to_owned(), "mx"),
        (head("# mag_unit = tesla"), "mag_unit"),
        (head("# mag_unit = counts"), "counts_per_gauss"),
        (head("# mag_axes = +x +x +z"), "mag_axes"),
        (head("# sensor = a\n# sensor = b"), "sensor"),
    ];
    let paths: Vec<String> = (faults.iter().enumerate())
        .map(|(i, (text, _))| folder.file(&format!("fault-{i}.csv"), text))
        .collect();
    cases.extend(
        paths
            .iter()
            .zip(&faults)
            .map(|(path, (_, why))| (65, vec![path.as_str()], *why)),
    );
    for (status, args, why) in cases {
        let ran = headingd(&[&["calibrate", "--json"], &args[..]].concat());
        assert_eq!(ran.status, status, "{args:?}: {ran:?}");
        assert!(
            ran.err.contains(why),
            "{args:?} must say {why}: {}",
            ran.err
        );
        assert_eq!(ran.out, "", "{args:?}");
    }
    // Without a gyro these work.
    assert_true(
        "xy",
        &accepted(&no_gyro, &["--plane", "xy"]),
        &Settings::default(),
        0.5,
    );
    // A level turn says nothing of Z.
    let ran = calibrate(&no_gyro, &["--mode", "spatial"]);
    assert_eq!((ran.status, &ran.json()["mode"]), (3, &json!("spatial")));
    assert_eq!(accepted(&good, &["--config", &good_config])["seed"], 5);
    let both = ["--config", &good_config, "--seed", "6"];
    assert_eq!(accepted(&good, &both)["seed"], 6);
}

const PROFILES: [&str; 2] = ["standard", "paper"];
const WINDOWS: [&str; 3] = ["rist", "turn", "all"];
const STOPS: [&str; 2] = ["mpsot", "basic"];

/// Calls `test` with every combination of profile, window and stop.
fn each_way(mut test: impl FnMut(&[&str])) {
    for profile in PROFILES {
        for window in WINDOWS {
            for stop in STOPS {
                test(&["--profile", profile, "--window", window, "--stop", stop]);
            }
        }
    }
}

#[test]
fn every_way_to_calibrate_a_plane_finds_the_truth() {
    let folder = Folder::new();
    let truth = Settings::default();
    let log = folder.log("a.csv", &truth);
    each_way(|way| {
        for mode in ["auto", "planar"] {
            for reference in [&[][..], &["--reference-mgauss", "162.8"]] {
                let more = [way, reference, &["--mode", mode]].concat();
                let outcome = accepted(&log, &more);
                assert_eq!(outcome["mode"], "planar");
                assert_eq!(outcome["swarm"]["profile"], way[1]);
                assert_true(&format!("{more:?}"), &outcome, &truth, 0.7);
                if way[5] == "basic" {
                    assert_eq!(outcome["swarm"]["stop"], "iterations");
                    assert_eq!(outcome["swarm"]["iterations"], 1000);
                }
            }
        }
    });
}

#[test]
fn what_the_board_does_after_its_turns_does_no_harm() {
    let folder = Folder::new();
    for seed in 1..=8 {
        let settings = Settings {
            scenario: Scenario::Demo,
            seed,
            ..Settings::default()
        };
        let log = folder.log("log.csv", &settings);
        let outcome = accepted(&log, &[]);
        assert_true("demo", &outcome, &settings, 0.5);
        // The turns, and nothing of the walk that tilts the board.
        let turn = count(&outcome["samples"]["turn"]);
        assert!((530..700).contains(&turn), "{outcome}");
    }
}

#[test]
fn every_way_to_calibrate_a_named_plane_finds_the_truth() {
    let folder = Folder::new();
    let truth = Settings::default();
    let whole = simulated(&truth);
    // The same board with its magnetometer mounted in another way: chip axes of the body's X, Y, Z.
    for (plane, axes, of_body) in [
        ("xy", "+x +y +z", [0, 1, 2]),
        ("xz", "+x +z -y", [0, 2, 1]),
        ("yz", "+y +z +x", [1, 2, 0]),
    ] {
        let (mut header, mut entries) = whole.clone();
        let mounting: Mounting = axes.parse().unwrap();
        header.mountings.mag = mounting;
        for entry in &mut entries {
            let chip = entry
                .reading
                .whole_field_mgauss()
                .map(|field| mounting.to_chip(field));
            entry.reading.field_mgauss = chip.map(|chip| <[f64; 3]>::from(chip).map(Some));
        }
        let log = folder.file(&format!("{plane}.csv"), log(&(header, entries)));
        each_way(|way| {
            let more = [way, &["--plane", plane, "--reference-mgauss", "162.8"]].concat();
            let outcome = accepted(&log, &more);
            let right: Vec<Value> = (0..2)
                .map(|i| json!(Vector3::<f64>::ith(of_body[i], 1.0).as_slice()))
                .collect();
            assert_eq!(outcome["basis"], json!(right), "{more:?}");
            let what = format!("{more:?}");
            assert_near(
                &what,
                &numbers(&outcome["bias_mgauss"]),
                &truth.bias_mgauss[..2],
                0.5,
            );
            assert_near(&what, &numbers(&outcome["scale"]), &truth.scale[..2], 0.005);
        });
        // The gyro finds the same plane by itself.
        let outcome = accepted(&log, &["--reference-mgauss", "162.8"]);
        let [e1, e2] = [&basis(&outcome)[0], &basis(&outcome)[1]];
        let normal = Vector3::ith(of_body[2], 1.0);
        assert!(
            e1.cross(e2).dot(&normal).abs() > 1f64.to_radians().cos(),
            "{plane}"
        );
    }
}

#[test]
fn every_way_to_calibrate_three_axes_finds_the_truth() {
    let folder = Folder::new();
    let total = headingd::frame::hypot(162.8, 526.7).to_string();
    for (scenario, modes) in [
        (Scenario::Spatial, &["auto", "spatial"][..]),
        (Scenario::Free, &["spatial"]),
    ] {
        let truth = Settings {
            scenario,
            ..Settings::default()
        };
        let log = folder.log("a.csv", &truth);
        each_way(|way| {
            // Without a full turn, only all samples together are fitted.
            if scenario == Scenario::Free && way[3] != "all" {
                return;
            }
            for mode in modes {
                let more = [way, &["--mode", mode, "--reference-mgauss", &total]].concat();
                let outcome = accepted(&log, &more);
                assert_eq!(outcome["mode"], "spatial");
                assert_true(&format!("{scenario:?} {more:?}"), &outcome, &truth, 1.0);
            }
        });
    }
}

#[test]
fn a_named_plane_needs_its_own_two_axes_only() {
    let folder = Folder::new();
    let (header, mut entries) = simulated(&Settings::default());
    for entry in &mut entries {
        if let Some(field) = &mut entry.reading.field_mgauss {
            field[2] = None;
        }
    }
    let log = folder.file("a.csv", log(&(header, entries)));
    let more = ["--plane", "xy", "--reference-mgauss", "162.8"];
    assert_true(
        "z overflowed",
        &accepted(&log, &more),
        &Settings::default(),
        0.5,
    );
    let ran = calibrate(&log, &[]);
    assert_eq!(
        (ran.status, &ran.json()["reason"]),
        (3, &json!("too_few_samples"))
    );
}

#[test]
fn spikes_change_nothing() {
    let folder = Folder::new();
    let truth = Settings {
        spikes: 0.03,
        ..Settings::default()
    };
    let log = folder.log("a.csv", &truth);
    each_way(|way| {
        let more = [way, &["--reference-mgauss", "162.8"]].concat();
        let outcome = accepted(&log, &more);
        assert_true(&format!("{more:?}"), &outcome, &truth, 0.7);
        let samples = &outcome["samples"];
        assert!(count(&samples["used"]) < count(&samples["turn"]));
    });
}

#[test]
fn the_seed_alone_decides_what_the_swarm_does() {
    let folder = Folder::new();
    let log = folder.log("a.csv", &Settings::default());
    for profile in PROFILES {
        let run = |seed: &str| {
            let mut outcome = accepted(&log, &["--seed", seed, "--profile", profile]);
            outcome
                .as_object_mut()
                .unwrap()
                .remove("elapsed_us")
                .unwrap();
            outcome
        };
        let first = run("1");
        assert_eq!(first, run("1"));
        for seed in ["2", "18446744073709551615"] {
            let other = run(seed);
            assert_eq!(other["seed"].to_string(), seed);
            // The standard swarm starts at the conic fit, which is hard to beat: its answer may be the same.
            if profile == "paper" {
                assert_ne!(first["swarm"], other["swarm"]);
            }
            for key in ["bias_mgauss", "scale"] {
                assert_near(key, &numbers(&other[key]), &numbers(&first[key]), 1e-3);
            }
        }
    }
}

#[test]
fn a_calibration_written_is_used_from_the_first_reading_on() {
    let folder = Folder::new();
    let log = folder.log("a.csv", &Settings::default());
    let out = folder.path("out.json");
    accepted(&log, &["--out", &out]);
    let ran = headingd(&["replay", &log, "--calibration", &out]);
    assert_eq!((ran.status, ran.err.as_str()), (0, ""));
    let att = of_class(&ran.lines(), "ATT");
    assert!(
        att.len() > 800 && att.iter().all(|att| att["mheading"].is_f64()),
        "{}",
        att[0]
    );
    assert!(apart_deg(att[0]["mheading"].as_f64().unwrap(), 0.0).abs() < 3.0);
}

/// Headings that a planar outcome gives for noise-free samples of a turn at its tilt, less the true ones,
/// degrees.
fn heading_errors_deg(outcome: &Value, truth: &Settings) -> Vec<f64> {
    let e = basis(outcome);
    let (bias, scale) = (numbers(&outcome["bias_mgauss"]), numbers(&outcome["scale"]));
    let down = e[0].cross(&e[1]);
    let forward = (Vector3::x() - down * down.x).normalize();
    let right = down.cross(&forward);
    let earth = Vector3::new(truth.horizontal_mgauss, 0.0, truth.vertical_mgauss);
    (0..360)
        .map(|heading| {
            let yaw = f64::from(heading).to_radians();
            let pose = UnitQuaternion::from_euler_angles(0.0, truth.tilt_deg.to_radians(), yaw);
            let field = pose.inverse_transform_vector(&earth);
            let raw =
                field.component_mul(&Vector3::from(truth.scale)) + Vector3::from(truth.bias_mgauss);
            let corrected = (0..2)
                .map(|i| e[i] * ((e[i].dot(&raw) - bias[i]) / scale[i]))
                .sum::<Vector3<f64>>();
            let found = (-corrected.dot(&right)).atan2(corrected.dot(&forward));
            apart_deg(found.to_degrees(), f64::from(heading))
        })
        .collect()
}

#[test]
fn headings_are_right_within_a_tenth_of_a_degree() {
    let folder = Folder::new();
    // Two turns of these samples hold a heading to 0.055 degrees at best, so that one seed in fifty is beyond
    // 0.1. With the tilt comes what the gyro, of which the rest before the turns was too short to learn all
    // of its bias, leaves the plane askew.
    for (turns, tilt_deg, typical, limit) in [
        (2.0, 0.0, 0.06, 0.1),
        (-2.0, 0.0, 0.06, 0.11),
        (2.0, 10.0, 0.065, 0.1),
        (-2.0, 10.0, 0.09, 0.13),
    ] {
        let errors: Vec<f64> = (1..=20)
            .map(|seed| {
                let truth = Settings {
                    turns,
                    tilt_deg,
                    seed,
                    ..Settings::default()
                };
                let log = folder.log("a.csv", &truth);
                rms(&heading_errors_deg(&accepted(&log, &[]), &truth))
            })
            .collect();
        let what = format!("{turns} turns, tilt {tilt_deg}: {errors:.3?}");
        assert!(errors.iter().all(|error| *error < limit), "{what}");
        assert!(rms(&errors) < typical, "{what}");
    }
}

#[test]
fn no_angle_is_minus_zero() {
    let folder = Folder::new();
    let part = Settings {
        turns: 0.6,
        ..Settings::default()
    };
    let ran = headingd(&["calibrate", &folder.log("a.csv", &part)]);
    assert!(
        ran.out.contains("turned  0.0  0.0  0.0  degrees"),
        "{}",
        ran.out
    );
}
