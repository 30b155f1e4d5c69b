//! Who may import whom, held against the source.
//!
//! Arrows point down: a room imports rooms on its own floor or below it, never above. Floors 0 and 1 know
//! no file, no socket, no thread, no clock and no global randomness; time, seeds and bytes come to them as
//! arguments. That is what lets the whole daemon be tested from a log.

mod programs;
mod source;
mod structure;

use source::{imports, module, paths, sources, tokens};
use structure::{Imports, circles};

/// Think again at 300 lines, split at 400; this is where the test puts its foot down.
const MOST_LINES: usize = 450;

/// A file or folder right under `src/`.
struct Room {
    name: &'static str,
    floor: u8,
    /// Rooms, or parts of rooms (`calibration::model`), that it may import.
    may: &'static [&'static str],
}

const fn room(name: &'static str, floor: u8, may: &'static [&'static str]) -> Room {
    Room { name, floor, may }
}

/// On floor 0 and imported by whoever has settings or words: how they are declared, and what a fault in a setting is.
const EVERYBODY_MAY: &str = "check";

#[rustfmt::skip]
const ROOMS: &[Room] = &[
    room("check", 0, &[]),
    room("reading", 0, &[]),
    // Told times of day; it asks no clock.
    room("date", 0, &[]),
    room("advice", 0, &[]),
    room("true_north", 0, &["date"]),
    room("frame", 0, &[]),
    room("outliers", 0, &["reading"]),
    room("frozen", 0, &["frame", "reading"]),
    room("alignment", 0, &["reading", "frame"]),
    // The words for the state; the pipeline decides which one applies.
    room("condition", 0, &[]),
    room("attitude", 0, &["reading", "frame"]),
    room("turn", 0, &["frame", "attitude"]),
    // A sample carries the pose that the gyro gave it: the verdict is held against it.
    room("calibration", 0, &["reading", "frame", "turn", "attitude"]),
    // The condition is published with each heading.
    room("heading", 0, &["condition"]),
    // Starts from a calibration, and gives one to keep; the place's field is evidence.
    room("estimate", 0, &["attitude", "calibration::model", "frame", "reading", "true_north"]),

    room("recording", 1, &["reading", "frame", "date"]),
    // Joins all of floor 0 into one journey.
    room("pipeline", 1, &[
        "reading", "outliers", "frozen", "frame", "attitude", "turn", "calibration", "estimate", "heading", "condition",
        "true_north",
    ]),

    // A live source reports its faults.
    room("sensor", 2, &["reading", "frame", "recording", "condition"]),
    // Raw readings go out with the header and in the columns of a log; who changed what is never left out of the log.
    room("publish", 2, &["heading", "condition", "frame", "calibration", "reading", "recording", "lock_file", "logging"]),
    // Reads where the compass is from a gpsd.
    room("position", 2, &["true_north", "date"]),
    // The mounting is kept with the calibration: the one holds only with the other.
    room("store", 2, &["calibration", "frame", "lock_file"]),
    // The daemon's own pipeline, and pictures of what comes of it.
    room("report", 2, &[
        "advice", "reading", "frame", "calibration", "condition", "pipeline", "recording", "true_north",
    ]),
    // Sockets and stores are one process's at a time.
    room("lock_file", 2, &[]),
    room("logging", 2, &[]),
    room("wall_clock", 2, &["date"]),
    // Tells systemd the condition.
    room("service", 2, &["condition"]),
    // One table for each room that has settings.
    room("config", 2, &[
        "frame", "attitude", "turn", "calibration", "true_north", "pipeline", "position", "sensor", "publish",
        "store", "logging",
    ]),

    room("daemon", 3, &[
        "reading", "date", "frame", "calibration", "true_north", "condition", "recording", "pipeline", "position", "sensor", "publish", "store", "service", "config", "lock_file", "wall_clock",
    ]),
    room("command", 3, &[
        "date", "frame", "alignment", "calibration", "true_north", "heading", "recording", "pipeline", "position", "sensor", "publish", "store", "service", "logging", "config", "daemon",
        "wall_clock", "advice", "report",
    ]),
    room("main", 3, &["command"]),
    // The table of contents: it declares the rooms and imports none.
    room("lib", 3, &[]),
];

/// Paths that floors 0 and 1 do without.
const OUTSIDE: &[&str] = &[
    "std::fs",
    "std::net",
    "std::thread",
    "std::env",
    "std::process",
    "std::os",
    "std::time::Instant",
    "std::time::SystemTime",
    "tokio",
    "rand::rng",
    "rand::random",
];

/// Names that give the same away when the path was cut in two (`use std::time; time::Instant`).
const OUTSIDE_NAMES: &[&str] = &["Instant", "SystemTime", "thread_rng", "ThreadRng", "SysRng"];

const PRINTING: &[&str] = &["print", "println", "eprint", "eprintln", "dbg"];

#[test]
fn every_room_imports_only_what_it_may() {
    assert_none(program().flat_map(|(file, text)| strangers(&file, &text)));
}

#[test]
fn floors_0_and_1_know_nothing_of_the_outside() {
    assert_none(program().flat_map(|(file, text)| outside(&file, &text)));
}

#[test]
fn no_file_is_too_long() {
    let lines = |text: &str| text.lines().count();
    let too_long = |(_, text): &(String, String)| lines(text) > MOST_LINES;
    let told = |(file, text): (String, String)| {
        let lines = lines(&text);
        format!("{file}: {lines} lines, at most {MOST_LINES} are allowed: split it by its jobs")
    };
    assert_none(sources("src").into_iter().filter(too_long).map(told));
}

#[test]
fn the_table_points_down_and_never_in_a_circle() {
    let mut table = Imports::new();
    for room in ROOMS {
        let names = room.may.iter().map(|path| path.split("::").next().unwrap());
        for name in names.clone() {
            let floor = find(name).expect(name).floor;
            let points_down = floor <= room.floor;
            assert!(points_down, "{} may not import {name}", room.name);
        }
        table.insert(room.name.to_owned(), names.map(str::to_owned).collect());
    }
    assert_eq!(circles(table), Imports::new());
}

#[test]
fn a_wrong_line_is_found_and_explained() {
    let found = |file: &str, text: &str| [strangers(file, text), outside(file, text)].concat();
    assert_eq!(
        found("src/turn/chain.rs", "\nuse crate::publish::gpsd;\n"),
        [
            "src/turn/chain.rs:2: turn imports publish::gpsd, but may import only check, frame, attitude"
        ]
    );
    for (file, text) in [
        ("src/turn.rs", "use crate::{frame::wrap_360, store};"),
        ("src/turn.rs", "fn f() { crate::store::open() }"),
        ("src/turn.rs", "use super::store;"),
        ("src/turn/chain.rs", "use super::super::{frame, store};"),
        (
            "src/estimate/heading.rs",
            "use crate::calibration::{model::Spatial, verdict};",
        ),
        ("src/command/run.rs", "use crate::nowhere;"),
        ("src/main.rs", "use headingd::store::Store;"),
        ("src/garret.rs", "fn f() {}"),
        ("src/heading.rs", "use std::{fmt, fs};"),
        (
            "src/pipeline/settings.rs",
            "let t = std::time::Instant::now();",
        ),
        (
            "src/pipeline.rs",
            "use std::time; fn f() { time::SystemTime::now(); }",
        ),
        ("src/calibration/swarm.rs", "let mut rng = rand::rng();"),
        ("src/recording/read.rs", "println!(\"{}\", 1);"),
        (
            "src/turn.rs",
            "#[cfg(test)] mod tests { use crate::store; } use crate::store;",
        ),
    ] {
        let found = found(file, text);
        assert_eq!(found.len(), 1, "{file}: {text}\n{found:?}");
    }
    for (file, text) in [
        (
            "src/turn/chain.rs",
            "use super::Settings; use crate::attitude::{self, BoardMotion}; use crate::check::Check;",
        ),
        (
            "src/turn.rs",
            "use crate::turn::chain; // use crate::store;",
        ),
        (
            "src/turn.rs",
            "const A: &str = \"crate::store \\\" tokio\";",
        ),
        (
            "src/turn.rs",
            "#[cfg(test)] mod tests { use crate::store; fn f() { println!(); } }",
        ),
        (
            "src/turn.rs",
            "#[cfg(test)]\n#[path = \"t.rs\"]\nmod tests;\nuse std::time::Duration;",
        ),
        ("src/store.rs", "use std::fs; fn f() { println!(); }"),
    ] {
        assert_eq!(found(file, text), [""; 0], "{file}: {text}");
    }
}

/// The source without the files that hold a room's tests: those may do what they like.
fn program() -> impl Iterator<Item = (String, String)> {
    let sources = sources("src").into_iter();
    sources.filter(|(file, _)| !file.ends_with("/tests.rs"))
}

/// What a file imports of rooms of which it may not.
fn strangers(file: &str, text: &str) -> Vec<String> {
    let name = &module(file)[0];
    let Some(room) = find(name) else {
        let what = "is a new room: give it a floor and its imports in tests/layering/main.rs";
        return vec![format!("{file}: {name} {what}")];
    };
    let may = [&[name, EVERYBODY_MAY][..], room.may].concat();
    let mut found = Vec::new();
    for (line, path) in imports(file, text) {
        let target = path.join("::");
        if !path.is_empty() && !may.iter().any(|rule| is_under(&target, rule)) {
            let may = may[1..].join(", ");
            let what = format!("{name} imports {target}, but may import only {may}");
            found.push(format!("{file}:{line}: {what}"));
        }
    }
    found
}

/// What a file on floor 0 or 1 uses of the outside.
fn outside(file: &str, text: &str) -> Vec<String> {
    let name = &module(file)[0];
    if find(name).is_none_or(|room| room.floor > 1) {
        return Vec::new();
    }
    let tokens = tokens(text);
    let paths = paths(&tokens).into_iter();
    let mut found: Vec<(usize, String)> = paths
        .map(|(line, path)| (line, path.join("::")))
        .filter(|(_, path)| OUTSIDE.iter().any(|rule| is_under(path, rule)))
        .collect();
    for pair in tokens.windows(2) {
        let (line, word) = &pair[0];
        let prints = PRINTING.contains(&word.as_str()) && pair[1].1 == "!";
        let named =
            OUTSIDE_NAMES.contains(&word.as_str()) && !found.iter().any(|(found, _)| found == line);
        if prints || named {
            found.push((*line, word.clone()));
        }
    }
    let explain = |(line, word)| {
        format!(
            "{file}:{line}: {name} uses {word}, but floors 0 and 1 know no file, socket, thread, clock, global randomness or \
             terminal: take it as an argument"
        )
    };
    found.into_iter().map(explain).collect()
}

fn is_under(path: &str, rule: &str) -> bool {
    path.strip_prefix(rule)
        .is_some_and(|rest| rest.is_empty() || rest.starts_with("::"))
}

fn find(name: &str) -> Option<&'static Room> {
    ROOMS.iter().find(|room| room.name == name)
}

fn assert_none(breaches: impl Iterator<Item = String>) {
    let lines: Vec<String> = breaches.collect();
    assert!(lines.is_empty(), "\n{}\n", lines.join("\n"));
}
