//! The commands that show a running daemon, and those that wait for it.

mod monitor;
mod readme;
mod usual;
mod wait;
mod watch;

use std::process::{Command, Output};

/// Runs the program to its end: exit status, standard output and standard error.
fn headingd(variables: &[(&str, &str)], arguments: &[&str]) -> (i32, String, String) {
    let Output {
        status,
        stdout,
        stderr,
    } = Command::new(env!("CARGO_BIN_EXE_headingd"))
        .args(arguments)
        .env_remove("HEADINGD_CONFIG")
        .envs(variables.iter().copied())
        .output()
        .unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (status.code().unwrap(), text(stdout), text(stderr))
}
