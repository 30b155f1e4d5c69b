//! Every test belongs to one of few programs.

use super::assert_none;
use super::source::{sources, tokens};

/// The folders under `tests/` that are programs. Each one is linked with the whole daemon, which takes longer than
/// to run it: few are better.
const PROGRAMS: &[&str] = &["daemon", "domain", "honesty", "layering", "soak"];

/// Nobody would notice that a file is not compiled, nor that there is a program more.
#[test]
fn every_test_is_in_one_of_the_programs() {
    let manifest = include_str!("../../Cargo.toml");
    let tests = sources("tests");
    let lost = tests
        .iter()
        .filter(|(file, _)| !manifest.contains(file.as_str()) && !is_compiled(file, &tests));
    assert_none(lost.map(|(file, _)| format!("{file}: no file of {PROGRAMS:?} declares it")));
}

/// Whether it is a program's first file, or another file of the program declares it.
fn is_compiled(file: &str, tests: &[(String, String)]) -> bool {
    let (folder, name) = file.strip_suffix(".rs").unwrap().rsplit_once('/').unwrap();
    let is_first = name == "main" && folder.matches('/').count() == 1;
    let above = [format!("{folder}/main.rs"), format!("{folder}.rs")];
    let declares = |text: &str| {
        let words: Vec<String> = tokens(text).into_iter().map(|token| token.1).collect();
        words.windows(3).any(|three| *three == ["mod", name, ";"])
    };
    let declared = |(other, text): &(String, String)| above.contains(other) && declares(text);
    let program = file.split('/').nth(1).unwrap();
    PROGRAMS.contains(&program) && (is_first || tests.iter().any(declared))
}

#[test]
fn a_test_in_no_program_is_found() {
    let tests = [
        ("tests/daemon/main.rs", "mod run; // mod lost;", true),
        ("tests/daemon/run.rs", "", true),
        ("tests/daemon/lost.rs", "", false),
        ("tests/daemon/more.rs", "mod deep;", false),
        ("tests/daemon/more/deep.rs", "", true),
        ("tests/alone.rs", "", false),
        ("tests/other/main.rs", "", false),
    ];
    let texts = tests.map(|(file, text, _)| (file.to_owned(), text.to_owned()));
    for (file, _, right) in tests {
        assert_eq!(is_compiled(file, &texts), right, "{file}");
    }
}
