//! A store that does not work: the daemon serves, says so, and makes up for it.

use std::fs;

use serde_json::json;

use super::link::Link;
use crate::rig::{FAST, LONG, Rig};

#[test]
fn a_store_that_fails_shows_in_the_status_and_catches_up_when_it_works() {
    let rig = Rig::new(FAST, LONG);
    let store = rig.path("store");
    fs::write(&store, "").unwrap();
    let (process, mut client) = rig.watched();
    let mut link = Link::new(&rig);
    let status = link.told("status");
    assert_eq!(status["store"]["state"], "failing");
    let message = status["store"]["message"].as_str().unwrap();
    let right = "store: it is a file, not a folder; set store.directory";
    assert!(message.contains(right), "{message}");
    client.accepted();
    // It is done, but not kept, and says so.
    let answer = link.ask(&json!({"request": "lock"}));
    assert_eq!(
        (&answer["ok"], &answer["code"]),
        (&json!(false), &json!("not_kept"))
    );
    let message = answer["message"].as_str().unwrap();
    assert!(message.contains("not on disk yet"), "{message}");
    assert_eq!(link.told("status")["mode"], "locked");

    fs::remove_file(&store).unwrap();
    link.status("the store to work", |status| {
        status["store"]["state"] == "good"
    });
    let kept = fs::read_to_string(store.join("calibration.json")).unwrap();
    assert!(
        kept.contains("\"locked\"") && kept.contains("\"planar\""),
        "{kept}"
    );
    let said = process.said();
    assert!(said.contains("calibrations are kept in"), "{said}");
    assert_eq!(
        said.matches("ERROR cannot keep calibrations in folder")
            .count(),
        1,
        "{said}"
    );
}

#[test]
fn a_folder_that_cannot_be_made_is_not_taken_for_an_empty_one() {
    let rig = Rig::new(FAST, LONG);
    // Before the end there is nothing to keep.
    rig.configure(1.0, "/proc/none".as_ref(), LONG);
    let (mut process, _client) = rig.watched();
    let said = process.stop();
    assert!(
        said.contains("folder /proc/none: No such file or directory (os error 2); set store"),
        "{said}"
    );
    assert!(!said.contains("no calibration in"), "{said}");
}

#[test]
fn a_file_of_a_newer_version_is_served_without_said_and_set_aside() {
    let text = "{\"headingd_store\": 4, \"more\": []}";
    let rig = Rig::new(FAST, LONG);
    let store = rig.path("store");
    fs::create_dir(&store).unwrap();
    fs::write(store.join("calibration.json"), text).unwrap();
    let (process, mut client) = rig.watched();
    let mut link = Link::new(&rig);
    let status = link.told("status");
    assert_eq!(status["store"]["state"], "failing", "{status}");
    let message = status["store"]["message"].as_str().unwrap();
    let why = "newer than this headingd supports";
    assert!(message.contains(why), "{message}");
    client.accepted();
    link.status("the store to work", |status| {
        status["store"]["state"] == "good"
    });
    let aside = store.join("calibration.json.newer-1");
    assert_eq!(fs::read_to_string(aside).unwrap(), text);
    process.says("set aside the file that was there");
}

#[test]
fn with_no_store_at_all_what_is_ordered_holds_until_the_end() {
    let rig = Rig::new(FAST, LONG);
    rig.configure(FAST, "".as_ref(), LONG);
    let (_process, mut client) = rig.watched();
    client.accepted();
    let mut link = Link::new(&rig);
    link.told("lock");
    let status = link.told("status");
    assert_eq!(status["store"], json!({"state": "off"}));
    assert_eq!(status["mode"], "locked");
}

#[test]
fn a_recording_that_fails_shows_in_the_status_and_goes_on_when_it_works() {
    let rig = Rig::new(1.0, "");
    // Not even root can make a folder below a file.
    fs::write(rig.path("file"), "").unwrap();
    let ring = rig.path("file/ring");
    let more = format!("{LONG}[record]\ndirectory = {ring:?}\n");
    rig.configure(FAST, &rig.path("store"), &more);
    let (process, _client) = rig.watched();
    let mut link = Link::new(&rig);
    let failing = link.status("the recording to fail", |status| {
        status["record"]["state"] == "failing"
    });
    let message = failing["record"]["message"].as_str().unwrap();
    let helps = "; set record.directory to a folder that this user may write";
    assert!(message.contains(helps), "{message}");
    process.says(helps);

    fs::remove_file(rig.path("file")).unwrap();
    let status = link.status("the recording to work", |status| {
        status["record"]["state"] == "good"
    });
    assert_eq!(status["record"]["directory"], json!(ring));
    process.says("recording again");
}
