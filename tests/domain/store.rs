//! The calibrations kept, with real files and folders.

use std::fs;
use std::path::Path;
use std::process::Command;
use std::sync::mpsc;
use std::time::Duration;

use headingd::calibration::model::{
    Calibration, Model, PackedCovariance, Parameters, Planar, Spatial,
};
use headingd::calibration::policy::{CalibrationOrigin, Policy};
use headingd::store::history::HistoryError;
use headingd::store::{
    CalibrationFile, CalibrationRecord, FormatError, History, Identity, Store, StoreError,
};
use nalgebra::{Matrix3, SMatrix, Vector2, Vector3};
use serde_json::{Value, json};

use crate::common::headingd;

fn identity() -> Identity {
    Identity {
        sensor: "hmc5843".to_owned(),
        mag_axes: "+y -x +z".parse().unwrap(),
    }
}

fn record(parameters: Parameters) -> CalibrationRecord {
    CalibrationRecord {
        saved_unix_s: Some(1_760_000_000),
        origin: Some(CalibrationOrigin::Turn),
        gyro_rms_deg: Some(1.0 / 7.0),
        samples: Some(560),
        calibration: Calibration::of(parameters, 610.0 / 3.0, 0.1 + 0.2, 0.7),
    }
}

/// With one calibration, active.
fn history(parameters: Parameters) -> History {
    History::of(identity(), record(parameters))
}

/// Writes a calibration file.
fn write(path: &Path, history: History) {
    fs::write(path, CalibrationFile::of(history).to_json().unwrap()).unwrap();
}

/// The only calibration of a file with one sensor.
fn only(contents: &CalibrationFile) -> CalibrationRecord {
    let [history] = contents.sensors.as_slice() else {
        panic!("{contents:?}");
    };
    history.active().unwrap().record
}

fn planar() -> Parameters {
    let (sin, cos) = 0.3_f64.sin_cos();
    Parameters::Planar(Planar {
        basis: [Vector3::new(cos, 0.0, sin), Vector3::y()],
        bias_mgauss: Vector2::new(-87.1, 31.7),
        scale: Vector2::new(1.03, 0.97),
        level: Vector2::new(0.01, -0.02),
    })
}

fn diagonal() -> Parameters {
    let scale = Vector3::new(1.1, 0.9, 1.0 / 3.0);
    Parameters::Spatial(Spatial::diagonal(Vector3::new(1.0, -2.0, 300.1), scale))
}

fn symmetric() -> Parameters {
    Parameters::Spatial(Spatial {
        model: Model::Symmetric,
        bias_mgauss: Vector3::new(-1.7, 0.0, 1e-7),
        matrix: Matrix3::new(1.1, 0.02, 0.03, 0.02, 0.9, 0.07, 0.03, 0.07, 1.0),
    })
}

/// What motion has taught: a general matrix, with its covariance.
fn learnt() -> CalibrationRecord {
    let root = SMatrix::<f64, 12, 12>::from_fn(|row, column| {
        f64::from(u32::from(row == column)) + 0.01 / (1 + row + 2 * column) as f64
    });
    let mut record = record(Parameters::Spatial(Spatial {
        model: Model::General,
        bias_mgauss: Vector3::new(-1.7, 0.0, 1e-7),
        matrix: Matrix3::new(1.1, 0.02, -0.03, 0.01, 0.9, 0.07, 0.05, -0.07, 1.0),
    }));
    record.calibration.covariance = Some(PackedCovariance::packed(&(root * root.transpose())));
    record.calibration.gyro_bias_deg_s = Some(Vector3::new(4.5, -1.0 / 7.0, 0.0));
    record.calibration.accel_bias_m_s2 = Some(Vector3::new(-0.3, 0.0, 0.1));
    record
}

/// A store in a fresh folder, and the folder, which lives as long as its handle.
fn store() -> (tempfile::TempDir, Store) {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(&folder.path().join("a/b")).unwrap();
    (folder, store)
}

