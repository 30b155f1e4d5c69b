//! Who may import whom, held against the source.
//!
//! Arrows point down: a room imports rooms on its own floor or below it, never above. Floors 0 and 1 know
//! no file, no socket, no thread, no clock and no global randomness; time, seeds and bytes come to them as
//! arguments. That is what lets the whole daemon be tested from a log.

mod programs;
mod source;
mod structure;

use std::fmt;

use source::{paths, sources, tokens};

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
    room("frozen", 0, &["reading"]),
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
    // Raw readings go out with the header and in the columns of a log.
    room("publish", 2, &["heading", "condition", "frame", "calibration", "reading", "recording", "lock_file"]),
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

/// What is wrong, and where.
struct Breach {
    file: String,
    line: usize,
    what: String,
}

impl fmt::Display for Breach {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}: {}", self.file, self.line, self.what)
    }
}

#[test]
fn every_room_imports_only_what_it_may() {
    let mut breaches = Vec::new();
    for (file, text) in program() {
        breaches.extend(imports(&file, &text));
    }
    assert_none(&breaches);
}

#[test]
fn floors_0_and_1_know_nothing_of_the_outside() {
    let mut breaches = Vec::new();
    for (file, text) in program() {
        breaches.extend(outside(&file, &text));
    }
    assert_none(&breaches);
}

#[test]
fn no_file_is_too_long() {
    let breaches: Vec<Breach> = sources("src")
        .iter()
        .filter_map(|(file, text)| too_long(file, text))
        .collect();
    assert_none(&breaches);
}

#[test]
fn the_table_points_down_and_never_in_a_circle() {
    for room in ROOMS {
        for name in room.may {
            let other = find(head(name)).unwrap_or_else(|| panic!("{name} is no room"));
            assert!(
                other.floor <= room.floor,
                "{} (floor {}) may import {name} (floor {}): arrows point down",
                room.name,
                room.floor,
                other.floor
            );
            let mut seen = Vec::new();
            reach(other, &mut seen);
            assert!(
                !seen.contains(&room.name),
                "{} and {name} import each other",
                room.name
            );
        }
    }
}

#[test]
fn a_wrong_line_is_found_and_explained() {
    let one = |file: &str, text: &str| {
        let found: Vec<String> = imports(file, text)
            .iter()
            .chain(&outside(file, text))
            .map(Breach::to_string)
            .collect();
        found.join("\n")
    };
    assert_eq!(
        one("src/turn/chain.rs", "\nuse crate::publish::gpsd;\n"),
        "src/turn/chain.rs:2: turn imports publish::gpsd, but may import only check, frame, attitude"
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
        assert_eq!(
            one(file, text).lines().count(),
            1,
            "{file}: {text}\n{}",
            one(file, text)
        );
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
            "/* crate::store /* */ tokio */ const A: &str = \"crate::store \\\" tokio\";",
        ),
        (
            "src/turn.rs",
            "const A: &str = r#\"crate::store \" println!\"#; const B: char = '\"'; fn f<'a>() {}",
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
        assert_eq!(one(file, text), "", "{file}: {text}");
    }
    let long = "\n".repeat(MOST_LINES + 1);
    assert!(
        too_long("src/turn.rs", &long).is_some() && too_long("src/turn.rs", &long[1..]).is_none()
    );
}

/// The source without the files that hold a room's tests: those may do what they like.
fn program() -> impl Iterator<Item = (String, String)> {
    sources("src")
        .into_iter()
        .filter(|(file, _)| !file.ends_with("/tests.rs"))
}

fn imports(file: &str, text: &str) -> Vec<Breach> {
    let breach = |line, what| Breach {
        file: file.to_owned(),
        line,
        what,
    };
    let (name, depth) = place(file);
    let Some(room) = find(name) else {
        let what = format!(
            "{name} is a new room: give it a floor and its imports in tests/layering/main.rs"
        );
        return vec![breach(1, what)];
    };
    let mut found = Vec::new();
    for (line, path) in paths(&tokens(text)) {
        // `super` often enough is `crate`.
        let supers = path.iter().take_while(|part| *part == "super").count();
        let inside = match path[0].as_str() {
            "crate" | "headingd" => &path[1..],
            "super" if supers >= depth => &path[supers..],
            _ => continue,
        };
        let target = inside.join("::");
        let own = inside.first().is_none_or(|first| first == name);
        let under = |rule: &str| target == rule || target.starts_with(&format!("{rule}::"));
        if own || under(EVERYBODY_MAY) || room.may.iter().any(|rule| under(rule)) {
            continue;
        }
        let may: Vec<&str> = [EVERYBODY_MAY].iter().chain(room.may).copied().collect();
        found.push(breach(
            line,
            format!(
                "{name} imports {target}, but may import only {}",
                may.join(", ")
            ),
        ));
    }
    found
}

fn outside(file: &str, text: &str) -> Vec<Breach> {
    let (name, _) = place(file);
    if find(name).is_none_or(|room| room.floor > 1) {
        return Vec::new();
    }
    let tokens = tokens(text);
    let mut found = Vec::new();
    for (line, path) in paths(&tokens) {
        let path = path.join("::");
        if OUTSIDE
            .iter()
            .any(|rule| path == *rule || path.starts_with(&format!("{rule}::")))
        {
            found.push((line, path));
        }
    }
    for (at, (line, word)) in tokens.iter().enumerate() {
        let prints = PRINTING.contains(&word.as_str())
            && tokens.get(at + 1).is_some_and(|next| next.1 == "!");
        let named =
            OUTSIDE_NAMES.contains(&word.as_str()) && !found.iter().any(|(found, _)| found == line);
        if prints || named {
            found.push((*line, word.clone()));
        }
    }
    let explain = |(line, word)| Breach {
        file: file.to_owned(),
        line,
        what: format!(
            "{name} uses {word}, but floors 0 and 1 know no file, socket, thread, clock, \
                       global randomness or terminal: take it as an argument"
        ),
    };
    found.into_iter().map(explain).collect()
}

fn too_long(file: &str, text: &str) -> Option<Breach> {
    let line = text.lines().count();
    let what = format!(
        "the file has {line} lines, at most {MOST_LINES} are allowed: split it by its jobs"
    );
    (line > MOST_LINES).then(|| Breach {
        file: file.to_owned(),
        line,
        what,
    })
}

fn find(name: &str) -> Option<&'static Room> {
    ROOMS.iter().find(|room| room.name == name)
}

fn head(path: &str) -> &str {
    path.split("::").next().unwrap_or(path)
}

/// All rooms that one leads to, by name; a circle ends where it closes.
fn reach(room: &'static Room, seen: &mut Vec<&'static str>) {
    if !seen.contains(&room.name) {
        seen.push(room.name);
        for name in room.may {
            reach(find(head(name)).expect("named in the table"), seen);
        }
    }
}

/// The room that a file belongs to, and how many `super` lead out of the crate's top.
fn place(file: &str) -> (&str, usize) {
    let path = file.strip_prefix("src/").unwrap_or(file);
    let path = path.strip_suffix(".rs").unwrap_or(path);
    let path = path.strip_suffix("/mod").unwrap_or(path);
    let parts: Vec<&str> = path.split('/').collect();
    (parts[0], parts.len())
}

fn assert_none(breaches: &[impl ToString]) {
    let lines: Vec<String> = breaches.iter().map(ToString::to_string).collect();
    assert!(lines.is_empty(), "\n{}\n", lines.join("\n"));
}
