use super::*;
use crate::condition::Condition;
use proptest::prelude::*;
use serde_json::Value;

fn att(device: &str, heading: &Heading, time: Option<&str>, age_ms: u64) -> String {
    let mut out = String::new();
    att_begin(&mut out, device, heading, time);
    att_end(&mut out, age_ms);
    out
}

fn heading(condition: Condition) -> Heading {
    Heading {
        seq: 7,
        t_s: 12.3456785,
        condition,
        fused_deg: Some(359.996),
        instantaneous_deg: Some(359.994),
        raw_deg: Some(12.0),
        sd_deg: Some(1.234),
        declination_deg: Some(13.304),
        pitch_deg: Some(-0.004),
        roll_deg: Some(-1.5),
        turn_deg_min: Some(-90.04),
        rate_deg_s: Some([0.0, -0.0001, 1.5]),
        specific_force_m_s2: Some([3.0, 4.0, f64::NAN]),
        dip_deg: Some(72.818),
        field_mgauss: Some([Some(160.04), Some(-20.06), None]),
        strength_mgauss: Some(f64::NAN),
        ..Heading::default()
    }
}

#[test]
fn an_att_object_is_compact_ordered_and_rounded() {
    assert_eq!(
        att(
            "/dev/i2c-1",
            &heading(Condition::Good),
            Some("2026-11-21T10:00:00.000Z"),
            4
        ),
        concat!(
            r#"{"class":"ATT","device":"/dev/i2c-1","time":"2026-11-21T10:00:00.000Z","t_s":12.345679,"seq":7,"#,
            r#""heading":13.30,"mheading":0.00,"inst_heading":359.99,"raw_heading":12.00,"heading_sd":1.23,"mag_st":"N","#,
            r#""pitch":0.00,"roll":-1.50,"rot":-90.0,"dip":72.82,"mag_x":160.0,"mag_y":-20.1,"acc_x":3.000,"#,
            r#""acc_y":4.000,"gyro_x":0.000,"gyro_y":0.000,"gyro_z":1.500,"cal_state":"good","age_ms":4}"#
        )
    );
}

#[test]
fn without_a_fused_heading_the_instantaneous_one_stands_in() {
    let mut heading = heading(Condition::Degraded);
    heading.fused_deg = None;
    heading.instantaneous_deg = Some(90.0);
    let object: Value = serde_json::from_str(&att("d", &heading, None, 0)).unwrap();
    assert_eq!(object["mheading"], 90.0);
    assert_eq!(object["inst_heading"], 90.0);
    assert!(object.get("time").is_none());
}

#[test]
fn nobody_may_steer_by_an_untrusted_heading() {
    for condition in [
        Condition::Uncalibrated,
        Condition::Turning,
        Condition::Calibrating,
        Condition::Stale,
        Condition::Fault,
    ] {
        let object: Value = serde_json::from_str(&att("d", &heading(condition), None, 0)).unwrap();
        for key in ["heading", "mheading", "inst_heading", "heading_sd"] {
            assert!(
                object.get(key).is_none(),
                "{key} while {}",
                condition.word()
            );
        }
        assert_eq!(object["raw_heading"], 12.0);
        assert_eq!(object["cal_state"], condition.word());
    }
}

#[test]
fn state_leaves_out_what_is_unknown_and_escapes_its_message() {
    let mut report = Report {
        condition: Condition::Turning,
        reason: "turning",
        message: "a \"full\" turn\n".into(),
        progress: Some(0.25),
        t_s: 3.0,
    };
    assert_eq!(
        state(&report),
        r#"{"class":"STATE","cal_state":"turning","reason":"turning","message":"a \"full\" turn\n","progress":0.250,"t_s":3.000000}"#
    );
    report.progress = None;
    assert!(!state(&report).contains("progress"));
}

#[test]
fn watch_says_what_is_sent() {
    let policy = WatchPolicy {
        enable: true,
        nmea: true,
        rate_hz: Some(2.5),
        ..WatchPolicy::default()
    };
    assert_eq!(
        watch(&policy),
        concat!(
            r#"{"class":"WATCH","enable":true,"json":false,"nmea":true,"raw":0,"scaled":false,"timing":false,"#,
            r#""split24":false,"pps":false,"calibration":false,"state":false,"readings":false,"rate_hz":2.500}"#
        )
    );
}

#[test]
fn a_device_has_all_of_gpsds_keys() {
    let board = Device {
        path: "/dev/ttyUSB0".into(),
        activated: Some("2026-11-21T10:00:00.000Z".into()),
        sensor: Some("hmc5843".into()),
        bps: Some(57600),
    };
    for (cycle_s, cycle) in [
        (Some(0.025), r#""cycle":0.025,"mincycle":0.025}"#),
        (None, r#""cycle":1.000,"mincycle":1.000}"#),
    ] {
        let begin = concat!(
            r#"{"class":"DEVICE","path":"/dev/ttyUSB0","driver":"headingd","subtype":"hmc5843","#,
            r#""activated":"2026-11-21T10:00:00.000Z","flags":0,"native":0,"bps":57600,"parity":"N","stopbits":1,"#,
        );
        assert_eq!(device(&board, cycle_s), format!("{begin}{cycle}"));
    }
}

proptest! {
    #[test]
    fn any_number_gives_valid_json_and_angles_stay_below_360(value in proptest::num::f64::ANY) {
        let mut heading = heading(Condition::Good);
        heading.t_s = value;
        heading.fused_deg = Some(value);
        heading.instantaneous_deg = None;
        heading.pitch_deg = Some(value);
        let object: Value = serde_json::from_str(&att("d", &heading, None, 0)).unwrap();
        if let Some(angle) = object.get("mheading") {
            prop_assert!((0.0..360.0).contains(&angle.as_f64().unwrap()));
        }
    }
}