/// What the file holds of the sensor of most tests.
fn load(store: &Store) -> Result<Option<History>, StoreError> {
    let contents = Store::contents(store.path().parent().unwrap())?;
    Ok(contents.find(&identity()).cloned())
}

fn files(store: &Store) -> Vec<String> {
    let mut names: Vec<String> = fs::read_dir(store.path().parent().unwrap())
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        // Its lock, as long as it is open.
        .filter(|name| name != ".lock")
        .collect();
    names.sort();
    names
}

fn message(result: Result<impl std::fmt::Debug, StoreError>) -> String {
    result.unwrap_err().to_string()
}

#[test]
fn a_history_comes_back_bit_for_bit() {
    let (_folder, store) = store();
    assert_eq!(load(&store).unwrap(), None);
    let mut known = None;
    let mut history = History::new(identity());
    for parameters in [planar(), diagonal(), symmetric()] {
        history.keep(record(parameters), 10);
        history.policy = Policy::Locked;
        assert_eq!(store.save(&history, known.as_ref()).unwrap(), None);
        assert_eq!(load(&store).unwrap(), Some(history.clone()));
        assert_eq!(files(&store), ["calibration.json"]);
        known = Some(history.clone());
    }
    // More than 1 MiB.
    for _ in 0..400 {
        history.keep(learnt(), 403);
    }
    store.save(&history, known.as_ref()).unwrap();
    assert_eq!(load(&store).unwrap(), Some(history.clone()));
}

#[test]
fn a_covariance_or_a_bias_of_a_chip_that_cannot_be_one_is_damage() {
    let good = CalibrationFile::of(History::of(identity(), learnt()));
    let text = good.to_json().unwrap();
    assert_eq!(CalibrationFile::from_json(text.as_bytes()), Ok(good));
    let mut value: Value = serde_json::from_str(&text).unwrap();
    let calibration = &mut value["sensors"][0]["history"][0]["calibration"];
    let (covariance, bias) = ("covariance", "gyro_bias_deg_s");
    for (key, at, wrong, part) in [
        (covariance, 0, json!(-1.0), "no variance below 0"),
        (covariance, 1, json!(50.0), "no correlation beyond 1"),
        (covariance, 2, json!("x"), "covariance[2]"),
        (bias, 1, json!(61.0), "calibration.gyro_bias_deg_s"),
        (bias, 2, json!(null), "gyro_bias_deg_s[2]"),
        (
            "accel_bias_m_s2",
            0,
            json!(-5.5),
            "calibration.accel_bias_m_s2",
        ),
    ] {
        let right = std::mem::replace(&mut calibration[key][at], wrong);
        let mut damaged = json!({"headingd_store": 2, "sensors": []});
        damaged["sensors"] = json!([{
            "sensor": "hmc5843", "mag_axes": "+y -x +z", "in_force": 1, "last_number": 1,
            "history": [{"number": 1, "calibration": calibration.clone()}]
        }]);
        let error = CalibrationFile::from_value(damaged).unwrap_err();
        let error = error.to_string();
        assert!(error.contains(part), "{error}");
        calibration[key][at] = right;
    }
    // A matrix that mirrors an axis is no chip's.
    calibration["matrix"][0] = json!(-1.1);
    let error = CalibrationFile::from_value(value).unwrap_err().to_string();
    assert!(error.contains("calibration.matrix"), "{error}");
}

