//! The calibration file, with real files and folders.

use std::fs;
use std::path::{Path, PathBuf};

use headingd::calibration::model::{Calibration, Model, Parameters, Planar, Spatial};
use headingd::store::{Identity, Loaded, Store, StoreError, Stored};
use nalgebra::{Matrix3, Vector2, Vector3};
use rand::{RngExt, SeedableRng};

fn identity() -> Identity {
    Identity {
        sensor: "hmc5843".to_owned(),
        mag_axes: "+y -x +z".parse().unwrap(),
    }
}

fn stored(parameters: Parameters) -> Stored {
    Stored {
        identity: identity(),
        saved_unix_s: 1_760_000_000,
        calibration: Calibration {
            parameters,
            reference_mgauss: None,
            strength_mgauss: 610.0 / 3.0,
            residual_mgauss: 0.1 + 0.2,
            heading_sd_deg: 0.7,
        },
    }
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
    Parameters::Spatial(Spatial::diagonal(Vector3::new(1.0, -2.0, 300.1), scale).unwrap())
}

fn symmetric() -> Parameters {
    let matrix = Matrix3::new(1.1, 0.02, 0.03, 0.02, 0.9, 0.07, 0.03, 0.07, 1.0);
    let bias = Vector3::new(-1.7, 0.0, 1e-7);
    Parameters::Spatial(Spatial::new(Model::Symmetric, bias, matrix).unwrap())
}

/// A store in a fresh folder, and the folder, which lives as long as its handle.
fn store() -> (tempfile::TempDir, Store) {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(&folder.path().join("a/b")).unwrap();
    (folder, store)
}

fn files(store: &Store) -> Vec<String> {
    let mut names: Vec<String> = fs::read_dir(store.path().parent().unwrap())
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    names
}

fn message(result: Result<impl std::fmt::Debug, StoreError>) -> String {
    result.unwrap_err().to_string()
}

#[test]
fn a_calibration_comes_back_bit_for_bit() {
    let (_folder, store) = store();
    assert_eq!(store.load(&identity()).unwrap(), Loaded::None);
    for parameters in [planar(), diagonal(), symmetric()] {
        let stored = stored(parameters);
        assert_eq!(store.save(&stored).unwrap(), None);
        assert_eq!(store.load(&identity()).unwrap(), Loaded::Found(stored));
        assert_eq!(files(&store), ["calibration.json"]);
    }
}

#[test]
fn no_number_is_rounded_on_its_way() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("out.json");
    let mut random = rand_xoshiro::Xoshiro256PlusPlus::seed_from_u64(1);
    for _ in 0..200 {
        let mut stored = stored(planar());
        if let Parameters::Planar(planar) = &mut stored.calibration.parameters {
            planar.bias_mgauss = Vector2::from_fn(|_, _| random.random_range(-500.0..500.0));
            planar.scale = Vector2::from_fn(|_, _| random.random_range(0.5..2.0));
        }
        stored.calibration.reference_mgauss = Some(random.random_range(100.0..700.0));
        Store::write_file(&file, &stored).unwrap();
        assert_eq!(Store::read_file(&file).unwrap(), stored);
    }
}

#[test]
fn old_files_load() {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data");
    let found = Store::read_file(&data.join("store-1.json")).unwrap();
    assert_eq!(found.identity, identity());
    assert_eq!(found.saved_unix_s, 1_760_000_000);
    let Parameters::Planar(planar) = found.calibration.parameters else {
        panic!("{found:?}");
    };
    assert_eq!(planar.bias_mgauss, Vector2::new(-87.5, 31.25));

    let found = Store::read_file(&data.join("store-1-spatial.json")).unwrap();
    assert_eq!(found.calibration.reference_mgauss, Some(502.0));
    let Parameters::Spatial(spatial) = found.calibration.parameters else {
        panic!("{found:?}");
    };
    assert_eq!(spatial.model(), Model::Symmetric);
    assert_eq!(spatial.matrix()[(0, 1)], 0.0625);
}

#[test]
fn a_file_cut_anywhere_is_refused_and_left_alone() {
    let (_folder, store) = store();
    for parameters in [planar(), symmetric()] {
        let stored = stored(parameters);
        let path = store.path();
        Store::write_file(&path, &stored).unwrap();
        let whole = fs::read(&path).unwrap();
        // The last byte ends the line: without it nothing is missing.
        for length in 0..whole.len() - 1 {
            fs::write(&path, &whole[..length]).unwrap();
            let error = store.load(&identity()).unwrap_err();
            assert!(matches!(error, StoreError::Unreadable { .. }), "{error}");
            assert_eq!(fs::read(&path).unwrap(), whole[..length]);
        }
    }
}

#[test]
fn a_file_that_is_not_understood_is_set_aside_before_the_next_save() {
    let (_folder, store) = store();
    let good = stored(planar());
    for (number, text) in ["{\"headingd_store\": 1,", "{\"headingd_store\": 2}", ""]
        .iter()
        .enumerate()
    {
        fs::write(store.path(), text).unwrap();
        store.load(&identity()).unwrap_err();
        let aside = store.save(&good).unwrap().unwrap();
        let name = format!("calibration.json.unreadable-{}", number + 1);
        assert_eq!(aside.file_name().unwrap().to_str(), Some(name.as_str()));
        assert_eq!(fs::read_to_string(aside).unwrap(), *text);
        assert_eq!(
            store.load(&identity()).unwrap(),
            Loaded::Found(good.clone())
        );
    }
    assert_eq!(files(&store).len(), 4);
}

