//! The socket itself: who may, what is not understood, and how much is too much.

use std::fs;
use std::io::Write;
use std::os::unix::fs::PermissionsExt;
use std::time::Duration;

use serde_json::json;

use super::link::Link;
use crate::rig::{LONG, Rig, until};

#[test]
fn whatever_is_not_understood_gets_a_code_and_a_sentence_and_the_daemon_goes_on() {
    let rig = Rig::new(1.0, LONG);
    let mut process = rig.start();
    let mut link = Link::new(&rig);
    for (line, code) in [
        ("status\n", "malformed"),
        ("{\"request\":\"status\"\n", "malformed"),
        ("\u{0}\u{1}\n", "malformed"),
        ("{\"request\":\"reboot\"}\n", "unknown_request"),
        ("{\"request\":\"lock\",\"now\":true}\n", "malformed"),
        ("{\"request\":\"show\",\"number\":\"1\"}\n", "malformed"),
        ("{\"request\":\"show\",\"number\":1}\n", "no_such_number"),
        ("{\"request\":\"show\"}\n", "no_calibration"),
        ("{\"request\":\"lock\"}\n", "no_calibration"),
        ("{\"request\":\"forget\"}\n", "no_calibration"),
        ("{\"request\":\"rollback\"}\n", "nothing_before"),
        ("{\"request\":\"cancel\"}\n", "nothing_to_cancel"),
        ("{\"request\":\"import\",\"file\":{}}\n", "unreadable"),
        (
            "{\"request\":\"import\",\"file\":{\"headingd_store\":9}}\n",
            "newer",
        ),
    ] {
        link.send(line.as_bytes());
        let answer = link.next().unwrap();
        assert_eq!(answer["code"], code, "{line}: {answer}");
    }
    // Two in one piece, an empty line between them, and one without an end.
    link.send(b"{\"request\":\"list\"}\n\r\n{\"request\":\"mode\"}\n{\"request\":");
    assert_eq!(link.next().unwrap()["calibrations"], json!([]));
    assert_eq!(link.next().unwrap()["mode"], "on");
    link.send(b"\"status\"}\n");
    assert_eq!(link.next().unwrap()["ok"], true);
    let status = link.status("a reading", |status| status.get("cal_state").is_some());
    assert_eq!(status["cal_state"], "uncalibrated");
    process.stop();
    assert!(!rig.path("control.sock").exists());
    assert!(link.next().is_none());
    // Refusals and orders are in the log, with who it was.
    let said = process.said();
    let uid = std::os::unix::fs::MetadataExt::uid(&fs::metadata(rig.path("store")).unwrap());
    let pid = std::process::id();
    assert!(
        said.contains(&format!("pid={pid} uid={uid} gid=")),
        "{said}"
    );
    assert!(
        said.contains("asked for lock: no calibration is active"),
        "{said}"
    );
    assert!(!said.contains("asked for status"), "{said}");
}

#[test]
fn every_change_of_a_burst_is_in_the_log_with_who_asked() {
    let rig = Rig::new(1.0, LONG);
    let process = rig.start();
    let mut link = Link::new(&rig);
    let modes = ["off", "on"].repeat(10);
    for mode in &modes {
        link.ask(&json!({"request": "mode", "mode": mode}));
    }
    link.refused(
        json!({"request": "rollback", "number": 7}),
        "no_such_number",
    );
    let who = format!(
        "asked for rollback 7: there is no calibration 7: headingd calibration list shows which there are pid={}",
        std::process::id()
    );
    process.says(&who);
    let said = process.said();
    let asked: Vec<_> = said
        .lines()
        .filter_map(|line| line.split_once("asked for mode ")?.1.split(':').next())
        .collect();
    assert_eq!(asked, modes, "{said}");
}

#[test]
fn a_request_may_be_long_and_an_endless_line_is_cut_off() {
    let rig = Rig::new(1.0, LONG);
    let _process = rig.start();
    let mut link = Link::new(&rig);
    let status = "{\"request\":\"status\"}";
    let blank = " ".repeat(256 * 1024 - status.len());
    link.send(format!("{status}{blank}\r\n").as_bytes());
    assert_eq!(link.next().unwrap()["ok"], true);
    link.send(&vec![b' '; 256 * 1024]);
    link.send(b"{}\n");
    assert_eq!(link.next().unwrap()["code"], "too_long");
    assert!(link.next().is_none());
    Link::new(&rig).told("status");
}

#[test]
fn who_asks_nothing_or_half_of_it_is_told_so_and_makes_room() {
    let rig = Rig::new(1.0, LONG);
    let _process = rig.start();
    let mut links: Vec<Link> = (0..8).map(|_| Link::new(&rig)).collect();
    links[0].told("status");
    links[1].send(b"{\"request\":");
    let mut third = links[2].writer();
    // Until it is hung up on.
    std::thread::spawn(move || {
        while third.write_all(b"\r\n").is_ok() {
            std::thread::sleep(Duration::from_secs(1));
        }
    });
    let mut ninth = Link::new(&rig);
    assert_eq!(ninth.next().unwrap()["code"], "too_many_clients");
    assert!(ninth.next().is_none());
    for link in &mut links {
        let answer = link.next().unwrap();
        assert_eq!(answer["code"], "timeout", "{answer}");
        assert!(link.next().is_none());
    }
    Link::new(&rig).told("status");
}

#[test]
fn it_is_there_for_user_and_group_only_wherever_it_is() {
    let mode = |path| fs::metadata(path).unwrap().permissions().mode() & 0o777;
    let rig = Rig::new(1.0, LONG);
    let process = rig.start();
    Link::new(&rig).told("status");
    assert_eq!(mode(rig.path("control.sock")), 0o660);
    drop(process);

    let elsewhere = rig.path("elsewhere");
    let more = format!("{LONG}[control]\nsocket = {elsewhere:?}\nmode = \"0600\"\n");
    rig.configure(1.0, &rig.path("store"), &more);
    let _process = rig.start();
    until("the socket", || elsewhere.exists());
    assert_eq!(mode(elsewhere), 0o600);
}

#[test]
fn without_a_place_for_it_headings_are_served_all_the_same() {
    let rig = Rig::new(1.0, LONG);
    let mut file = fs::File::create(rig.path("control.sock")).unwrap();
    file.write_all(b"mine").unwrap();
    let (process, mut client) = rig.watched();
    client.find("ATT", |_| true);
    let said = process.said();
    assert!(said.contains("a file that is no socket is there"), "{said}");
    assert!(
        said.contains("headingd calibration will not work"),
        "{said}"
    );
    assert_eq!(fs::read(rig.path("control.sock")).unwrap(), b"mine");
}
