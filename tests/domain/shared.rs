//! What more than one test program needs: the program, and angles.

use std::process::{Command, Stdio};

/// The program, ready for arguments. It reads nothing and finds no settings in the environment.
pub fn program() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_headingd"));
    command
        .stdin(Stdio::null())
        .env_remove("RUST_LOG")
        .env_remove("HEADINGD_CONFIG");
    command
}

/// Runs a command to its end: exit status, standard output and standard error.
pub fn finished(command: &mut Command) -> (i32, String, String) {
    let output = command.output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    let (out, err) = (text(output.stdout), text(output.stderr));
    (output.status.code().expect("a signal"), out, err)
}

/// How far one angle is from another, degrees.
pub fn apart_deg(one: f64, other: f64) -> f64 {
    (one - other + 540.0).rem_euclid(360.0) - 180.0
}
