//! `headingd status` and `headingd calibration`: what they print, and how they end.

use std::fs::{self, File, Permissions};
use std::io::{BufRead, BufReader, Read, Write};
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::os::unix::net::UnixListener;
use std::os::unix::process::CommandExt;
use std::process::Command;

use serde_json::{Value, json};

use super::link::Link;
use crate::rig::{FAST, LONG, Rig, finished, full_socket, headingd, leave_dead_socket};

/// Whoever is not of the daemon's group.
#[test]
fn who_may_not_connect_is_told_what_helps() {
    let rig = Rig::new(1.0, LONG);
    let _process = rig.start();
    Link::new(&rig).told("status");
    let socket = rig.text("control.sock");
    // Where somebody else can run it. Copied by a process of its own: a program that this one has open for writing while
    // another test forks cannot be run. In a container, nothing in /dev/shm may be run.
    let folder = tempfile::tempdir().unwrap();
    let program = folder.path().join("headingd");
    let copied = Command::new("cp")
        .arg(env!("CARGO_BIN_EXE_headingd"))
        .arg(&program)
        .status();
    assert!(copied.unwrap().success());
    for folder in [folder.path(), rig.folder.path()] {
        fs::set_permissions(folder, Permissions::from_mode(0o755)).unwrap();
    }
    let mut command = Command::new(&program);
    command.args(["status", "--socket", &socket]);
    if fs::metadata(&socket).unwrap().uid() == 0 {
        // The superuser may connect anywhere.
        command.uid(65534).gid(65534);
    } else {
        fs::set_permissions(&socket, Permissions::from_mode(0o000)).unwrap();
    }
    let (status, _, said) = finished(&mut command);
    assert_eq!(status, 77, "{said}");
    assert!(said.contains("usermod -aG headingd $USER"), "{said}");
}