#[test]
fn old_files_load() {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data");
    let found = Store::read_file(&data.join("store-1.json")).unwrap();
    assert_eq!(found.sensors[0].identity, identity());
    assert_eq!(found.sensors[0].policy, Policy::On);
    let record = only(&found);
    assert_eq!(record.saved_unix_s, Some(1_760_000_000));
    assert_eq!((record.origin, record.samples), (None, None));
    let Parameters::Planar(planar) = record.calibration.parameters else {
        panic!("{found:?}");
    };
    assert_eq!(planar.bias_mgauss, Vector2::new(-87.5, 31.25));

    let found = Store::read_file(&data.join("store-1-spatial.json")).unwrap();
    let calibration = only(&found).calibration;
    assert_eq!(calibration.reference_mgauss, Some(502.0));
    let Parameters::Spatial(spatial) = calibration.parameters else {
        panic!("{found:?}");
    };
    assert_eq!(spatial.model, Model::Symmetric);
    assert_eq!(spatial.matrix[(0, 1)], 0.0625);

    let found = Store::read_file(&data.join("store-2.json")).unwrap();
    let [stick, razor] = found.sensors.as_slice() else {
        panic!("{found:?}");
    };
    assert_eq!(stick.identity, identity());
    assert_eq!((stick.policy, stick.active), (Policy::Locked, Some(3)));
    let numbers: Vec<u64> = stick.entries.iter().map(|entry| entry.number).collect();
    assert_eq!((numbers, stick.last_number), (vec![1, 3, 4], 4));
    let [first, third, _] = stick.entries.as_slice() else {
        panic!("{stick:?}");
    };
    // It is from version 1, of a board whose clock was not set.
    let (first, third) = (first.record, third.record);
    assert_eq!((first.saved_unix_s, first.origin), (None, None));
    assert_eq!(third.origin, Some(CalibrationOrigin::Start));
    assert_eq!((third.gyro_rms_deg, third.samples), (Some(0.75), Some(560)));
    assert_eq!((razor.policy, razor.active()), (Policy::Off, None));

    let found = Store::read_file(&data.join("store-3.json")).unwrap();
    let [stick] = found.sensors.as_slice() else {
        panic!("{found:?}");
    };
    let mounting = stick.mounting.as_deref().unwrap();
    let (told, configured) = (mounting.board_axes, mounting.configured);
    assert_eq!(
        (told.to_string(), configured.to_string()),
        ("+y -x +z".to_owned(), "+x +y +z".to_owned())
    );
    let kept = only(&found);
    assert_eq!(kept.origin, Some(CalibrationOrigin::Turn));
    let learnt = kept.calibration;
    assert_eq!(learnt.gyro_bias_deg_s, Some(Vector3::new(0.5, -1.25, 0.0)));
    let covariance = learnt.covariance.unwrap().unpacked();
    assert_eq!(covariance[(0, 0)], 4.0);
    assert_eq!(
        (covariance[(0, 3)], covariance[(3, 0)]),
        (-0.0078125, -0.0078125)
    );
    assert_eq!(covariance[(2, 11)], 0.00390625);
    let Parameters::Spatial(spatial) = learnt.parameters else {
        panic!("{found:?}");
    };
    assert_eq!(spatial.model, Model::General);
    // Column by column in the file.
    let rows = [
        0.96875, 0.03125, 0.015625, -0.0625, 1.0, 0.0625, 0.03125, -0.03125, 1.03125,
    ];
    assert_eq!(spatial.matrix, Matrix3::from_row_slice(&rows));
}

/// A store of version 1 that a new calibration was saved to.
#[test]
fn a_calibration_of_version_1_becomes_the_first_of_a_history() {
    let (_folder, store) = store();
    let old = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/store-1.json");
    fs::copy(old, store.path()).unwrap();
    let known = load(&store).unwrap().unwrap();
    let mut history = known.clone();
    history.keep(record(planar()), 10);
    assert_eq!(store.save(&history, Some(&known)).unwrap(), None);
    let kept = fs::read_to_string(store.path()).unwrap();
    assert!(kept.starts_with("{\n  \"headingd_store\": 2,"), "{kept}");
    assert_eq!(load(&store).unwrap(), Some(history));
    assert_eq!(files(&store), ["calibration.json"]);
}

