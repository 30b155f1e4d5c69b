//! The configuration files that go with the program, held against the code.

use std::fs;
use std::path::{Path, PathBuf};

use headingd::config::Config;

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("config")
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
    let text = fs::read_to_string(folder().join("headingd.toml")).unwrap();
    assert_eq!(Config::parse("", &text).unwrap(), Config::default());
}
