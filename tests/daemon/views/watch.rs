//! `headingd watch`.

use std::os::unix::net::UnixStream;

use serde_json::Value;

use crate::rig::{ENDLESS, FAST, Rig, headingd, until};

#[test]
fn headings_are_printed_as_text_json_and_nmea() {
    let rig = Rig::new(FAST, ENDLESS);
    let (_process, mut client) = rig.watched();
    let socket = rig.text("heading.sock");
    let watch = |more: &[&str]| {
        let arguments = [&["watch", "--socket", &socket, "--count", "3"], more].concat();
        let (status, out, err) = headingd(&arguments);
        assert_eq!((status, err.as_str()), (0, ""), "{more:?}");
        out
    };
    client.heading();
    let text = watch(&["--rate", "100"]);
    let headings = text.lines().filter(|line| line.contains("° magnetic ± "));
    assert_eq!(headings.count(), 3, "{text}");
    // First of all, how things stand.
    assert!(text.lines().next().unwrap().contains("): "), "{text}");

    let json = watch(&["--json"]);
    let objects: Vec<Value> = json
        .lines()
        .map(|line| {
            assert!(line.starts_with("{\"class\":\""), "{line}");
            serde_json::from_str(line).unwrap()
        })
        .collect();
    let headings = objects
        .iter()
        .filter(|object| object["mheading"].is_number());
    assert_eq!(headings.count(), 3, "{json}");
    assert!(
        objects.iter().any(|object| object["class"] == "STATE"),
        "{json}"
    );

    let nmea = watch(&["--nmea", "--rate", "100"]);
    assert!(nmea.lines().all(|line| line.starts_with("$HC")), "{nmea}");
    for sentence in ["$HCHDM,", "$HCHDG,", "$HCROT,", "$HCXDR,"] {
        assert_eq!(nmea.matches(sentence).count(), 3, "{sentence}: {nmea}");
    }
}

#[test]
fn who_cannot_be_watched_is_named_with_what_helps() {
    let rig = Rig::new(FAST, ENDLESS);
    let (mut process, _client) = rig.watched();
    let [control, none, plain] =
        ["control.sock", "none.sock", "plain.txt"].map(|name| rig.text(name));
    std::fs::write(&plain, "").unwrap();
    until("the control socket", || {
        UnixStream::connect(&control).is_ok()
    });
    for (socket, status, part) in [
        (&control, 65, "is not headingd's socket for headings"),
        (&none, 69, "no headingd is running at"),
        (&plain, 65, "plain.txt is not a socket"),
    ] {
        let (found, out, err) = headingd(&["watch", "--socket", socket]);
        assert_eq!((found, out.as_str()), (status, ""), "{err}");
        assert!(err.contains(part), "{err}");
    }
    // It ends with its daemon, and says so.
    let headings = rig.text("heading.sock");
    let arguments = ["watch", "--json", "--socket", &headings];
    let mut watching = rig.run(&arguments);
    until("the first line", || {
        std::fs::read_to_string(rig.path("stdout")).is_ok_and(|text| text.contains("ATT"))
    });
    process.stop();
    let said = watching.ends(69);
    assert!(said.contains("headingd has closed"), "{said}");
}

#[test]
fn a_daemon_that_hangs_is_told_of() {
    let rig = Rig::new(FAST, ENDLESS);
    let (process, _client) = rig.watched();
    let mut watching = rig.spawn(&mut rig.command(&["watch", "--json"]));
    until("the first line", || {
        std::fs::read_to_string(rig.path("stdout")).is_ok_and(|text| text.contains("ATT"))
    });
    process.signal("STOP");
    let mut asking = rig.spawn(&mut rig.command(&["status"]));
    let out = rig.text("a.csv");
    let mut recording = rig.spawn(&mut rig.command(&["record", "--out", &out]));
    for client in [&mut asking, &mut watching, &mut recording] {
        let said = client.ends(69);
        assert!(said.contains("headingd does not answer at"), "{said}");
    }
}
