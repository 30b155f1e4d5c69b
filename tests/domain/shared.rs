//! What more than one test program needs: the program, and a calibration of which no more is known.

use std::process::{Command, Stdio};

use headingd::calibration::model::{Calibration, Parameters};

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

pub fn calibration(
    parameters: Parameters,
    strength_mgauss: f64,
    residual_mgauss: f64,
    heading_sd_deg: f64,
) -> Calibration {
    Calibration {
        parameters,
        reference_mgauss: None,
        strength_mgauss,
        residual_mgauss,
        heading_sd_deg,
        covariance: None,
        gyro_bias_deg_s: None,
        accel_bias_m_s2: None,
    }
}
