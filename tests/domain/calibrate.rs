//! `headingd calibrate`: what other programs rely on.

mod figures;

use crate::common::{
    Folder, Ran, apart_deg, carried, finished, headingd, log, moving, of_class, program, simulated,
    turning,
};
use headingd::recording::{Entry, Header};
use headingd::sensor::simulator::{Scenario, Settings};
use headingd::store::CalibrationFile;
use nalgebra::{Matrix3, Rotation3, Vector3};
use serde_json::{Value, json};
use std::f64::consts::TAU;
use std::fs;

/// The keys of a JSON object in the order in which they are written, without those of objects within it.
fn keys_in_order(object: &str) -> String {
    let mut depth = 0;
    let outermost = object.chars().filter(|c| {
        match c {
            '{' | '[' => depth += 1,
            '}' | ']' => depth -= 1,
            _ => {}
        }
        depth < 2
    });
    let outermost: String = outermost.collect();
    let keys = outermost.split(['{', ',']).filter_map(|pair| {
        let (key, _) = pair.split_once("\":")?;
        key.strip_prefix('"')
    });
    keys.collect::<Vec<_>>().join(" ")
}

/// Every key of the outcome; flat ones first, since some clients stop at the first array.
const KEYS: &str = "verdict reason message method mode model reference_mgauss residual_mgauss heading_sd_deg gyro_rms_deg \
                    seed basis bias_mgauss scale matrix alignment_deg unobserved samples window swarm elapsed_us";

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
    assert_eq!(keys_in_order(&ran.out), KEYS);

    let o = ran.json();
    assert_eq!(o["verdict"], "accepted");
    assert_eq!(o["reason"], "good");
    assert!(o["message"].as_str().unwrap().len() > 20);
    assert_eq!(o["mode"], "planar");
    assert_eq!(o["model"], "diagonal");
    assert_eq!(o["reference_mgauss"], 162.8);
    assert_eq!(o["seed"], 7);
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
    let (_, entries) = simulated(&Settings::default());
    let mut fields: Vec<_> = entries
        .iter()
        .filter_map(|e| e.reading.field_mgauss)
        .collect();
    // The chip's steps are coarse: now and then it measures the same again.
    fields.dedup();
    assert_eq!(total, fields.len() as u64);
    let (start, end) = (count(&o["window"]["start"]), count(&o["window"]["end"]));
    assert!(start < end && end <= total);
    assert_eq!(end - start, window);

    let swarm = &o["swarm"];
    assert_eq!(swarm["profile"], "standard");
    assert_eq!(swarm["particles"], 30);
    assert!((1..=1000).contains(&count(&swarm["iterations"])));
    assert_eq!(swarm["stop"], "change");
    assert!(swarm["fit_value"].as_f64().unwrap() > 0.0);
    let keys = |value: &Value| {
        let mut keys: Vec<&str> = value
            .as_object()
            .unwrap()
            .keys()
            .map(|key| &**key)
            .collect();
        keys.sort();
        keys.join(" ")
    };
    let right = "bias_mgauss fit_value iterations particles profile scale stop";
    assert_eq!(keys(swarm), right);
    assert_eq!(keys(&o["samples"]), "total turn used window");
    assert_eq!(keys(&o["window"]), "end start");
    assert!(o["elapsed_us"].is_u64());
}

#[test]
fn a_spatial_outcome_has_three_of_each_and_no_basis() {
    let folder = Folder::new();
    let settings = moving(Scenario::Spatial);
    let log = folder.log("a.csv", &settings);
    let outcome = accepted(&log, &[]);
    assert_eq!(outcome["mode"], "spatial");
    assert!(outcome["basis"].is_null() && outcome["matrix"].is_null());
    assert!(outcome["reference_mgauss"].is_null());
    assert_eq!(numbers(&outcome["swarm"]["scale"]).len(), 3);
    assert_true("spatial", &outcome, &settings, 1.0);
}