#[test]
fn every_command_does_what_it_says() {
    let rig = Rig::new(FAST, LONG);
    let (_process, mut client) = rig.watched();
    client.accepted();
    let config = rig.text("headingd.toml");
    let run = |arguments: &[&str]| {
        let (status, out, err) =
            headingd(&[&["calibration"], arguments, &["--config", &config]].concat());
        assert_eq!((status, err.as_str()), (0, ""), "{arguments:?}");
        out
    };
    assert!(run(&["mode", "off"]).starts_with("mode off: "));
    assert_eq!(run(&["mode"]), run(&["mode", "off"]));
    let listed = run(&["list"]);
    let last = listed.lines().rev().nth(1).unwrap();
    assert!(
        last.starts_with("* ") && last.contains("planar"),
        "{listed}"
    );
    assert!(
        last.contains("by turn") && last.contains("residual"),
        "{listed}"
    );
    let list: Value = serde_json::from_str(&run(&["list", "--json"])).unwrap();
    let number = list["in_force"].as_u64().unwrap();

    let file = rig.text("exported.json");
    assert_eq!(run(&["export", "--out", &file]), "");
    let exported = fs::read_to_string(&file).unwrap();
    assert_eq!(run(&["export", &number.to_string()]), exported);
    assert_eq!(run(&["export", "--out", "-"]), exported);
    let nowhere = rig.text("none/exported.json");
    let arguments = ["calibration", "export", "--out", &nowhere, "--config"];
    let (status, _, err) = headingd(&[&arguments[..], &[&config]].concat());
    assert_eq!(status, 73);
    assert!(
        err.ends_with("exported.json: No such file or directory (os error 2)\n"),
        "{err}"
    );
    // One that is kept already is not kept twice.
    assert_eq!(
        run(&["import", &file]),
        format!("calibration {number} is active\n")
    );
    let mut changed: Value = serde_json::from_str(&exported).unwrap();
    let bias = &mut changed["sensors"][0]["history"][0]["calibration"]["bias_mgauss"][0];
    *bias = json!(bias.as_f64().unwrap() + 1.0);
    fs::write(&file, changed.to_string()).unwrap();
    let arguments = ["calibration", "import", "-", "--config", &config];
    let import = Command::new(env!("CARGO_BIN_EXE_headingd"))
        .args(arguments)
        .stdin(File::open(&file).unwrap())
        .output()
        .unwrap();
    let next = number + 1;
    assert_eq!(
        String::from_utf8(import.stdout).unwrap(),
        format!("calibration {next} is active\n")
    );
    assert!(run(&["show"]).contains("\"bias_mgauss\""));
    assert_eq!(
        run(&["rollback"]),
        format!("calibration {number} is active\n")
    );
    assert!(run(&["forget", &next.to_string()]).contains("the active one stays"));
    assert!(run(&["start"]).contains("turn the board"));
    run(&["cancel"]);
    run(&["lock"]);

    let socket = rig.text("control.sock");
    let (status, out, _) = headingd(&["status", "--socket", &socket]);
    assert_eq!(status, 0);
    for part in [
        "mode         locked\n",
        "store        good, in ",
        "simulator, hmc5843 mounted +x +y +z\n",
        " old\n",
    ] {
        assert!(out.contains(part), "{part} is not in {out}");
    }
    // The same word and reason as on the heading socket. The client that watched has taken nothing since, and may have been
    // sent away.
    let mut another = rig.client();
    let state = another.find("STATE", |_| true);
    let (_, out, _) = headingd(&["status", "--json", "--config", &config]);
    let status: Value = serde_json::from_str(&out).unwrap();
    for (ours, theirs) in [
        ("cal_state", "cal_state"),
        ("reason", "reason"),
        ("message", "message"),
    ] {
        assert_eq!(status[ours], state[theirs], "{status} {state}");
    }
    assert!(status["clients"].as_u64().unwrap() > 0);
    assert_eq!(status["source"], "simulator");

    let (status, out, err) = headingd(&["calibration", "start", "--config", &config]);
    assert_eq!((status, out.as_str()), (3, ""));
    assert!(
        err.contains("headingd calibration unlock lets it go (locked)"),
        "{err}"
    );
    let (status, out, again) = headingd(&["calibration", "start", "--json", "--config", &config]);
    let answer: Value = serde_json::from_str(&out).unwrap();
    assert_eq!((status, again), (3, err));
    assert_eq!(
        (&answer["ok"], &answer["code"]),
        (&Value::Bool(false), &Value::from("locked"))
    );
    run(&["unlock"]);

    // What helps in mode off.
    run(&["mode", "off"]);
    assert_eq!(run(&["unlock"]), "nothing was locked: mode off stays\n");
    let said = run(&["forget", "--all"]);
    let remedy = "headingd calibration start, and then turn the board once";
    assert!(
        said.ends_with(&format!("no calibration is active: {remedy}\n")),
        "{said}"
    );
    for action in ["show", "export", "forget"] {
        let (status, _, err) = headingd(&["calibration", action, "--config", &config]);
        assert_eq!(status, 3);
        assert!(err.contains(remedy), "{action}: {err}");
    }
}

