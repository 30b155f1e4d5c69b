//! Every test belongs to one of few programs.

use super::source::{sources, tokens};
use super::{Breach, assert_none};

/// The folders under `tests/` that are programs. Each one is linked with the whole daemon, which takes longer than
/// to run it: few are better.
const PROGRAMS: &[&str] = &["daemon", "domain", "honesty", "layering", "soak"];

#[test]
fn every_test_is_in_one_of_the_programs() {
    let manifest = include_str!("../../Cargo.toml");
    let tests = sources("tests");
    let breaches: Vec<Breach> = tests
        .iter()
        .filter(|(file, _)| !manifest.contains(file.as_str()))
        .filter_map(|(file, _)| in_no_program(file, &tests))
        .collect();
    assert_none(&breaches);
}

#[test]
fn a_test_in_no_program_is_found() {
    let tests: Vec<(String, String)> = [
        ("tests/daemon/main.rs", "mod run; // mod lost;"),
        ("tests/daemon/run.rs", ""),
        ("tests/daemon/lost.rs", ""),
        ("tests/daemon/more.rs", "mod deep;"),
        ("tests/daemon/more/deep.rs", ""),
        ("tests/alone.rs", ""),
        ("tests/other/main.rs", ""),
    ]
    .map(|(file, text)| (file.to_owned(), text.to_owned()))
    .into();
    let lost: Vec<&str> = tests
        .iter()
        .map(|(file, _)| file.as_str())
        .filter(|file| in_no_program(file, &tests).is_some())
        .collect();
    assert_eq!(
        lost,
        [
            "tests/daemon/lost.rs",
            "tests/daemon/more.rs",
            "tests/alone.rs",
            "tests/other/main.rs"
        ]
    );
}

/// Nobody would notice that a file is not compiled, nor that there is a program more.
fn in_no_program(file: &str, tests: &[(String, String)]) -> Option<Breach> {
    let (folder, name) = file.strip_suffix(".rs")?.rsplit_once('/')?;
    let program = file.split('/').nth(1)?;
    let name = Some(name).filter(|name| *name != "main" || folder.matches('/').count() > 1);
    let declares = |(other, text): &&(String, String)| {
        let words = tokens(text);
        [format!("{folder}/main.rs"), format!("{folder}.rs")].contains(other)
            && words
                .windows(3)
                .any(|three| three[0].1 == "mod" && Some(&*three[1].1) == name && three[2].1 == ";")
    };
    let known = PROGRAMS.contains(&program);
    if known && (name.is_none() || tests.iter().any(|test| declares(&test))) {
        return None;
    }
    let what = if known {
        format!(
            "no file declares it: add `mod {};`",
            name.unwrap_or_default()
        )
    } else {
        format!("move it into one of the programs {}", PROGRAMS.join(", "))
    };
    Some(Breach {
        file: file.to_owned(),
        line: 1,
        what,
    })
}
