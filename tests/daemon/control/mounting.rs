//! Telling a daemon how its board is mounted.

use headingd::config::Config;
use headingd::recording::Entry;
use headingd::sensor::simulator::{Settings, Simulator};
use serde_json::{Value, json};

use super::link::Link;
use crate::rig::{FAST, LONG, Rig, apart_deg, headingd, log};

/// Ten minutes of a board that lies still and points north, its nose 10° up, as the source of a configuration.
fn still(rig: &Rig) -> String {
    let simulator = Simulator::new(Settings {
        tilt_deg: 10.0,
        ..Settings::default()
    });
    let header = simulator.header();
    let rest: Vec<Entry> = simulator
        .take_while(|entry| entry.reading.t_s < 3.0)
        .collect();
    let entries = (0..200).flat_map(|round| {
        rest.iter().map(move |entry| {
            let mut later = *entry;
            later.reading.t_s += 3.0 * f64::from(round);
            later
        })
    });
    let still = rig.path("still.csv");
    std::fs::write(&still, log(&header, entries)).unwrap();
    format!("kind = \"replay\"\nlog = {still:?}\n")
}

fn number(message: &Value, key: &str) -> f64 {
    message[key]
        .as_f64()
        .unwrap_or_else(|| panic!("{key}: {message}"))
}

/// The first headings after a start are not exact.
const MOST_DEG: f64 = 5.0;

fn is_near(att: &Value, right_deg: f64) -> bool {
    apart_deg(number(att, "mheading"), right_deg).abs() < MOST_DEG
}

#[test]
fn level_and_ahead_are_kept_until_the_configuration_says_otherwise() {
    let rig = Rig::new(FAST, &format!("{LONG}tilt_deg = 10\n"));
    let (mut process, mut client) = rig.watched();
    client.accepted();
    let mut link = Link::new(&rig);
    link.refused(json!({"request": "mounting", "level": true}), "moving");
    link.refused(json!({"request": "mounting", "heading_deg": 200}), "moving");
    let answer = link.told("mounting");
    assert_eq!(
        (&answer["board_axes"], &answer["from"]),
        (&json!("+x +y +z"), &json!("configuration"))
    );
    process.stop();

    let still = still(&rig);
    rig.configure(1.0, &rig.path("store"), &still);
    let (mut process, mut client) = rig.watched();
    let mut link = Link::new(&rig);
    let steered = |att: &Value| att.get("mheading").is_some();
    let before = client.heading();
    assert!(
        (number(&before, "pitch") - 10.0).abs() < 1.0 && is_near(&before, 0.0),
        "{before}"
    );
    let number_before = link.told("list")["in_force"].clone();
    let answer = link.ask(&json!({"request": "mounting", "level": true}));
    assert_eq!(
        (&answer["ok"], &answer["from"]),
        (&json!(true), &json!("store")),
        "{answer}"
    );
    let level = client.find("ATT", |att| {
        steered(att) && number(att, "pitch").abs() < 2.0
    });
    assert!(is_near(&level, 0.0), "{level}");
    let answer = link.ask(&json!({"request": "mounting", "heading_deg": 200}));
    assert_eq!(answer["ok"], true, "{answer}");
    let ahead = client.find("ATT", |att| steered(att) && is_near(att, 200.0));
    assert!(number(&ahead, "pitch").abs() < 2.0, "{ahead}");
    let kept = link.told("mounting")["board_axes"].clone();
    // It is shown as the configuration takes it.
    let (status, shown, err) = headingd(&["mounting", "--socket", &rig.text("control.sock")]);
    assert_eq!(status, 0, "{err}");
    let (_, line) = shown.trim_end().split_once('\n').unwrap();
    let config = Config::parse("shown", &format!("[mounting]\n{line}")).unwrap();
    assert_eq!(config.mounting.board().to_string(), kept);
    // A report on the daemon has the board mounted so, too.
    let socket = rig.text("heading.sock");
    let (status, page, err) = headingd(&[
        "report",
        "--socket",
        &socket,
        "--duration",
        "2",
        "--out",
        "-",
    ]);
    assert_eq!(status, 0, "{err}");
    let (_, row) = page.split_once("<tr><th>last heading</th><td>").unwrap();
    let (heading, _) = row.split_once('°').unwrap();
    let off_deg = apart_deg(heading.parse().unwrap(), 200.0);
    assert!(off_deg.abs() < MOST_DEG, "{heading}");
    process.signal("KILL");
    process.wait();

    // What was told is on disk, and the calibration is the same.
    let mut process = rig.start();
    let mut client = rig.client();
    let again = client.heading();
    assert!(number(&again, "pitch").abs() < 2.0, "{again}");
    assert!(is_near(&again, 200.0), "{again}");
    let mut link = Link::new(&rig);
    assert_eq!(link.told("mounting")["board_axes"], kept);
    assert_eq!(link.told("list")["in_force"], number_before);

    // What is changed in the configuration after that holds, over a reload and a restart.
    let changed = format!("{still}[mounting]\nheading_offset_deg = 45\n");
    rig.configure(1.0, &rig.path("store"), &changed);
    process.signal("HUP");
    let tilted = client.find("ATT", |att| steered(att) && number(att, "pitch") > 5.0);
    assert!(is_near(&tilted, 45.0), "{tilted}");
    process.says("[mounting] has changed");
    assert_eq!(link.told("mounting")["from"], "configuration");
    process.stop();

    // As it was, the daemon is told to forget it.
    rig.configure(1.0, &rig.path("store"), &still);
    let mut process = rig.start();
    let mut link = Link::new(&rig);
    assert_eq!(link.told("mounting")["board_axes"], kept);
    let answer = link.ask(&json!({"request": "mounting", "reset": true}));
    assert_eq!(answer["from"], "configuration", "{answer}");
    rig.client()
        .find("ATT", |att| steered(att) && number(att, "pitch") > 9.0);
    process.stop();
    let text = std::fs::read_to_string(rig.path("store/calibration.json")).unwrap();
    assert!(text.contains("\"headingd_store\": 2"), "{text}");
}

#[test]
fn without_an_accelerometer_and_a_heading_nothing_can_be_told() {
    let rig = Rig::new(1.0, "[simulator]\nwith_accel = false\n");
    let (_process, mut client) = rig.watched();
    client.find("ATT", |_| true);
    let mut link = Link::new(&rig);
    link.refused(json!({"request": "mounting", "level": true}), "no_tilt");
    link.refused(
        json!({"request": "mounting", "heading_deg": 1}),
        "no_heading",
    );
}