#[test]
fn the_calibration_that_somebody_went_back_to_outlives_the_next_one() {
    let mut history = History::new(identity());
    for _ in 0..3 {
        history.keep(record(planar()), 3);
    }
    history.roll_back(Some(1)).unwrap();
    history.keep(record(planar()), 3);
    let kept = |history: &History| -> Vec<u64> {
        history.entries.iter().map(|entry| entry.number).collect()
    };
    assert_eq!((kept(&history), history.active), (vec![1, 3, 4], Some(4)));
    history.keep(record(planar()), 1);
    assert_eq!((kept(&history), history.active), (vec![5], Some(5)));
}

#[test]
fn the_oldest_goes_by_number_whatever_the_clock_said() {
    let mut history = History::new(identity());
    for clock in [Some(900), Some(5_000), None, Some(100), Some(200)] {
        let record = CalibrationRecord {
            saved_unix_s: clock,
            ..record(planar())
        };
        history.keep(record, 3);
    }
    let kept: Vec<(u64, Option<u64>)> = history
        .entries
        .iter()
        .map(|entry| (entry.number, entry.record.saved_unix_s))
        .collect();
    assert_eq!(kept, [(3, None), (4, Some(100)), (5, Some(200))]);
    assert_eq!(history.roll_back(None).unwrap().number, 4);
    assert_eq!(history.roll_back(None).unwrap().number, 3);
    assert_eq!(history.roll_back(None), Err(HistoryError::NothingBefore));
    assert_eq!(
        history.roll_back(Some(1)),
        Err(HistoryError::NoSuchNumber(1))
    );
    assert_eq!(history.active, Some(3));
    // What is saved next is the newest, and no number is given twice.
    assert_eq!(history.forget(Some(5), false), Ok(1));
    history.keep(record(planar()), 3);
    assert_eq!((history.active, history.entries.len()), (Some(6), 3));
    assert_eq!(history.forget(None, false), Ok(1));
    assert_eq!(history.active(), None);
    let refusal = history.forget(None, false).unwrap_err();
    assert_eq!(refusal, HistoryError::NoneActive(Policy::On, true));
    let right = "turn the board once, or headingd calibration rollback";
    assert!(refusal.to_string().ends_with(right), "{refusal}");
    history.set_policy(Policy::Off).unwrap();
    let refusal = history.find(None).unwrap_err().to_string();
    assert!(refusal.contains("headingd calibration start"), "{refusal}");
    assert_eq!(history.roll_back(None).unwrap().number, 4);
    assert_eq!(history.forget(None, true), Ok(2));
    assert_eq!((history.active, history.last_number), (None, 6));
}

#[test]
fn a_locked_calibration_neither_goes_nor_is_rolled_back() {
    let mut history = History::new(identity());
    let refusal = HistoryError::NoneActive(Policy::On, false);
    assert_eq!(history.set_policy(Policy::Locked), Err(refusal));
    history.keep(record(planar()), 10);
    history.keep(record(diagonal()), 10);
    history.set_policy(Policy::Locked).unwrap();
    let locked = history.clone();
    for refused in [
        history.roll_back(None).map(|_| ()),
        history.forget(None, false).map(|_| ()),
        history.forget(Some(2), false).map(|_| ()),
        history.forget(None, true).map(|_| ()),
    ] {
        assert_eq!(refused, Err(HistoryError::Locked));
    }
    assert_eq!(history, locked);
    assert_eq!(history.forget(Some(1), false), Ok(1));
    history.set_policy(Policy::On).unwrap();
    assert_eq!(history.forget(None, true), Ok(1));
}

#[test]
fn a_file_cut_anywhere_is_refused_and_left_alone() {
    let (_folder, store) = store();
    for parameters in [planar(), symmetric()] {
        let path = store.path();
        write(&path, history(parameters));
        let whole = fs::read(&path).unwrap();
        // The last byte ends the line: without it nothing is missing.
        for length in 0..whole.len() - 1 {
            fs::write(&path, &whole[..length]).unwrap();
            let error = load(&store).unwrap_err();
            assert!(
                matches!(error, StoreError::Format(_, FormatError::Unreadable(_))),
                "{error}"
            );
            assert_eq!(fs::read(&path).unwrap(), whole[..length]);
        }
    }
}

