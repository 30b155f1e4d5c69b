//! `headingd demo`.

use std::fs::{self, File};
use std::os::fd::OwnedFd;

use crate::rig::{entries, folder, program, spawn_on, start, until};

#[test]
fn it_shows_a_calibration_and_leaves_nothing_behind() {
    let folder = folder();
    // With this seed a second calibration takes the place of the first, just before the board tilts.
    let arguments = ["demo", "--speed", "50", "--seed", "9"];
    let mut process = start(folder.path(), &arguments);
    let status = process.wait();
    let shown = fs::read_to_string(folder.path().join("stdout")).unwrap();
    assert!(status.success(), "{shown}\n{}", process.said());
    assert_eq!(process.said(), "");
    for part in ["full turn", "RIST ", "swarm ", "accepted: ", "the end."] {
        assert!(shown.contains(part), "{part} is missing:\n{shown}");
    }
    assert!(!shown.contains('\x1b'), "{shown}");
    assert_eq!(entries(&folder.path().join("tmp")), 0);
}

#[test]
fn it_ends_when_interrupted() {
    for (signal, right) in [("INT", 130), ("TERM", 143), ("HUP", 129)] {
        let folder = folder();
        let mut process = start(folder.path(), &["demo"]);
        until("the demo's first lines", || {
            let shown = fs::read_to_string(folder.path().join("stdout")).unwrap();
            shown.contains("at rest")
        });
        assert_eq!(entries(&folder.path().join("tmp")), 1);
        process.signal(signal);
        process.ends(right);
        assert_eq!(entries(&folder.path().join("tmp")), 0);
    }
}

#[test]
fn it_ends_when_nobody_reads_on() {
    let (_, gone) = std::io::pipe().unwrap();
    let full = File::options().write(true).open("/dev/full").unwrap();
    for (stdout, status) in [(OwnedFd::from(gone).into(), 0), (full, 74)] {
        let folder = folder();
        let mut process = spawn_on(folder.path(), program().arg("demo"), stdout, None);
        process.ends(status);
        assert_eq!(entries(&folder.path().join("tmp")), 0);
    }
}

#[test]
fn its_socket_can_be_put_elsewhere() {
    let folder = folder();
    let socket = folder.path().join("here.sock");
    let mut process = start(
        folder.path(),
        &["demo", "--socket", socket.to_str().unwrap()],
    );
    until("the socket", || socket.exists());
    process.signal("INT");
    process.ends(130);
    assert!(!socket.exists());
}