#[test]
fn a_newer_file_is_told_from_a_damaged_one() {
    let (_folder, store) = store();
    fs::write(store.path(), "{\"headingd_store\": 2, \"history\": []}").unwrap();
    let error = store.load(&identity()).unwrap_err();
    assert!(
        matches!(error, StoreError::Newer { version: 2, .. }),
        "{error}"
    );
}

#[test]
fn another_sensors_calibration_is_not_used_and_not_lost() {
    let (_folder, store) = store();
    let first = stored(planar());
    store.save(&first).unwrap();
    for other in [
        Identity {
            sensor: "hmc5883l".to_owned(),
            ..identity()
        },
        Identity {
            mag_axes: "+x +y +z".parse().unwrap(),
            ..identity()
        },
    ] {
        assert_eq!(
            store.load(&other).unwrap(),
            Loaded::OtherSensor(first.clone())
        );
    }
    let second = Stored {
        identity: Identity {
            sensor: "hmc5883l".to_owned(),
            ..identity()
        },
        ..stored(diagonal())
    };
    let aside = store.save(&second).unwrap().unwrap();
    assert!(aside.ends_with("calibration.json.other-1"));
    assert_eq!(Store::read_file(&aside).unwrap(), first);
}

#[test]
fn values_that_no_calibration_has_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.json");
    for (parameters, from, to, right) in [
        (planar(), "1.03", "-1.03", "calibration.scale[0] is -1.03"),
        (planar(), "1.03", "0", "calibration.scale[0] is 0"),
        (
            planar(),
            "31.7",
            "null",
            "calibration.bias_mgauss[1] is null",
        ),
        (planar(), "31.7", "1e300", "calibration.bias_mgauss[1] is 1"),
        (planar(), "31.7", "1e999", "out of range"),
        (
            planar(),
            "0.7",
            "\"a\"",
            "calibration.heading_sd_deg is \"a\"",
        ),
        (planar(), "\"scale\"", "\"scael\"", "missing field `scale`"),
        (
            planar(),
            "      1.0,",
            "      1.01,",
            "calibration.basis is",
        ),
        (
            planar(),
            "\"planar\"",
            "\"plane\"",
            "unknown variant `plane`",
        ),
        (planar(), "+y -x +z", "+y -x", "mounting \"+y -x\""),
        (
            planar(),
            "\"headingd_store\": 1",
            "\"headingd_store\": 0",
            "no version number",
        ),
        (
            planar(),
            "headingd_store",
            "pump_store",
            "headingd_store is missing",
        ),
        (symmetric(), "1.1", "-1.1", "calibration.matrix is"),
        (
            symmetric(),
            "0.02,\n      0.9",
            "0.03,\n      0.9",
            "must be symmetric",
        ),
        (
            symmetric(),
            "\"symmetric\"",
            "\"diagonal\"",
            "must be diagonal",
        ),
        (diagonal(), "1.1", "0", "cannot be inverted"),
        (diagonal(), "1.1", "1e-5", "eigenvalues from 0.01 to 100"),
    ] {
        Store::write_file(&file, &stored(parameters)).unwrap();
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
    let good = stored(planar());
    store.save(&good).unwrap();
    let mut bad = good.clone();
    bad.calibration.heading_sd_deg = f64::NAN;
    assert!(message(store.save(&bad)).contains("heading_sd_deg is NaN"));
    assert_eq!(store.load(&identity()).unwrap(), Loaded::Found(good));
}

#[test]
fn a_folder_that_cannot_be_used_is_refused_with_a_remedy() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("file");
    fs::write(&file, "").unwrap();
    for directory in [file.clone(), file.join("below")] {
        let message = message(Store::open(&directory));
        assert!(message.contains("store.directory"), "{message}");
        assert!(message.contains(directory.to_str().unwrap()), "{message}");
    }
}

#[test]
fn a_folder_that_may_not_be_written_is_refused_at_the_start() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    fs::set_permissions(folder.path(), fs::Permissions::from_mode(0o555)).unwrap();
    // The superuser may write anywhere.
    if fs::write(folder.path().join("probe"), "").is_ok() {
        return;
    }
    assert!(message(Store::open(folder.path())).contains("StateDirectory="));
}

#[test]
fn a_killed_save_leaves_nothing_behind() {
    let (_folder, store) = store();
    let good = stored(planar());
    store.save(&good).unwrap();
    let directory = store.path().parent().unwrap().to_owned();
    fs::write(directory.join(".calibration.json.x1y2.tmp"), "{\"head").unwrap();
    fs::write(directory.join("notes.tmp"), "mine").unwrap();
    assert_eq!(
        store.load(&identity()).unwrap(),
        Loaded::Found(good.clone())
    );
    let store = Store::open(&directory).unwrap();
    assert_eq!(files(&store), ["calibration.json", "notes.tmp"]);
    assert_eq!(store.load(&identity()).unwrap(), Loaded::Found(good));
}

#[test]
fn a_link_stays_a_link_and_a_device_a_device() {
    use std::os::unix::fs::{FileTypeExt, symlink};
    let folder = tempfile::tempdir().unwrap();
    let (file, link) = (folder.path().join("file"), folder.path().join("link"));
    fs::write(&file, "old").unwrap();
    symlink(&file, &link).unwrap();
    Store::write_file(&link, &stored(planar())).unwrap();
    assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
    Store::read_file(&file).unwrap();

    // Every write to /dev/full fails as on a full disk.
    let full = PathBuf::from("/dev/full");
    let error = Store::write_file(&full, &stored(planar())).unwrap_err();
    assert!(matches!(error, StoreError::Write { .. }), "{error}");
    assert!(fs::metadata(&full).unwrap().file_type().is_char_device());
}

#[test]
fn an_endless_file_is_not_read_to_its_end() {
    assert!(message(Store::read_file(Path::new("/dev/zero"))).contains("longer than"));
}