#[test]
fn a_file_that_is_not_understood_is_set_aside_before_the_next_save() {
    let (_folder, store) = store();
    let good = history(planar());
    for (text, name) in [
        ("{\"headingd_store\": 2,", "unreadable-1"),
        ("{\"headingd_store\": 2}", "unreadable-2"),
        ("", "unreadable-3"),
        ("{\"headingd_store\": 4, \"future\": []}", "newer-1"),
    ] {
        fs::write(store.path(), text).unwrap();
        let error = load(&store).unwrap_err();
        let newer = matches!(error, StoreError::Format(_, FormatError::Newer(4)));
        assert_eq!(newer, name.starts_with("newer"), "{error}");
        let aside = store.save(&good, None).unwrap().unwrap();
        let name = format!("calibration.json.{name}");
        assert_eq!(aside.file_name().unwrap().to_str(), Some(name.as_str()));
        assert_eq!(fs::read_to_string(aside).unwrap(), text);
        assert_eq!(load(&store).unwrap(), Some(good.clone()));
    }
    assert_eq!(files(&store).len(), 5);
}

/// Numbers count on from `last_number`, so one without room behind it would let no calibration be saved any more.
#[test]
fn a_last_number_without_room_behind_it_does_not_end_saving() {
    let (_folder, store) = store();
    let mut kept = history(planar());
    store.save(&kept, None).unwrap();
    let good = fs::read_to_string(store.path()).unwrap();
    for last in [u64::MAX, u64::MAX - 1, 1_000_000_000_001] {
        let text = good.replacen("\"last_number\": 1", &format!("\"last_number\": {last}"), 1);
        fs::write(store.path(), &text).unwrap();
        let error = load(&store).unwrap_err();
        assert!(
            matches!(error, StoreError::Format(_, FormatError::Unreadable(_))),
            "{error}"
        );
        kept.keep(record(planar()), 10);
        let aside = store.save(&kept, None).unwrap().unwrap();
        assert_eq!(fs::read_to_string(aside).unwrap(), text);
    }
    // A large one leaves room.
    let text = good.replacen("\"last_number\": 1", "\"last_number\": 999999999000", 1);
    fs::write(store.path(), text).unwrap();
    let mut found = load(&store).unwrap().unwrap();
    let known = found.clone();
    found.keep(record(planar()), 10);
    assert_eq!(store.save(&found, Some(&known)).unwrap(), None);
    assert_eq!(load(&store).unwrap(), Some(found));
}

#[test]
fn another_sensors_calibrations_are_not_used_and_stay() {
    let (_folder, store) = store();
    let path = store.path();
    let directory = path.parent().unwrap();
    let first = history(planar());
    store.save(&first, None).unwrap();
    let others = [
        Identity {
            sensor: "hmc5883l".to_owned(),
            ..identity()
        },
        Identity {
            mag_axes: "+x +y +z".parse().unwrap(),
            ..identity()
        },
    ];
    let mut there = vec![identity()];
    for other in others {
        let kept = Store::contents(directory).unwrap().sensors;
        assert!(kept.iter().map(|kept| &kept.identity).eq(&there));
        there.push(other.clone());
        let second = History::of(other.clone(), record(diagonal()));
        assert_eq!(store.save(&second, None).unwrap(), None);
        let kept = Store::contents(directory).unwrap();
        assert_eq!(kept.find(&other), Some(&second));
        assert_eq!(load(&store).unwrap(), Some(first.clone()));
    }
    assert_eq!(files(&store), ["calibration.json"]);
}

