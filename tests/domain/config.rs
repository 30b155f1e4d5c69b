//! The configuration files that go with the program, held against the code.

use std::fs;
use std::path::{Path, PathBuf};

use headingd::config::Config;

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("config")
}

fn default_file() -> String {
    fs::read_to_string(folder().join("headingd.toml")).unwrap()
}

#[test]
fn every_file_is_good() {
    let mut files = 0;
    for entry in fs::read_dir(folder()).unwrap() {
        let path = entry.unwrap().path();
        let text = fs::read_to_string(&path).unwrap();
        if let Err(error) = Config::parse(&path.display().to_string(), &text) {
            panic!("{error}");
        }
        files += 1;
    }
    assert!(files >= 3);
}

#[test]
fn the_default_file_says_every_default() {
    let text = default_file();
    let file: toml::Table = text.parse().unwrap();
    for table in Config::tables() {
        let found = file
            .get(table.name)
            .unwrap_or_else(|| panic!("config/headingd.toml has no table [{}]", table.name))
            .as_table()
            .unwrap();
        for key in table.keys {
            let name = format!("{}.{key}", table.name);
            match table.defaults.get(*key) {
                Some(default) => assert_eq!(
                    found.get(*key),
                    Some(default),
                    "{name} in config/headingd.toml (left) must be the default"
                ),
                // A key without a default cannot be written; it stands there as a comment.
                None => assert!(
                    section(&text, table.name)
                        .iter()
                        .any(|line| line.starts_with(&format!("#{key} = "))),
                    "{name} has no default, so config/headingd.toml must have a line #{key} = …"
                ),
            }
        }
    }
    assert_eq!(Config::parse("", &text).unwrap(), Config::default());
}

#[test]
fn the_default_file_explains_every_key() {
    let text = default_file();
    for table in Config::tables() {
        let lines = section(&text, table.name);
        for (index, line) in lines.iter().enumerate() {
            let is_key = table.keys.iter().any(|key| {
                line.trim_start_matches('#')
                    .starts_with(&format!("{key} = "))
            });
            assert!(
                !is_key || (index > 0 && lines[index - 1].starts_with("# ")),
                "[{}] {line}: the line before it must be a comment",
                table.name
            );
        }
    }
}

/// The lines of one table, without its header.
fn section<'t>(text: &'t str, name: &str) -> Vec<&'t str> {
    text.lines()
        .skip_while(|line| *line != format!("[{name}]"))
        .skip(1)
        .take_while(|line| !line.starts_with('['))
        .collect()
}
