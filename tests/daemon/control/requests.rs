//! Looking after the calibrations of a daemon at work.

use serde_json::{Value, json};

use super::link::Link;
use crate::rig::{Client, FAST, LONG, Process, Rig, until};

/// A daemon that has calibrated, and does so no more by itself; the number of the active calibration.
fn calibrated(rig: &Rig) -> (Process, Client, Link, u64) {
    let (process, mut client) = rig.watched();
    client.accepted();
    let mut link = Link::new(rig);
    assert_eq!(
        link.ask(&json!({"request": "mode", "mode": "off"}))["mode"],
        "off"
    );
    let number = link.told("list")["in_force"].as_u64().unwrap();
    (process, client, link, number)
}

fn active(link: &mut Link) -> Value {
    link.told("list")["in_force"].clone()
}

#[test]
fn a_calibration_is_exported_imported_rolled_back_and_forgotten() {
    let rig = Rig::new(FAST, LONG);
    let (_process, mut client, mut link, first) = calibrated(&rig);
    let shown = link.told("show");
    assert_eq!(shown["calibration"]["number"], first);
    assert_eq!(shown["calibration"]["reason"], "turn");
    assert_eq!(shown["calibration"]["mode"], "planar");
    for key in [
        "saved_unix_s",
        "age_s",
        "residual_mgauss",
        "heading_sd_deg",
        "gyro_rms_deg",
        "samples",
    ] {
        assert!(shown["calibration"][key].is_number(), "{key}: {shown}");
    }
    assert!(shown["parameters"]["bias_mgauss"].is_array(), "{shown}");

    let mut file = link.told("export")["file"].clone();
    // Told apart from the one that was exported.
    let bias = &mut file["sensors"][0]["history"][0]["calibration"]["bias_mgauss"][0];
    *bias = json!(bias.as_f64().unwrap() + 1.0);
    let imported = link.ask(&json!({"request": "import", "file": file}));
    assert_eq!(imported["number"], first + 1, "{imported}");
    assert_eq!(active(&mut link), first + 1);
    let shown = link.told("show");
    assert_eq!(shown["calibration"]["reason"], "import");
    assert_eq!(
        shown["parameters"],
        file["sensors"][0]["history"][0]["calibration"]
    );

    assert_eq!(link.told("rollback")["number"], first);
    assert_eq!(
        link.ask(&json!({"request": "rollback", "number": first + 1}))["ok"],
        true
    );
    let forgot = link.ask(&json!({"request": "forget", "number": first}));
    assert_eq!(forgot["count"], 1);
    client.heading();
    link.told("forget");
    // Headings end with the calibration.
    let state = client.find("STATE", |state| state["cal_state"] == "uncalibrated");
    assert_eq!(state["reason"], "mode_off");
    client.find("ATT", |att| att.get("mheading").is_none());
    let status = link.told("status");
    assert_eq!(status.get("calibration"), None, "{status}");
    assert_eq!(
        (&status["reason"], &status["message"]),
        (&state["reason"], &state["message"])
    );
    let kept = link.told("list")["calibrations"].as_array().unwrap().len();
    if kept > 0 {
        let gone = link.ask(&json!({"request": "forget", "all": true}));
        assert_eq!(gone["count"], kept);
    }
    link.refused(json!({"request": "rollback"}), "nothing_before");
    // The number is not given again.
    let again = link.ask(&json!({"request": "import", "file": file}));
    assert_eq!(again["number"], first + 2);
    client.find("STATE", |state| state["cal_state"] == "degraded");
    client.heading();
}

