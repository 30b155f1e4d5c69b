//! `headingd simulate`: writes the log of a simulated board.

use std::path::PathBuf;

use crate::check::{Check, Fault};
use crate::command::{Failure, OrFail, config_file, overwrite, word, write_out};
use crate::recording::written;
use crate::sensor::simulator::{Scenario, Settings, Simulator};

/// Write the log of a simulated compass board
///
/// The log holds what a real board would have recorded: a magnetometer with hard iron bias, scale
/// factors and noise, a gyro with bias, and an accelerometer. Its first lines say the true parameters,
/// so that you can compare what a calibration finds. The same options always give the same log.
#[derive(Clone, Debug, clap::Args)]
#[command(allow_negative_numbers = true)]
pub struct Args {
    /// File to write; an existing one is replaced. "-" is standard output
    #[arg(long, value_name = "LOG")]
    pub out: PathBuf,

    /// How the board moves: level turns; rolls after them (spatial); tumbling that shows the field from all sides (free);
    /// changes of heading and tilt after level turns (demo)
    #[arg(long, value_parser = word::<Scenario>(&["planar", "spatial", "free", "demo"]), default_value = "planar")]
    pub scenario: Scenario,

    /// Number that fixes all noise; another one gives another log of the same motion
    #[arg(long, value_name = "N", default_value_t = Settings::default().seed)]
    pub seed: u64,

    /// Turns about the vertical, -100 to 100; negative is counter-clockwise. Not used by "free"
    #[arg(long, value_name = "N", default_value_t = Settings::default().turns)]
    pub turns: f64,

    /// Scale factors of the magnetometer's axes, 0.1 to 10; 1 is a perfect axis
    #[arg(long, value_name = "X,Y,Z", value_parser = three, default_value = "0.873,0.998,0.94")]
    pub scale: [f64; 3],

    /// Bias of the magnetometer's axes in milligauss, -2000 to 2000; 0 is a perfect axis
    #[arg(long, value_name = "X,Y,Z", value_parser = three, default_value = "87.28,54.19,135", allow_hyphen_values = true)]
    pub bias_mgauss: [f64; 3],

    /// Noise of each magnetometer axis in milligauss, one standard deviation, 0 to 1000
    #[arg(long, value_name = "N", default_value_t = Settings::default().noise_mgauss)]
    pub noise_mgauss: f64,

    /// Share of the magnetometer's samples with a spike of 200 mG on one axis, 0 to 0.5
    #[arg(long, value_name = "FRACTION", default_value_t = Settings::default().spikes)]
    pub spikes: f64,

    /// Leave the gyro out
    #[arg(long)]
    pub no_gyro: bool,

    /// Leave the accelerometer out
    #[arg(long)]
    pub no_accel: bool,
}

/// Faults as the user wrote them: `--noise-mgauss`, not `noise_mgauss`.
fn options(faults: &[Fault]) -> String {
    let as_options = faults.iter().map(|fault| {
        let key = format!("--{}", fault.key.replace('_', "-"));
        let fault = fault.clone();
        Fault { key, ..fault }.to_string()
    });
    as_options.collect::<Vec<_>>().join("; ")
}

fn three(text: &str) -> Result<[f64; 3], String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|n| n.trim().parse()).collect();
    numbers
        .ok()
        .and_then(|numbers| numbers.try_into().ok())
        .ok_or_else(|| "three numbers are needed, with commas and no spaces: 1,0.9,1.1".to_owned())
}

pub fn run(args: &Args) -> Result<(), Failure> {
    let settings = Settings {
        scenario: args.scenario,
        seed: args.seed,
        turns: args.turns,
        scale: args.scale,
        bias_mgauss: args.bias_mgauss,
        noise_mgauss: args.noise_mgauss,
        spikes: args.spikes,
        with_gyro: !args.no_gyro,
        with_accel: !args.no_accel,
        ..Settings::default()
    };
    let faults = settings.check();
    if !faults.is_empty() {
        let message = format!("cannot simulate: {}", options(&faults));
        return Err(Failure::new(Failure::USAGE, message));
    }
    overwrite::refuse(
        &args.out,
        None,
        None,
        &config_file::load(None).unwrap_or_default(),
    )?;
    let simulator = Simulator::new(settings);
    let log =
        written(&simulator.header(), simulator).or_fail(Failure::IO, "cannot write the log")?;
    write_out(&args.out, &log)
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::Path;

    use clap::Parser;

    use super::*;
    use crate::sensor::replay::Replay;

    #[derive(Parser)]
    struct SimulateCli {
        #[command(flatten)]
        args: Args,
    }

    fn args(out: &Path, more: &[&str]) -> Result<Args, clap::Error> {
        let out = out.to_str().unwrap();
        let words = ["simulate", "--out", out]
            .into_iter()
            .chain(more.iter().copied());
        SimulateCli::try_parse_from(words).map(|cli| cli.args)
    }

    #[test]
    fn without_options_the_log_is_that_of_the_default_settings() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("a.csv");
        run(&args(&out, &[]).unwrap()).unwrap();
        let simulator = Simulator::new(Settings::default());
        let mut replay = Replay::open(&out).unwrap();
        assert_eq!(replay.header(), &simulator.header());
        for (read, made) in replay.by_ref().zip(simulator) {
            assert_eq!(read.unwrap().reading, made.reading);
        }
        assert_eq!(replay.skips().summary(), None);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn options_reach_the_simulated_board() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("a.csv");
        let more = "--scenario spatial --turns -1 --bias-mgauss -5,0,2.5 --scale 1,1,1 --no-gyro";
        let more: Vec<&str> = more.split(' ').collect();
        run(&args(&out, &more).unwrap()).unwrap();
        let replay = Replay::open(&out).unwrap();
        let truth = &replay.header().truth;
        assert!(truth.contains(&("truth_bias_mgauss".into(), "-5 0 2.5".into())));
        assert!(truth.contains(&("simulated".into(), "spatial".into())));
        let mut readings = replay.map(|entry| entry.unwrap().reading);
        let first = readings.next().unwrap();
        assert!(first.rate_rad_s.is_none() && first.specific_force_m_s2.is_some());
    }

    #[test]
    fn wrong_options_say_what_is_right() {
        let out = Path::new("unused.csv");
        for scenario in ["planar", "spatial", "free", "demo"] {
            args(out, &["--scenario", scenario]).unwrap();
        }
        assert!(args(out, &["--scale", "1,2"]).is_err());
        assert!(args(out, &["--scenario", "round"]).is_err());
        let error = run(&args(out, &["--spikes", "0.9"]).unwrap()).unwrap_err();
        assert_eq!(
            error.to_string(),
            "cannot simulate: --spikes is 0.9, but must be from 0 to 0.5"
        );
    }
}
