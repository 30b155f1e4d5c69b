//! From magnetic to true north: the model, a declination by hand, and the times of logs.

use headingd::sensor::simulator::{Scenario, Settings};
use serde_json::Value;

use crate::common::{Folder, Ran, apart_deg, headingd, log, moving, of_class, simulated, turning};

const CALGARY: &str =
    "[true_north]\nlatitude_deg = 51.08\nlongitude_deg = -114.13\naltitude_m = 1100\n";

/// A replay of a log of this board, which says or does not say when it was recorded.
fn replay(board: &Settings, recorded_from: Option<&str>, config: &str) -> Ran {
    let folder = Folder::new();
    let (mut header, entries) = simulated(board);
    let time = recorded_from.map(|time| ("recorded_from".to_owned(), time.to_owned()));
    header.truth.extend(time);
    let log = folder.file("a.csv", log(&(header, entries)));
    let config = folder.file("a.toml", config);
    let ran = headingd(&["replay", &log, "--config", &config]);
    assert_eq!(ran.status, 0, "{ran:?}");
    Ran {
        // The path of the log is another one each time.
        out: ran.out.replace(&log, "a.csv"),
        ..ran
    }
}

/// The true headings, each with the magnetic one, of those that have a magnetic one.
fn headings(ran: &Ran) -> Vec<(Option<f64>, f64)> {
    let of = |att: &Value| Some((att["heading"].as_f64(), att["mheading"].as_f64()?));
    ran.lines().iter().filter_map(of).collect()
}

/// That so much lies between them, clockwise.
fn assert_declination(ran: &Ran, declination_deg: f64) {
    let headings = headings(ran);
    assert!(headings.len() > 100, "{}", headings.len());
    for (heading, magnetic) in headings {
        let found = apart_deg(heading.unwrap(), magnetic);
        assert!((found - declination_deg).abs() < 0.011, "{found}");
        assert!((0.0..360.0).contains(&heading.unwrap()));
    }
}

#[test]
fn a_log_says_its_day_and_gives_the_same_bytes_with_times_in_them() {
    let recorded = Some("2026-11-21T23:59:50Z");
    let board = turning(1.0);
    let ran = replay(&board, recorded, CALGARY);
    assert_eq!(ran.err, "");
    assert_declination(&ran, 13.304);
    let atts = of_class(&ran.lines(), "ATT");
    // The magnetometer's first reading comes 3 ms after the gyro's.
    assert_eq!(atts[0]["time"], "2026-11-21T23:59:50.003Z");
    assert!(atts.last().unwrap()["time"].as_str() > Some("2026-11-22T00:00:00"));
    assert_eq!(replay(&board, recorded, CALGARY).out, ran.out);
}

#[test]
fn a_declination_by_hand_does_for_a_log_without_a_date() {
    let ran = replay(
        &turning(1.0),
        None,
        "[true_north]\ndeclination_deg = -170.5\n",
    );
    assert_eq!(ran.err, "");
    assert_declination(&ran, -170.5);
    assert!(ran.lines().iter().all(|line| line.get("time").is_none()));
}

#[test]
fn what_the_model_cannot_tell_is_told_once_and_no_heading_is_true() {
    for (recorded, part) in [
        (None, "the date is not known"),
        (Some("2031-01-01T00:00:00Z"), "2029-12-31"),
    ] {
        let ran = replay(&turning(1.0), recorded, CALGARY);
        assert_eq!(ran.err.lines().count(), 1, "{}", ran.err);
        assert!(ran.err.contains(part), "{}", ran.err);
        let headings = headings(&ran);
        assert!(!headings.is_empty() && headings.iter().all(|(heading, _)| heading.is_none()));
    }
}

/// A replay of a board that is moved about in Calgary.
fn moved_about(place: &str) -> Ran {
    replay(&moving(Scenario::Free), Some("2026-11-21T12:00:00Z"), place)
}

/// All that was learnt.
fn calibrations(ran: &Ran) -> Vec<Value> {
    of_class(&ran.lines(), "CALIBRATION")
}

/// When each heading was published, the heading, and its deviation.
fn deviations(ran: &Ran) -> Vec<[f64; 3]> {
    let of = |att: &Value| {
        let number = |key: &str| att[key].as_f64();
        Some([number("t_s")?, number("mheading")?, number("heading_sd")?])
    };
    ran.lines().iter().filter_map(of).collect()
}

