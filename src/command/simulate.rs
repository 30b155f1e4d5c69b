//! `headingd simulate`: writes the log of a simulated board.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

use crate::check::Fault;
use crate::command::{Failure, word};
use crate::recording::Writer;
use crate::sensor::simulator::{Scenario, Settings, Simulator};

/// Write the log of a simulated compass board
///
/// The log holds what a real board would have recorded: a magnetometer with hard iron bias, scale
/// factors and noise, a gyro with bias, and an accelerometer. Its first lines say the true parameters,
/// so that you can compare what a calibration finds. The same options always give the same log.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// File to write; an existing one is replaced. "-" is standard output
    #[arg(long, value_name = "LOG")]
    pub out: PathBuf,

    /// How the board moves: level turns; rolls after them (spatial); tumbling that shows the field from all sides (free);
    /// small changes of heading and tilt after level turns (demo)
    #[arg(long, value_parser = word::<Scenario>(&["planar", "spatial", "free", "demo"]), default_value = "planar")]
    pub scenario: Scenario,

    /// Number that fixes all noise; another one gives another log of the same motion
    #[arg(long, value_name = "N", default_value_t = Settings::default().seed)]
    pub seed: u64,

    /// Turns about the vertical, -100 to 100; negative is counter-clockwise. Not used by "free"
    #[arg(long, value_name = "N", default_value_t = Settings::default().turns, allow_negative_numbers = true)]
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

/// Why no log was written.
#[derive(Debug, thiserror::Error)]
pub enum SimulateError {
    /// Options that do not go.
    #[error("cannot simulate: {}", options(.0))]
    Options(Vec<Fault>),
    /// The log could not be created or written.
    #[error("cannot write log {}: {source}", path.display())]
    Write {
        /// The path as given; `-` is standard output.
        path: PathBuf,
        /// What the system said.
        #[source]
        source: io::Error,
    },
}

/// Faults as the user wrote them: `--noise-mgauss`, not `noise_mgauss`.
fn options(faults: &[Fault]) -> String {
    let lines: Vec<String> = faults
        .iter()
        .map(|fault| {
            let option = format!("--{}", fault.key.replace('_', "-"));
            Fault {
                key: option,
                ..fault.clone()
            }
            .to_string()
        })
        .collect();
    lines.join("; ")
}

fn three(text: &str) -> Result<[f64; 3], String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|n| n.trim().parse()).collect();
    numbers
        .ok()
        .and_then(|numbers| numbers.try_into().ok())
        .ok_or_else(|| "three numbers are needed, with commas and no spaces: 1,0.9,1.1".to_owned())
}

impl From<SimulateError> for Failure {
    fn from(error: SimulateError) -> Self {
        let status = match error {
            SimulateError::Options(_) => Self::USAGE,
            SimulateError::Write { .. } => Self::CANNOT_CREATE,
        };
        Self::new(status, error)
    }
}

/// Runs the command.
///
/// # Errors
///
/// The options contradict each other, or the log cannot be written.
pub fn run(args: &Args) -> Result<(), Failure> {
    simulate(args).map_err(Failure::from)
}

fn simulate(args: &Args) -> Result<(), SimulateError> {
    let simulator = Simulator::new(Settings {
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
    })
    .map_err(SimulateError::Options)?;
    let written = if args.out == Path::new("-") {
        match write(simulator, io::stdout().lock()) {
            // The reader has seen enough: `| head`.
            Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
            written => written,
        }
    } else {
        write_file(simulator, &args.out)
    };
    written.map_err(|source| SimulateError::Write {
        path: args.out.clone(),
        source,
    })
}

fn write(simulator: Simulator, output: impl Write) -> io::Result<()> {
    let mut writer = Writer::new(BufWriter::new(output), &simulator.header())?;
    for entry in simulator {
        writer.write(&entry)?;
    }
    writer.into_inner()?.flush()
}

/// Writes beside the target and renames, so that there is never half a log under its name.
fn write_file(simulator: Simulator, path: &Path) -> io::Result<()> {
    // A link stays a link: what it points to is replaced.
    let target = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    if fs::metadata(&target).is_ok_and(|found| !found.is_file()) {
        // A device or a pipe is written to, not replaced; a directory fails here.
        let file = File::options().write(true).open(&target)?;
        return write(simulator, file);
    }
    let folder = match target.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    let mut options = File::options();
    // A log is nobody's secret; the umask still has its say.
    options.write(true).create_new(true).mode(0o666);
    // Errors of this and of the file below do not name it: the user has not.
    let file = tempfile::Builder::new()
        .prefix(".headingd-")
        .make_in(folder, |path| options.open(path))?;
    write(simulator, file.as_file())?;
    file.persist(&target).map_err(|error| error.error)?;
    Ok(())
}

#[cfg(test)]
mod tests {
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
        let simulator = Simulator::new(Settings::default()).unwrap();
        let mut replay = Replay::open(&out).unwrap();
        assert_eq!(replay.header(), &simulator.header());
        for (read, made) in replay.by_ref().zip(simulator) {
            assert_eq!(read.unwrap().reading, made.reading);
        }
        assert_eq!(replay.skips().count(), 0);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn options_reach_the_simulated_board() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("a.csv");
        let more = [
            "--scenario",
            "spatial",
            "--turns",
            "-1",
            "--bias-mgauss",
            "-5,0,2.5",
            "--scale",
            "1,1,1",
            "--no-gyro",
        ];
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
        assert!(args(out, &["--scale", "1,2"]).is_err());
        assert!(args(out, &["--scenario", "round"]).is_err());
        let error = run(&args(out, &["--spikes", "0.9"]).unwrap()).unwrap_err();
        assert_eq!(
            error.to_string(),
            "cannot simulate: --spikes is 0.9, but must be from 0 to 0.5"
        );
    }

    #[test]
    fn a_failed_write_leaves_nothing_behind() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("none/a.csv");
        let error = run(&args(&out, &[]).unwrap()).unwrap_err();
        let error = error.to_string();
        assert!(
            error.ends_with("none/a.csv: No such file or directory (os error 2)"),
            "{error}"
        );
        let error = run(&args(folder.path(), &[]).unwrap()).unwrap_err();
        assert_eq!(error.status, Failure::CANNOT_CREATE);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn a_device_is_not_replaced_and_a_link_stays_a_link() {
        let folder = tempfile::tempdir().unwrap();
        // A socket stands for all that is no file: it cannot be opened, so that this fails, but stays.
        let socket = folder.path().join("socket");
        let _listener = std::os::unix::net::UnixListener::bind(&socket).unwrap();
        assert!(run(&args(&socket, &[]).unwrap()).is_err());
        assert!(!fs::metadata(&socket).unwrap().is_file());
        let (file, link) = (folder.path().join("a.csv"), folder.path().join("link"));
        fs::write(&file, "old").unwrap();
        std::os::unix::fs::symlink(&file, &link).unwrap();
        run(&args(&link, &[]).unwrap()).unwrap();
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        assert!(
            fs::read_to_string(&file)
                .unwrap()
                .starts_with("# headingd-log 1")
        );
    }
}
