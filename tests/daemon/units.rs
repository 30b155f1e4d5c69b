//! The systemd units, by systemd's own judgement.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::rig::not_run;

/// At most this exposure, of 0.0 (tightest) to 10.0.
const MOST_EXPOSED: f64 = 1.0;

/// A copy of the units, of which this is true where they are checked: the program is there.
fn units() -> (tempfile::TempDir, Vec<PathBuf>) {
    let folder = tempfile::tempdir().unwrap();
    let from = Path::new(env!("CARGO_MANIFEST_DIR")).join("systemd");
    let copied = ["headingd.service", "headingd.socket"].map(|name| {
        let text = fs::read_to_string(from.join(name)).unwrap();
        let here = text.replace("/usr/bin/headingd", env!("CARGO_BIN_EXE_headingd"));
        let path = folder.path().join(name);
        fs::write(&path, here).unwrap();
        path
    });
    (folder, copied.to_vec())
}

/// What `systemd-analyze` says; `None` where there is none.
fn analyze(arguments: &[&str], units: &[PathBuf]) -> Option<(bool, String)> {
    let mut command = Command::new("systemd-analyze");
    let Ok(output) = command.args(arguments).args(units).output() else {
        not_run("there is no systemd-analyze");
        return None;
    };
    let said = [output.stdout, output.stderr].concat();
    Some((
        output.status.success(),
        String::from_utf8_lossy(&said).into_owned(),
    ))
}

#[test]
fn systemd_has_nothing_to_say_against_them() {
    let (folder, units) = units();
    let verify = || {
        if let Some((good, said)) = analyze(&["verify", "--man=no"], &units) {
            assert_eq!((good, said.as_str()), (true, ""));
        }
    };
    verify();
    // And with the drop-in that opens the network.
    let drop_in = folder.path().join("headingd.service.d/network.conf");
    fs::create_dir(drop_in.parent().unwrap()).unwrap();
    let example = Path::new(env!("CARGO_MANIFEST_DIR")).join("systemd/network.conf");
    fs::copy(example, drop_in).unwrap();
    verify();
}

#[test]
fn the_service_is_closed_to_all_that_it_does_not_need() {
    let (_folder, units) = units();
    let threshold = format!("--threshold={}", MOST_EXPOSED * 10.0);
    let arguments = ["security", "--offline=true", "--no-pager", &threshold];
    if let Some((good, said)) = analyze(&arguments, &units[..1]) {
        let level = said
            .lines()
            .find(|line| line.contains("Overall exposure level"));
        let level = level.unwrap_or_else(|| panic!("{said}"));
        let found: f64 = level
            .split_whitespace()
            .find_map(|word| word.parse().ok())
            .unwrap();
        assert!(good && found <= MOST_EXPOSED, "{said}");
    }
}