#[test]
fn a_place_makes_headings_more_certain_and_is_not_in_what_is_learnt() {
    let (nowhere, calgary) = (moved_about(""), moved_about(CALGARY));
    assert_eq!(calgary.err, "");
    let learnt = calibrations(&nowhere);
    assert!(!learnt.is_empty());
    assert_eq!(calibrations(&calgary), learnt);
    let (without, with) = (deviations(&nowhere), deviations(&calgary));
    assert!(with.len() >= without.len());
    let gained: Vec<f64> = without
        .iter()
        .filter_map(|[t_s, _, without_deg]| {
            let [.., with_deg] = with.iter().find(|[at_s, ..]| at_s == t_s)?;
            // The place also corrects the tilt, and that changes the deviation a little where X is steep.
            let most_deg = without_deg * 1.02 + 0.011;
            assert!(*with_deg <= most_deg, "{t_s} s: {with_deg} {without_deg}");
            Some(without_deg - with_deg)
        })
        .collect();
    // The two deviations of one heading may be on either side of the limit for publishing.
    assert!(gained.len() + 1 >= without.len());
    assert!(gained.iter().sum::<f64>() > 0.0);
    assert!(gained.iter().any(|gained_deg| *gained_deg > 0.05));
}

#[test]
fn a_place_that_the_field_contradicts_is_told_and_left_out() {
    let nowhere = moved_about("");
    let singapore = moved_about("[true_north]\nlatitude_deg = 1.3\nlongitude_deg = 103.8\n");
    let told: Vec<&str> = singapore.err.lines().collect();
    assert_eq!(told.len(), 1, "{told:?}");
    assert!(
        told[0].contains("the field does not match the position"),
        "{told:?}"
    );
    assert!(told[0].ends_with("look for iron nearby"), "{told:?}");
    let kerguelen = moved_about("[true_north]\nlatitude_deg = -49.3\nlongitude_deg = 70\n");
    assert!(
        kerguelen.err.contains("Up and down are exchanged"),
        "{kerguelen:?}"
    );
    // At once: before a heading would be good.
    let states = |ran: &Ran| {
        let of = |state: &Value| state["reason"].as_str().map(str::to_owned);
        (of_class(&ran.lines(), "STATE").iter().filter_map(of)).collect::<Vec<_>>()
    };
    let told = states(&kerguelen);
    assert!(told.contains(&"reversed_field".to_owned()), "{told:?}");
    assert!(!told.contains(&"good".to_owned()), "{told:?}");
    assert!(states(&nowhere).contains(&"good".to_owned()));
    assert_eq!(calibrations(&singapore), calibrations(&nowhere));
    let (without, with) = (deviations(&nowhere), deviations(&singapore));
    let last = without.len() / 2;
    assert_eq!(with[with.len() - last..], without[without.len() - last..]);
}

#[test]
fn field_prints_what_the_model_says_and_how_well_it_knows() {
    let place = ["--lat", "51.08", "--lon", "-114.13", "--alt", "1100"];
    let of = |more: &[&str]| headingd(&[&["field"], &place[..], more].concat());
    let ran = of(&["--date", "2026-11-21", "--json"]);
    assert_eq!((ran.status, ran.err.as_str()), (0, ""));
    let found = ran.json();
    for (key, right) in [
        ("declination_deg", 13.3),
        ("declination_sd_deg", 0.42),
        ("dip_deg", 72.82),
        ("total_mgauss", 551.3),
        ("horizontal_mgauss", 162.82),
    ] {
        assert!(
            (found[key].as_f64().unwrap() - right).abs() < 0.011,
            "{key}: {found}"
        );
    }
    assert_eq!(
        (&found["date"], &found["warning"]),
        (&"2026-11-21".into(), &Value::Null)
    );
    // A value that is published with WMM2025: far south, and at an altitude of 100 km.
    let place = ["--lat", "-80", "--lon", "-120", "--alt", "100000"];
    let found = headingd(&[&["field"], &place[..], &["--date", "2027-07-02", "--json"]].concat());
    let found = found.json();
    for (key, right) in [
        ("declination_deg", 67.93),
        ("dip_deg", -72.10),
        ("total_mgauss", 518.257),
        ("horizontal_mgauss", 159.27),
    ] {
        let off = found[key].as_f64().unwrap() - right;
        assert!(off.abs() < 0.011, "{key}: {found}");
    }
    let ran = of(&["--date", "2026-11-21"]);
    assert!(
        ran.out.contains("13.30 ± 0.42°, magnetic north is east"),
        "{}",
        ran.out
    );
    for (more, status, part) in [
        (&["--date", "2030-01-01"][..], 3, "2029-12-31"),
        (&["--date", "yesterday"], 2, "2026-11-21"),
        (&["--lat", "95"], 2, "cannot be used multiple times"),
    ] {
        let ran = of(more);
        assert_eq!((ran.status, ran.out.as_str()), (status, ""), "{more:?}");
        assert!(ran.err.contains(part), "{}", ran.err);
    }
}
