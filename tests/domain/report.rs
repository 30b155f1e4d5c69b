//! `headingd report`: one page with every figure, that needs nothing else.

use std::fs;

use crate::common::{Folder, headingd, log, moving, simulated, turning};
use headingd::sensor::simulator::{Scenario, Settings};
use serde_json::Value;

/// Runs the command on a simulated board, and gives back the page.
fn page(settings: Settings, config: &str) -> String {
    let folder = Folder::new();
    let (log, out) = (
        folder.log("turn.csv", &settings),
        folder.path("report.html"),
    );
    let config = folder.file("a.toml", config);
    let ran = headingd(&["report", &log, "--out", &out, "--config", &config]);
    assert_eq!((ran.status, ran.out.as_str()), (0, ""), "{}", ran.err);
    fs::read_to_string(out).unwrap()
}

/// The text of a row of the first table.
fn row<'a>(page: &'a str, name: &str) -> Option<&'a str> {
    let (_, row) = page.split_once(&format!("<tr><th>{name}</th><td>"))?;
    Some(row.split_once("</td>")?.0)
}

/// What the turn's fit gives is accepted; then the pipeline finds that it knows better.
#[test]
fn the_verdict_on_a_turn_is_the_last_one() {
    let settings = moving(Scenario::Demo);
    let page = page(settings, "");
    let (_, section) = page
        .split_once("<h2>Calibration by a full turn</h2>")
        .unwrap();
    let kept = "<p><b class=good>not needed: what was known is more certain</b> (less_certain)";
    assert!(section.trim_start().starts_with(kept), "{section:.300}");
}

#[test]
fn a_known_place_gives_true_headings_as_in_a_replay() {
    let folder = Folder::new();
    let (mut header, entries) = simulated(&Settings::default());
    let undated = folder.file("undated.csv", log(&(header.clone(), entries.clone())));
    let day = (
        "recorded_from".to_owned(),
        "2026-11-21T10:00:00Z".to_owned(),
    );
    header.truth.push(day);
    let dated = folder.file("dated.csv", log(&(header, entries)));
    let place = "[true_north]\nlatitude_deg = 51.08\nlongitude_deg = -114.13\n";
    let config = folder.file("a.toml", place);
    let report = |log: &str| headingd(&["report", log, "--out", "-", "--config", &config]).out;

    let found = report(&dated);
    assert_self_contained(&found);
    assert_eq!(
        row(&found, "declination"),
        Some("13.3°, magnetic north is east of true north")
    );
    assert_eq!(row(&found, "warning"), None);
    assert!(found.contains("<b class=other>true</b>"));
    let replayed = headingd(&["replay", &dated, "--config", &config]).lines();
    let steers = |line: &&Value| line.get("mheading").is_some();
    let newest = replayed.iter().rev().find(steers).unwrap();
    let number = |key: &str| newest[key].as_f64().unwrap();
    let right = format!(
        "{:05.1}° magnetic, {:05.1}° true ± ",
        number("mheading"),
        number("heading")
    );
    let found = row(&found, "last heading").unwrap();
    assert!(found.starts_with(&right), "{found}, not {right}");

    let found = report(&undated);
    assert_eq!(row(&found, "declination"), None);
    assert!(!found.contains("<b class=other>true</b>"));
    let warning = row(&found, "warning").unwrap();
    assert!(
        warning.contains("no true headings: the date is not known"),
        "{warning}"
    );
}

#[test]
fn a_log_whose_time_jumps_back_is_as_long_as_its_stretches_together() {
    let folder = Folder::new();
    let (header, entries) = simulated(&Settings::default());
    let once_s = entries.last().unwrap().reading.t_s;
    let twice = [entries.clone(), entries].concat();
    let twice = folder.file("twice.csv", log(&(header, twice)));
    let page = headingd(&["report", &twice, "--out", "-"]).out;
    let length = row(&page, "length").unwrap();
    let (length_s, _) = length.split_once(" s").unwrap();
    assert!(length_s.parse::<f64>().unwrap() > 2.0 * once_s, "{length}");
}

/// It loads nothing, runs nothing, and has no number that is none.
fn assert_self_contained(page: &str) {
    let bare = page.replace("http://www.w3.org/2000/svg", "");
    for strange in [
        "http", "<script", "src=", "url(", "@import", "NaN", "inf\"", ">inf<",
    ] {
        assert!(!bare.contains(strange), "{strange} is in the page");
    }
    for tag in ["figure", "table", "svg", "main", "details"] {
        let count = |text: &str| page.matches(text).count();
        assert_eq!(
            count(&format!("<{tag}>")) + count(&format!("<{tag} ")),
            count(&format!("</{tag}>")),
            "{tag}"
        );
    }
    assert!(page.contains("prefers-color-scheme:dark"));
}