#[test]
fn what_is_not_of_this_board_or_cannot_be_is_not_imported() {
    let rig = Rig::new(FAST, LONG);
    let (_process, _client, mut link, number) = calibrated(&rig);
    let file = link.told("export")["file"].clone();
    let with = |change: &dyn Fn(&mut Value)| {
        let mut file = file.clone();
        change(&mut file["sensors"][0]);
        json!({"request": "import", "file": file})
    };
    for (change, code, sentence) in [
        (
            &(|s: &mut Value| s["sensor"] = json!("qmc5883l")) as &dyn Fn(&mut Value),
            "other_sensor",
            "of qmc5883l mounted",
        ),
        (
            &|s| s["mag_axes"] = json!("+y -x +z"),
            "other_mounting",
            "set [mounting] right",
        ),
        (
            &|s| s["in_force"] = Value::Null,
            "no_calibration",
            "is active",
        ),
        (
            &|s| s["history"][0]["calibration"]["scale"][0] = json!(-1),
            "unreadable",
            "calibration.scale[0] is -1",
        ),
        (
            &|s| s["history"][0]["calibration"]["scale"][0] = json!(9),
            "implausible",
            "axis_ratio",
        ),
        (
            &|s| s["history"][0]["calibration"]["residual_mgauss"] = json!(99),
            "implausible",
            "its samples were spread",
        ),
        (
            &|s| s["history"][0]["calibration"]["heading_sd_deg"] = json!(9),
            "implausible",
            "heading uncertainty: 9.00 degrees",
        ),
    ] {
        let message = link.refused(with(change), code);
        assert!(message.contains(sentence), "{message}");
        assert_eq!(active(&mut link), number);
    }
    // Version 1, of this sensor.
    let old = json!({"headingd_store": 1, "sensor": "hmc5843", "mag_axes": "+x +y +z", "saved_unix_s": 1_760_000_000,
        "calibration": file["sensors"][0]["history"][0]["calibration"]});
    let imported = link.ask(&json!({"request": "import", "file": old}));
    assert_eq!(imported["ok"], true, "{imported}");
    assert_eq!(
        link.told("show")["calibration"]["saved_unix_s"],
        1_760_000_000
    );
}

#[test]
fn locked_means_never_replaced_not_even_over_a_restart() {
    let rig = Rig::new(FAST, LONG);
    let (mut process, _client, mut link, number) = calibrated(&rig);
    let file = link.told("export")["file"].clone();
    link.told("lock");
    assert_eq!(link.told("mode")["mode"], "locked");
    for request in [
        json!({"request": "start"}),
        json!({"request": "forget"}),
        json!({"request": "forget", "all": true}),
        json!({"request": "import", "file": file}),
    ] {
        let message = link.refused(request, "locked");
        assert!(message.contains("headingd calibration unlock"), "{message}");
    }
    process.signal("KILL");
    process.wait();

    // Again at speed: it turns, and would calibrate.
    let mut process = rig.start();
    let mut client = rig.client();
    assert!(client.find("ATT", |_| true).get("mheading").is_some());
    let mut link = Link::new(&rig);
    let status = link.told("status");
    assert_eq!(
        (&status["mode"], &status["armed"]),
        (&json!("locked"), &json!(false))
    );
    assert_eq!(status["calibration"]["number"], number);
    until("two turns", || {
        process.said().matches("full turn").count() > 1
    });
    assert_eq!(active(&mut link), number);
    link.told("unlock");
    client.find("CALIBRATION", |_| true);
    process.stop();
}

#[test]
fn in_mode_off_a_start_calibrates_once_and_can_be_cancelled() {
    let rig = Rig::new(FAST, LONG);
    let (_process, mut client, mut link, _) = calibrated(&rig);
    // What has come of an earlier turn is not what comes of this order.
    link.told("forget");
    client.find("STATE", |state| state["reason"] == "mode_off");
    link.told("start");
    let status = link.status("armed", |status| status["armed"] == true);
    assert_eq!(status["mode"], "off");
    client.accepted();
    let status = link.status("done", |status| status["armed"] == false);
    assert_eq!(status["calibration"]["reason"], "start", "{status}");
    link.refused(json!({"request": "cancel"}), "nothing_to_cancel");
    link.told("start");
    link.told("cancel");
    assert_eq!(link.told("status")["armed"], false);
}