#[test]
fn what_somebody_else_has_changed_meanwhile_is_set_aside() {
    let (_folder, store) = store();
    let known = history(planar());
    store.save(&known, None).unwrap_or_default();
    // A backup is put back while the daemon runs.
    let backup = history(diagonal());
    write(&store.path(), backup.clone());
    let mut next = known.clone();
    next.keep(record(symmetric()), 10);
    let aside = store.save(&next, Some(&known)).unwrap().unwrap();
    assert!(aside.ends_with("calibration.json.changed-1"));
    let found = Store::read_file(&aside).unwrap();
    assert_eq!(found, CalibrationFile::of(backup));
    // A save of which nobody knows that it succeeded is repeated.
    assert_eq!(store.save(&next, Some(&known)).unwrap(), None);
    assert_eq!(load(&store).unwrap(), Some(next));
}

#[test]
fn values_that_no_calibration_has_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.json");
    #[rustfmt::skip]
    let cases = [
        (planar(), "1.03", "-1.03", "calibration.scale[0] is -1.03, but must be from 0.01 to 100"),
        (planar(), "1.03", "0", "calibration.scale[0] is 0"),
        (planar(), "31.7", "null", "calibration.bias_mgauss[1] is null"),
        (planar(), "31.7", "1e300", "calibration.bias_mgauss[1] is 1"),
        (planar(), "31.7", "1e999", "out of range"),
        (planar(), "0.7", "\"a\"", "calibration.heading_sd_deg is \"a\""),
        (planar(), "\"scale\"", "\"scael\"", "missing field `scale`"),
        (planar(), "              1.0,", "              1.01,", "calibration.basis is"),
        (planar(), "\"planar\"", "\"plane\"", "unknown variant `plane`"),
        (planar(), "+y -x +z", "+y -x", "mounting \"+y -x\""),
        (planar(), "\"headingd_store\": 2", "\"headingd_store\": 0", "no version number"),
        (planar(), "\"in_force\": 1", "\"in_force\": 2", "history has no such number"),
        (planar(), "\"last_number\": 1", "\"last_number\": 0", "history has a number 1"),
        (planar(), "\"number\": 1", "\"number\": 0", "numbers must rise from 1"),
        (planar(), "\"last_number\": 1", "\"last_number\": 18446744073709551615",
            "last_number is 18446744073709551615, but must be at most"),
        (planar(), "-0.02", "1e308", "calibration.level is [0.01, 1"),
        (planar(), "-0.02", "null", "calibration.level[1] is null"),
        (planar(), "\"on\"", "\"of\"", "unknown variant `of`"),
        (planar(), "headingd_store", "pump_store", "headingd_store is missing"),
        (symmetric(), "1.1", "-1.1", "calibration.matrix is"),
        (symmetric(), "0.02,\n              0.9", "0.03,\n              0.9", "must be symmetric"),
        (symmetric(), "\"symmetric\"", "\"diagonal\"", "must be diagonal"),
        (diagonal(), "1.1", "0", "calibration.matrix is [0.0, 0.0, 0.0, 0.0, 0.9"),
        (diagonal(), "1.1", "1e-5", "eigenvalues from 0.01 to 100"),
    ];
    for (parameters, from, to, right) in cases {
        write(&file, history(parameters));
        let text = fs::read_to_string(&file).unwrap();
        assert!(text.contains(from), "{from} is not in {text}");
        fs::write(&file, text.replacen(from, to, 1)).unwrap();
        let message = message(Store::read_file(&file));
        assert!(
            message.contains(right) && message.contains("a.json"),
            "{message}"
        );
    }
}

#[test]
fn what_could_not_be_read_again_is_not_saved() {
    let (_folder, store) = store();
    let good = history(planar());
    store.save(&good, None).unwrap();
    let mut bad = good.clone();
    bad.entries[0].record.calibration.heading_sd_deg = f64::NAN;
    assert!(message(store.save(&bad, Some(&good))).contains("heading_sd_deg is NaN"));
    let mut bad = good.clone();
    let Parameters::Planar(planar) = &mut bad.entries[0].record.calibration.parameters else {
        panic!("{bad:?}");
    };
    planar.basis[0].x = f64::NAN;
    assert!(message(store.save(&bad, Some(&good))).contains("calibration.basis is [[NaN"));
    assert_eq!(load(&store).unwrap(), Some(good));
}