#[test]
fn soft_iron_is_found_but_where_the_papers_model_is_asked_for() {
    let folder = Folder::new();
    let log = folder.changed_log("a.csv", &moving(Scenario::Spatial), |reading| {
        if let Some([Some(x), Some(y), _]) = &mut reading.field_mgauss {
            (*x, *y) = (*x + 0.1 * *y, *y + 0.1 * *x);
        }
    });
    for (more, model) in [
        (&[][..], "symmetric"),
        (&["--model", "diagonal"], "diagonal"),
    ] {
        assert_eq!(calibrate(&log, more).json()["model"], model);
    }
}

#[test]
fn what_is_not_known_is_null() {
    let folder = Folder::new();
    let head = "# headingd-log 1\nt_s,mx,my,mz,gx,gy,gz\n";
    for rows in [
        "0,1,2,3,,,\n",
        "0,1,2,3,,,\n0.1,1,2,4,0,0,0.1\n",
        "0,,,,0,0,1\n",
    ] {
        let ran = calibrate(&folder.file("a.csv", format!("{head}{rows}")), &[]);
        assert_eq!(ran.status, 3, "{rows}: {ran:?}");
        assert_eq!(ran.err, "", "what was to be said stands in the outcome");
        assert_eq!(keys_in_order(&ran.out), KEYS);
        let o = ran.json();
        assert_eq!(o["verdict"], "rejected");
        assert_eq!(o["reason"], "too_few_samples");
        let mag_rows = rows.matches(",1,2,").count();
        assert_eq!(
            o["samples"],
            json!({"total": mag_rows, "turn": 0, "window": 0, "used": 0})
        );
        let known = "verdict reason message method seed unobserved samples elapsed_us";
        for key in KEYS.split(' ') {
            if known.split(' ').any(|word| word == key) {
                continue;
            }
            assert!(o[key].is_null(), "{key}: {}", o[key]);
        }
        assert!(o["elapsed_us"].is_u64());
    }
}