#[test]
fn an_accepted_turn_has_every_figure() {
    let one_turn = turning(1.1);
    let page = page(one_turn, "");
    assert_self_contained(&page);
    assert_eq!(page.matches("<figure>").count(), 8, "planar: one circle");
    for part in [
        "heading, degrees",
        "uncertainty, degrees",
        "time, seconds",
        "chip axis X, milligauss",
        "raw field, milligauss",
        "fitness, milligauss squared",
        "field less gyro, degrees",
        "deviation, degrees",
        "<b class=good>accepted</b>",
        "Deviation card, degrees",
        "coverage of the circle",
        "outliers among the last samples",
        "RIST's windows",
        "1000 iterations",
    ] {
        assert!(page.contains(part), "{part} is missing");
    }
    assert!(!page.contains("Calibration by motion"));
    // The card: what was off by tens of degrees is right within one.
    let row = |name: &str| -> Vec<f64> {
        let row = page.split_once(&format!("<tr><th>{name}</th>")).unwrap().1;
        let row = row.split_once("</tr>").unwrap().0;
        let cells = row
            .split("<td>")
            .filter_map(|cell| cell.split("</td>").next()?.parse().ok());
        cells.collect()
    };
    let most = |row: &[f64]| row.iter().fold(0.0, |most: f64, cell| most.max(cell.abs()));
    let (before, after) = (row("before"), row("after"));
    assert_eq!((before.len(), after.len()), (12, 12));
    assert!(
        most(&before) > 20.0 && most(&after) < 1.0,
        "{before:?} {after:?}"
    );
}

#[test]
fn a_refused_turn_says_what_broke_which_limit_and_what_to_do() {
    let page = page(Settings::default(), "[verdict]\nresidual_share = 0.001\n");
    assert_self_contained(&page);
    for part in [
        "<b class=bad>rejected</b> (residual)",
        "What to do: turn on the spot, away from iron",
        "<th>residual, of the field</th>",
        "<b class=bad>broken</b>",
        "<th>after, by the rejected fit</th>",
        "Calibration by motion",
    ] {
        assert!(page.contains(part), "{part} is missing");
    }
    // What was fitted is shown all the same.
    assert_eq!(page.matches("<figure>").count(), 8);
}

#[test]
fn space_has_three_circles_and_motion_none() {
    let spatial = moving(Scenario::Spatial);
    let found = page(spatial, "");
    assert_self_contained(&found);
    assert_eq!(found.matches("<svg").count(), 10);
    assert!(found.contains("spread of the field"));
    let still = turning(0.0);
    let found = page(still, "");
    assert_self_contained(&found);
    assert_eq!(found.matches("<figure>").count(), 2);
    assert!(found.contains("No full turn has calibrated"));
}

#[test]
fn a_log_without_a_full_turn_has_the_verdict_of_calibrate() {
    let free = Settings {
        scenario: Scenario::Free,
        turns: 0.5,
        ..Settings::default()
    };
    let part = turning(250.0 / 360.0);
    for (settings, verdict, limit) in [(part, "rejected", "broken"), (free, "accepted", "kept")] {
        let folder = Folder::new();
        let log = folder.log("a.csv", &settings);
        let config = folder.file("a.toml", "");
        let outcome = headingd(&["calibrate", &log, "--json", "--config", &config]).json();
        assert_eq!(outcome["method"], "motion", "{outcome}");
        assert_eq!(outcome["verdict"], verdict);
        let found = page(settings, "");
        assert_self_contained(&found);
        let section = found.split_once("Calibration by motion").unwrap().1;
        let reason = outcome["reason"].as_str().unwrap();
        let message = outcome["message"].as_str().unwrap();
        assert!(
            section.contains(&format!("{verdict}</b> ({reason}): {message}")),
            "{section}"
        );
        let row = section
            .split_once("predicted heading uncertainty")
            .unwrap()
            .1;
        let sd_deg = outcome["heading_sd_deg"].as_f64().unwrap();
        let right = format!("{sd_deg:.2} degrees</td><td>at most</td><td>3.00 degrees</td>");
        assert!(row.contains(&right), "{row}");
        assert!(row.split_once("</tr>").unwrap().0.contains(limit), "{row}");
    }
}