#[test]
fn a_folder_that_cannot_be_used_is_refused_by_its_own_name() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("file");
    fs::write(&file, "").unwrap();
    // Nobody may make files in the last two, not even root.
    for directory in [
        file.clone(),
        file.join("below"),
        "/proc/self".into(),
        "/proc/none".into(),
    ] {
        let message = message(Store::open(&directory));
        let rest = message.replace(directory.to_str().unwrap(), "");
        assert!(rest != message && !rest.contains(".tmp"), "{message}");
    }
}

#[test]
fn a_killed_save_leaves_nothing_behind() {
    let (_folder, store) = store();
    let good = history(planar());
    store.save(&good, None).unwrap();
    let directory = store.path().parent().unwrap().to_owned();
    fs::write(directory.join(".calibration.json.x1y2.tmp"), "{\"head").unwrap();
    fs::write(directory.join("notes.tmp"), "mine").unwrap();
    assert_eq!(load(&store).unwrap(), Some(good.clone()));
    let store = Store::open(&directory).unwrap();
    assert_eq!(files(&store), ["calibration.json", "notes.tmp"]);
    assert_eq!(load(&store).unwrap(), Some(good));
}

#[test]
fn a_link_stays_a_link_and_a_device_a_device() {
    use std::os::unix::fs::{FileTypeExt, symlink};
    let folder = tempfile::tempdir().unwrap();
    let (file, link) = (folder.path().join("file"), folder.path().join("link"));
    symlink("file", &link).unwrap();
    // At first there is nothing where it points.
    for _ in 0..2 {
        let ran = headingd(&["simulate", "--out", link.to_str().unwrap()]);
        assert_eq!(ran.status, 0, "{ran:?}");
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        assert!(file.is_file());
    }

    // Every write to /dev/full fails as on a full disk.
    let ran = headingd(&["simulate", "--out", "/dev/full"]);
    assert_eq!(ran.status, 73, "{ran:?}");
    assert!(ran.err.contains("cannot write /dev/full: "), "{ran:?}");
    let full = fs::metadata("/dev/full").unwrap();
    assert!(full.file_type().is_char_device());
}

#[test]
fn an_endless_file_is_not_read_to_its_end() {
    assert!(message(Store::read_file(Path::new("/dev/zero"))).contains("longer than"));
}

/// Whoever opened it would wait for somebody to write.
#[test]
fn a_pipe_in_place_of_the_file_is_not_waited_for() {
    let (_folder, store) = store();
    let made = Command::new("mkfifo").arg(store.path()).status();
    assert!(made.unwrap().success());
    let (sender, loaded) = mpsc::channel();
    let good = history(planar());
    let right = good.clone();
    std::thread::spawn(move || {
        let refused = message(load(&store));
        let aside = store.save(&good, None).unwrap();
        sender.send((refused, aside, store))
    });
    let (refused, aside, store) = loaded
        .recv_timeout(Duration::from_secs(30))
        .expect("it hangs");
    assert!(refused.contains("it is no regular file"), "{refused}");
    assert!(aside.unwrap().ends_with("calibration.json.unreadable-1"));
    assert_eq!(load(&store).unwrap(), Some(right));
}

/// Neither a link nor a copy of it can be made, as of a file of root's that the daemon may not read.
#[test]
fn what_can_only_be_renamed_is_set_aside_too() {
    let (_folder, store) = store();
    fs::create_dir(store.path()).unwrap();
    let good = history(planar());
    let aside = store.save(&good, None).unwrap().unwrap();
    assert!(aside.ends_with("calibration.json.unreadable-1"));
    assert!(aside.is_dir());
    assert_eq!(load(&store).unwrap(), Some(good));
}