#[test]
fn each_way_to_fail_has_its_status_and_its_remedy() {
    let rig = Rig::new(1.0, LONG);
    let nobody = rig.text("none.sock");
    let dead = rig.text("dead.sock");
    leave_dead_socket(&dead);
    let bad = rig.text("bad.json");
    fs::write(&bad, "{\"headingd_store\": 2").unwrap();
    let missing = rig.text("missing.json");
    let _process = rig.start();
    Link::new(&rig).told("status");
    let socket = rig.text("control.sock");
    let headings = rig.text("heading.sock");
    let other = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/store-2.json");
    for (expected, arguments, sentence) in [
        (
            69,
            vec!["status", "--socket", &nobody],
            "systemctl start headingd",
        ),
        (
            65,
            vec!["calibration", "list", "--socket", &headings],
            &format!("heading.sock is the socket for headings: the control socket is {socket}"),
        ),
        (
            69,
            vec!["status", "--socket", &dead],
            "no headingd is running at",
        ),
        (
            2,
            vec!["status", "--socket", "a", "--config", "b"],
            "cannot be used with",
        ),
        (
            2,
            vec!["calibration", "mode", "of"],
            "[possible values: on, off, locked]",
        ),
        (
            2,
            vec!["calibration", "forget", "1", "--all"],
            "cannot be used with",
        ),
        (2, vec!["calibration", "rollback", "0"], "0 is not in 1.."),
        (
            66,
            vec!["calibration", "import", &missing, "--socket", &socket],
            "missing.json",
        ),
        (
            65,
            vec!["calibration", "import", &bad, "--socket", &socket],
            "bad.json is not a usable",
        ),
        (
            3,
            vec!["calibration", "import", other, "--socket", &socket],
            "(other_mounting)",
        ),
        (
            3,
            vec!["calibration", "lock", "--socket", &socket],
            "turn the board once (no_calibration)",
        ),
        (
            3,
            vec!["calibration", "show", "7", "--socket", &socket],
            "headingd calibration list shows",
        ),
    ] {
        let (status, out, err) = headingd(&arguments);
        assert_eq!(
            (status, out.as_str()),
            (expected, ""),
            "{arguments:?}: {err}"
        );
        assert!(err.contains(sentence), "{arguments:?}: {err}");
    }
}

#[test]
fn a_change_that_is_not_kept_and_a_daemon_that_is_deaf_are_told_apart() {
    let rig = Rig::new(FAST, LONG);
    fs::write(rig.path("file"), "").unwrap();
    rig.configure(FAST, &rig.path("file/store"), LONG);
    let (mut process, mut client) = rig.watched();
    client.accepted();
    let socket = rig.text("control.sock");
    let (status, out, err) = headingd(&["calibration", "lock", "--socket", &socket]);
    assert_eq!((status, out.as_str()), (74, ""), "{err}");
    assert!(err.contains("(not_kept)"), "{err}");
    client.heading();
    process.signal("TERM");
    let said = process.ends(74);
    let lost =
        "headingd: the last calibrations and settings are lost: cannot keep calibrations in folder";
    for once in ["ERROR cannot keep calibrations in folder", lost] {
        assert_eq!(said.matches(once).count(), 1, "{said}");
    }

    let stranger = rig.text("stranger.sock");
    let listener = UnixListener::bind(&stranger).unwrap();
    let thread = std::thread::spawn(move || {
        let (mut stream, _) = listener.accept().unwrap();
        stream.write_all(b"220 mail\r\n").unwrap();
        // Until the command has read it and leaves.
        let _ = stream.read_to_end(&mut Vec::new());
    });
    let (status, _, err) = headingd(&["status", "--socket", &stranger]);
    thread.join().unwrap();
    assert_eq!(status, 65, "{err}");
    assert!(err.contains("is not headingd's control socket"), "{err}");

    // It is killed before its answer, or in the midst of it.
    let hangs_up = rig.text("hangs-up.sock");
    let listener = UnixListener::bind(&hangs_up).unwrap();
    for said in ["", "{\"ok\":true,\"code\":"] {
        let listener = listener.try_clone().unwrap();
        let thread = std::thread::spawn(move || {
            let (mut stream, _) = listener.accept().unwrap();
            BufReader::new(&stream)
                .read_line(&mut String::new())
                .unwrap();
            stream.write_all(said.as_bytes()).unwrap();
        });
        let (status, _, err) = headingd(&["status", "--socket", &hangs_up]);
        thread.join().unwrap();
        assert_eq!(status, 69, "{err}");
    }
}

#[test]
fn a_daemon_that_takes_no_connections_is_not_waited_for() {
    let rig = Rig::new(1.0, "");
    let path = rig.text("full.sock");
    let _full = full_socket(&path);
    let mut process = rig.run(&["status", "--socket", &path]);
    let said = process.ends(69);
    assert!(said.contains("headingd does not answer at"), "{said}");
}
