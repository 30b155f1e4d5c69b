//! What README and docs/ show, run or at least understood.

use std::fs;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use clap::Parser;
use clap::error::ErrorKind;
use headingd::command::cli::Cli;

use crate::rig::{ENDLESS, FAST, LONG, Rig, finished, not_run, program};

const README: &str = include_str!("../../../README.md");

/// What a test cannot do: these need hardware, the superuser, the network or a screen, or belong to others.
const NOT_RUN: &[&str] = &[
    "sudo",
    "i2cdetect",
    "cargo",
    "(printf",
    "headingd check",
    "headingd run",
    "headingd monitor",
];

/// The fenced blocks of a language.
fn blocks(text: &str, language: &str) -> Vec<String> {
    let begin = format!("```{language}\n");
    let blocks = text.split(begin.as_str()).skip(1);
    let own = blocks.filter_map(|rest| Some(rest.split_once("```")?.0.to_owned()));
    own.collect()
}

/// The commands of all blocks for a shell, without their remarks.
fn commands(text: &str) -> Vec<String> {
    let blocks = blocks(text, "sh");
    let lines = blocks.iter().flat_map(|block| block.lines());
    let bare = lines.map(|line| {
        line.split(" # ")
            .next()
            .unwrap_or_default()
            .trim()
            .to_owned()
    });
    bare.filter(|line| !line.is_empty()).collect()
}

fn pages() -> Vec<(PathBuf, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let docs = fs::read_dir(root.join("docs")).unwrap();
    let files = docs
        .map(|entry| entry.unwrap().path())
        .chain([root.join("README.md")]);
    let pages = files.filter(|file| file.extension().is_some_and(|name| name == "md"));
    pages
        .map(|file| (file.clone(), fs::read_to_string(file).unwrap()))
        .collect()
}

#[test]
fn every_command_that_readme_shows_does_what_it_should() {
    // A board that turns all the time, so that a turn is never waited for.
    let rig = Rig::new(FAST, LONG);
    let (_process, mut client) = rig.watched();
    client.accepted();
    let config = rig.path("headingd.toml");
    let mut run = 0;
    for command in commands(README) {
        if NOT_RUN.iter().any(|prefix| command.starts_with(prefix)) {
            continue;
        }
        let mut words: Vec<&str> = command.split_whitespace().collect();
        assert_eq!(words.remove(0), "headingd", "{command}: what is it?");
        if words[0] == "watch" {
            words.extend(["--count", "2"]);
        }
        // A minute of the board's time.
        if let Some(duration) = words.iter_mut().find(|word| **word == "60") {
            *duration = "3";
        }
        let mut program = program();
        program.args(&words).current_dir(rig.folder.path());
        let (status, printed, said) = finished(program.env("HEADINGD_CONFIG", &config));
        assert_eq!(status, 0, "{command}: {said}{printed:.300}");
        run += 1;
    }
    assert!(run >= 8, "{run}");
    assert!(fs::metadata(rig.path("report.html")).unwrap().len() > 10_000);
}

#[test]
fn the_python_of_readme_prints_headings() {
    let Ok(_) = Command::new("python3").arg("--version").output() else {
        not_run("there is no python3");
        return;
    };
    let rig = Rig::new(FAST, ENDLESS);
    let (_process, mut client) = rig.watched();
    client.heading();
    let program = &blocks(README, "python")[0];
    let usual = "/run/headingd/heading.sock";
    assert!(program.contains(usual));
    let program = program.replace(usual, rig.path("heading.sock").to_str().unwrap());
    let mut python = Command::new("python3")
        .args(["-u", "-c", &program])
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(python.stdout.take().unwrap()).lines();
    // While it learns, and where the machine is slow, a sample may have none.
    let heading = lines.by_ref().take(5000).find_map(|line| {
        let line = line.unwrap();
        let (heading, state) = line.split_once(' ').unwrap();
        assert!(heading != "None" || state != "good", "{line}");
        heading.parse::<f64>().ok()
    });
    python.kill().unwrap();
    python.wait().unwrap();
    assert!((0.0..360.0).contains(&heading.unwrap()), "{heading:?}");
}

/// Commands in blocks, and in code within a sentence or a table.
#[test]
fn every_command_of_every_page_is_one() {
    let mut found = 0;
    for (file, text) in pages() {
        let spans = text.split('`').skip(1).step_by(2).map(str::to_owned);
        let spans = spans.filter(|span| !span.contains('\n') && !span.contains('…'));
        for command in commands(&text).into_iter().chain(spans) {
            let Some(first) = command
                .split('|')
                .next()
                .filter(|it| it.starts_with("headingd "))
            else {
                continue;
            };
            found += 1;
            let words: Vec<&str> = first.trim_end_matches('\\').split_whitespace().collect();
            if let Err(error) = Cli::try_parse_from(&words) {
                let unfinished = matches!(
                    error.kind(),
                    ErrorKind::DisplayHelp
                        | ErrorKind::DisplayVersion
                        | ErrorKind::MissingSubcommand
                        | ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand
                        | ErrorKind::MissingRequiredArgument
                );
                let about_others = words.contains(&"COMMAND");
                assert!(
                    unfinished || about_others,
                    "{}: {first}: {error}",
                    file.display()
                );
            }
        }
    }
    assert!(found > 30, "{found}");
}

/// Nothing is linked that is not there.
#[test]
fn every_link_leads_somewhere() {
    for (file, text) in pages() {
        for target in text
            .split("](")
            .skip(1)
            .filter_map(|rest| rest.split(')').next())
        {
            let (path, anchor) = target.split_once('#').unwrap_or((target, ""));
            if path.contains("://") {
                continue;
            }
            let to = if path.is_empty() {
                file.clone()
            } else {
                file.parent().unwrap().join(path)
            };
            let name = file.display();
            let page = fs::read_to_string(&to).unwrap_or_else(|_| panic!("{name}: {target}"));
            let anchors: Vec<String> = page
                .lines()
                .filter(|line| line.starts_with('#'))
                .map(|line| {
                    let line = line.trim_start_matches('#').trim().to_lowercase();
                    let kept = line
                        .chars()
                        .filter(|c| c.is_alphanumeric() || " -_".contains(*c));
                    kept.map(|c| if c == ' ' { '-' } else { c }).collect()
                })
                .collect();
            assert!(
                anchor.is_empty() || anchors.iter().any(|it| it == anchor),
                "{name}: {target}"
            );
        }
    }
}