#[test]
fn a_refused_fit_still_shows_its_figures() {
    let folder = Folder::new();
    // Half a turn: a fit, but too little of the circle.
    let log = folder.log("a.csv", &turning(0.5));
    let out = folder.path("out.json");
    for (more, reason, axes) in [
        (&[][..], "heading_uncertainty", 3),
        (&["--window", "all"], "coverage", 2),
    ] {
        let ran = calibrate(&log, &[&["--out", &out], more].concat());
        assert_eq!(ran.status, 3);
        let outcome = ran.json();
        assert_eq!(outcome["verdict"], "rejected");
        assert_eq!(outcome["reason"], reason);
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

#[test]
fn motion_must_teach_as_much_as_the_daemon_asks_for() {
    let folder = Folder::new();
    let free = folder.log("free.csv", &moving(Scenario::Free));
    let strict = folder.file("strict.toml", "[heading]\ngood_sd_deg = 0.5\n");
    let nod = folder.log("nod.csv", &turning(0.1));
    for (log, more, says) in [
        (&free, &["--config", &strict][..], "at most 0.5"),
        (&nod, &[], "at most 3.0"),
    ] {
        let ran = calibrate(log, more);
        assert_eq!(ran.status, 3, "{ran:?}");
        let outcome = ran.json();
        assert_eq!(outcome["reason"], "heading_uncertainty");
        assert_eq!(outcome["method"], "motion");
        let message = outcome["message"].as_str().unwrap();
        assert!(
            message.contains("full turn was recognised") && message.contains(says),
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
    let (header, mut entries) = simulated(&moving(Scenario::Free));
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

/// The chip reads the end of its range over an arc, and does not say so.
#[test]
fn a_turn_in_which_an_axis_clips_is_refused_and_the_axis_named() {
    let folder = Folder::new();
    let board = Settings::default();
    let reach = board.scale[0] * board.horizontal_mgauss;
    // Of what X swings through; an arc of 51°, 74° and 127°.
    for share in [0.05, 0.1, 0.28] {
        let end = board.bias_mgauss[0] + reach * (1.0 - 2.0 * share);
        let log = folder.changed_log("a.csv", &board, |reading| {
            if let Some([Some(x), ..]) = &mut reading.field_mgauss {
                *x = x.min(end);
            }
        });
        let ran = calibrate(&log, &[]);
        let outcome = ran.json();
        let stuck = json!("stuck_axis");
        assert_eq!((ran.status, &outcome["reason"]), (3, &stuck), "{share}");
        let message = outcome["message"].as_str().unwrap();
        assert!(
            message.contains("axis X") && message.contains("range"),
            "{message}"
        );
    }
}

#[test]
fn a_chip_with_other_axes_is_named_beside_the_verdict() {
    let folder = Folder::new();
    let right = log(&simulated(&moving(Scenario::Free)));
    let right = String::from_utf8(right).unwrap();
    let ran = calibrate(&folder.file("right.csv", &right), &[]);
    assert!(!ran.err.contains("axes"), "{ran:?}");
    for (chip, reason) in [("mag", "mag_axes"), ("accel", "accel_axes")] {
        let told = format!("# {chip}_axes = +x +y +z");
        let other = format!("# {chip}_axes = +y -x +z");
        let wrong = folder.file("wrong.csv", right.replace(&told, &other));
        let ran = calibrate(&wrong, &[]);
        assert_eq!(ran.status, 3, "{ran:?}");
        let named = format!("({reason})\n");
        assert!(ran.err.contains(&named), "{ran:?}");
    }
}

#[test]
fn nothing_writes_over_the_log_the_configuration_or_the_store() {
    let folder = Folder::new();
    let log = folder.log("a.csv", &Settings::default());
    let kept = folder.file("calibration.json", "kept");
    let store = folder.path("");
    let config = folder.file("a.toml", format!("[store]\ndirectory = \"{store}\"\n"));
    let before = folder.listing();
    for (out, why) in [
        (&log, "it is the log that is read"),
        (&config, "it is the configuration"),
        (&kept, "it holds the daemon's calibrations"),
    ] {
        for command in ["calibrate", "report"] {
            let ran = headingd(&[command, &log, "--config", &config, "--out", out]);
            assert_eq!(ran.status, 73, "{ran:?}");
            assert!(ran.err.contains(why), "{ran:?}");
            assert_eq!(folder.listing(), before);
        }
    }
    let export = ["calibration", "export", "--config", &config, "--out", &kept];
    let ran = headingd(&export);
    assert_eq!((ran.status, folder.listing()), (73, before), "{ran:?}");
}

#[test]
fn a_folder_named_as_standard_output_is_not_in_its_way() {
    let folder = Folder::new();
    fs::create_dir(folder.path("-")).unwrap();
    let mut simulate = program();
    simulate
        .current_dir(&folder.0)
        .args(["simulate", "--out", "-"]);
    let (status, log, err) = finished(&mut simulate);
    assert_eq!(status, 0, "{err}");
    assert!(log.starts_with("# headingd-log"));
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
    let hello = folder.file("hello.csv", "hello\n");
    let cases: Vec<(i32, Vec<&str>, &str)> = vec![
        (65, vec![&hello], "the first line is"),
        (2, vec![&no_gyro], "--mode spatial"),
        (2, vec![&no_gyro, "--mode", "planar"], "--plane xy"),
        (
            2,
            vec![&good, "--plane", "xy", "--mode", "spatial"],
            "leave out --plane",
        ),
        (2, vec![&good, "--plane", "zz"], "zz"),
        (2, vec![&good, "--reference-mgauss", "0"], "milligauss"),
        (2, vec![&good, "--reference-mgauss=-160"], "milligauss"),
        (2, vec![&good, "--reference-mgauss", "NaN"], "milligauss"),
        (2, vec![&good, "--reference-mgauss", "inf"], "milligauss"),
        (66, vec![&missing], "no such file"),
        (66, vec![&directory], "directory"),
        (
            66,
            vec![&good, "--config", &missing],
            "cannot read configuration",
        ),
        (2, vec![&good, "--out", "-"], "both want standard output"),
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
    for (status, args, why) in cases {
        let ran = headingd(&[&["calibrate", "--json"], &args[..]].concat());
        assert_eq!(ran.status, status, "{args:?}: {ran:?}");
        assert!(
            ran.err.contains(why),
            "{args:?} must say {why}: {}",
            ran.err
        );
        // What was found is told also where it cannot be kept.
        assert_eq!(ran.out.is_empty(), status != 73, "{args:?}");
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

    let ran = headingd(&["calibrate", &log, "--out", "-"]);
    let contents = CalibrationFile::from_json(ran.out.as_bytes()).unwrap();
    assert_eq!(contents.sensors.len(), 1);
    assert!(ran.err.starts_with("headingd: accepted"), "{}", ran.err);
}

#[test]
fn no_angle_is_minus_zero() {
    let folder = Folder::new();
    let part = turning(0.6);
    let ran = headingd(&["calibrate", &folder.log("a.csv", &part)]);
    assert!(
        ran.out.contains("turned  0.0  0.0  0.0  degrees"),
        "{}",
        ran.out
    );
}

/// The daemon would not calibrate on it either: the plane of such a turn does not tell a heading.
#[test]
fn a_turn_about_a_level_axis_leaves_the_calibration_to_motion() {
    let lies = |t_s: f64| match t_s - 4.0 {
        before if before < 0.0 => Rotation3::identity(),
        turning if turning < 8.0 => Rotation3::from_euler_angles(0.0, TAU / 8.0 * turning, 0.0),
        after => {
            let t_s = after - 8.0;
            Rotation3::from_euler_angles(
                0.6 * (1.3 * t_s).sin(),
                0.5 * (0.9 * t_s).sin(),
                0.6 * t_s.sin(),
            )
        }
    };
    let entries = carried(72.0, lies, |_, rate| rate).map(|reading| Entry {
        reading,
        heading_truth_deg: None,
    });
    let folder = Folder::new();
    let log = folder.file("a.csv", log(&(Header::default(), entries.collect())));
    let outcome = accepted(&log, &[]);
    assert_eq!(outcome["method"], "motion");
    assert_eq!(outcome["mode"], "spatial");
    // Whoever wants the plane of the turn still gets it.
    assert_eq!(accepted(&log, &["--mode", "planar"])["method"], "turn");
}

/// The circle of a turn may be as wide as the earth's field allows; what the tilts show is not.
#[test]
fn a_field_too_strong_for_the_earth_is_refused_though_its_turn_fits() {
    let folder = Folder::new();
    let demo = Settings {
        scenario: Scenario::Demo,
        ..Settings::default()
    };
    for (times, part) in [(3.0, "mG strong"), (1000.0, "no chip measures that")] {
        let log = folder.changed_log("a.csv", &demo, |reading| {
            if let Some(field) = &mut reading.field_mgauss {
                *field = field.map(|axis| axis.map(|mgauss| times * mgauss));
            }
        });
        let ran = headingd(&["calibrate", &log]);
        assert_eq!(ran.status, 3, "{ran:?}");
        assert!(ran.err.contains(part), "{}", ran.err);
        let played = headingd(&["replay", &log]);
        assert!(played.out.contains("field_unit"), "{}", played.err);
    }
}

/// As where the columns of gyro and magnetometer are exchanged.
#[test]
fn rates_that_no_gyro_has_are_told() {
    let folder = Folder::new();
    let log = folder.changed_log("a.csv", &Settings::default(), |reading| {
        if let Some(rate) = &mut reading.rate_rad_s {
            *rate = rate.add_scalar(500.0);
        }
    });
    let ran = headingd(&["calibrate", &log]);
    assert_eq!(ran.status, 2, "{ran:?}");
    for part in [
        "values of the gyro dropped that no sensor",
        "its columns and units",
    ] {
        assert!(ran.err.contains(part), "{part}: {}", ran.err);
    }
}
