//! `headingd config`: checks a configuration, or shows the settings that it comes to.

use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

use clap::Subcommand;

use super::{Failure, OrFail, config_file, print, tell};
use crate::calibration;
use crate::calibration::settings::Profile;
use crate::config::Config;
use crate::config::source::{Kind, Settings};
use crate::frame::{Mounting, Mountings};
use crate::sensor::replay::refuse_folder;
use crate::true_north::TrueNorth;
use crate::wall_clock;

/// Samples of a turn, about.
const SAMPLES: u64 = 250;

/// Particles times iterations that take about a second: on a fast machine less, on a small board more.
const MOST_WORK: u64 = 10_000_000;

/// Check a configuration file or show the effective settings
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    #[command(subcommand)]
    pub action: ConfigAction,
}

#[derive(Clone, Debug, Subcommand)]
pub enum ConfigAction {
    /// Check a file and list every fault in it. What has no effect, or is not there yet, is a warning
    Check(ConfigFile),
    /// Print all settings as TOML, with the defaults of those that the file leaves out; where there is no file, the defaults
    Show(ConfigFile),
}

#[derive(Clone, Debug, clap::Args)]
pub struct ConfigFile {
    /// The configuration file [default: $HEADINGD_CONFIG, else /etc/headingd/headingd.toml]
    file: Option<PathBuf>,
    /// The same file, named as for other commands
    #[arg(long, value_name = "FILE", conflicts_with = "file")]
    config: Option<PathBuf>,
}

impl ConfigFile {
    fn named(&self) -> Option<&Path> {
        self.file.as_deref().or(self.config.as_deref())
    }
}

pub fn run(args: &Args) -> Result<(), Failure> {
    match &args.action {
        ConfigAction::Check(file) => {
            let file = config_file::path(file.named());
            let config = config_file::read(&file)?;
            for warning in warnings(&config) {
                tell(format_args!("{}: warning: {warning}", file.display()));
            }
            let verdict = match config.source.kind {
                Some(_) => "good",
                None => "good, once source.kind is set",
            };
            print(&format!("{}: {verdict}\n", file.display()))
        }
        ConfigAction::Show(file) => {
            let config = config_file::load(file.named())?;
            print(&shown(&config)?)
        }
    }
}

/// Settings that are valid but probably not intended.
fn warnings(config: &Config) -> Vec<String> {
    let mut warnings = config.retired.clone();
    if config.source.kind.is_none() {
        warnings.push(Settings::UNSET.to_owned());
    }
    warnings.extend(mountings_without_effect(config));
    warnings.extend(stale_between_samples(config));
    warnings.extend(long_calibration(&config.calibration));
    warnings.extend(match config.source.kind {
        Some(Kind::Replay) => unreadable_log(&config.source.log),
        _ => unreliable_declination(config),
    });
    warnings
}

/// Warns of a place where the model's declination is missing or inaccurate today.
fn unreliable_declination(config: &Config) -> Option<String> {
    let mut north = TrueNorth::new(&config.true_north);
    north.declination_deg(wall_clock::now());
    north.news()
}

/// Warns of a log that cannot be replayed.
fn unreadable_log(log: &Path) -> Option<String> {
    let error = std::fs::File::options()
        .read(true)
        // A pipe that nobody writes to yet would be waited for.
        .custom_flags(libc::O_NONBLOCK)
        .open(log)
        .and_then(|file| refuse_folder(&file.metadata()?))
        .err()?;
    let from = match std::env::current_dir() {
        Ok(folder) if log.is_relative() => format!(" from {}", folder.display()),
        _ => String::new(),
    };
    let log = log.display();
    Some(format!("source.log: cannot read {log}{from}: {error}"))
}

/// Warns of a magnetometer that measures so seldom that the state is stale before the next sample.
fn stale_between_samples(config: &Config) -> Option<String> {
    let (key, rate_hz) = match config.source.kind? {
        Kind::I2c => ("i2c.rate_hz", config.i2c.rate_hz),
        Kind::Simulator => ("simulator.mag_rate_hz", config.simulator.mag_rate_hz),
        Kind::Serial | Kind::Replay => return None,
    };
    let (stale_s, least_s) = (config.heading.stale_s, 1.5 / rate_hz);
    (stale_s < least_s).then(|| {
        let right_s = (10.0 * least_s).ceil() / 10.0;
        format!(
            "with {key} = {rate_hz}, headings may be stale between two samples: set heading.stale_s, which is {stale_s}, to \
             {right_s:.1} or more"
        )
    })
}

/// Warns of a swarm that may keep a board busy for many seconds.
fn long_calibration(settings: &calibration::settings::Settings) -> Option<String> {
    // The paper's profile sums over all samples for each particle.
    let cost = match settings.profile {
        Profile::Standard => 1,
        Profile::Paper => SAMPLES,
    };
    let steps = settings.particles as u64 * settings.max_iterations as u64;
    let work = steps * cost;
    (work > MOST_WORK).then(|| {
        format!(
            "calibration.particles times calibration.max_iterations is {steps}: a calibration may take {} s or more, a reload gives it up, \
             and with source.speed above 1 headings wait for it",
            work / MOST_WORK
        )
    })
}

/// Warns of chips' axes that the source does not use.
fn mountings_without_effect(config: &Config) -> Option<String> {
    let set = config.mounting.chips();
    let (used, why) = match config.source.kind? {
        Kind::Serial => return None,
        Kind::I2c => (
            config.i2c.board.mountings(&set),
            "headingd knows how the chips of i2c.board are mounted; leave them out (board_axes turns the whole board), or \
             set i2c.board = \"custom\"",
        ),
        Kind::Simulator => (
            Mountings::default(),
            "the simulated board says itself how its chips are mounted; leave them out",
        ),
        Kind::Replay => (
            Mountings::default(),
            "the log says itself how its chips are mounted; leave them out",
        ),
    };
    let chips = [
        ("mag_axes", set.mag, used.mag),
        ("gyro_axes", set.gyro, used.gyro),
        ("accel_axes", set.accel, used.accel),
    ];
    let without_effect = chips
        .iter()
        .filter(|(_, set, used)| *set != Mounting::default() && set != used);
    let keys: Vec<&str> = without_effect.map(|(key, ..)| *key).collect();
    let keys = keys.join(", ");
    (!keys.is_empty()).then(|| format!("no effect of {keys} in [mounting]: {why}"))
}

fn shown(config: &Config) -> Result<String, Failure> {
    toml::to_string(config).or_fail(Failure::CONFIG, "cannot write the settings as TOML")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(file: PathBuf) -> Result<(), Failure> {
        run(&Args {
            action: ConfigAction::Check(ConfigFile {
                file: Some(file),
                config: None,
            }),
        })
    }

    #[test]
    fn a_file_that_is_too_long_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.toml");
        std::fs::write(&file, "#".repeat((1 << 20) + 1)).unwrap();
        let failure = check(file).unwrap_err();
        assert_eq!(failure.status, Failure::CONFIG);
        assert!(failure.message.contains("longer than 1 MiB"), "{failure}");
    }

    #[test]
    fn what_has_no_effect_or_is_not_there_is_a_warning() {
        let folder = tempfile::tempdir().unwrap();
        let log = folder.path().join("a.csv");
        let replay = format!("[source]\nkind = \"replay\"\nlog = {log:?}\n");
        let folder_as_log = "[source]\nkind = \"replay\"\nlog = \"/\"\n".to_owned();
        let board = "[source]\nkind = \"i2c\"\n[i2c]\nboard = \"gy-85\"\n";
        let mounted = format!("{board}[mounting]\nmag_axes = \"+x -y -z\"\n");
        let custom = mounted.replace("gy-85", "custom");
        let axes = "mag_axes = \"+y -x +z\"\ngyro_axes = \"+y -x +z\"\n";
        let gy_271 = board.replace("gy-85", "gy-271") + "[mounting]\n" + axes;
        let simulated = "[source]\nkind = \"simulator\"\n[mounting]\ngyro_axes = \"+y -x +z\"\n";
        let of = |text: &str| warnings(&Config::parse("a.toml", text).unwrap());
        for (text, part) in [
            (&replay, "a.csv: No such file"),
            (&folder_as_log, "cannot read /: is a directory"),
            (&mounted, "no effect of mag_axes in [mounting]"),
            (&gy_271, "no effect of mag_axes in [mounting]"),
            (
                &simulated.to_owned(),
                "no effect of gyro_axes in [mounting]",
            ),
        ] {
            let found = of(text);
            assert!(
                found.len() == 1 && found[0].contains(part),
                "{text}\n{found:?}"
            );
            let file = folder.path().join("a.toml");
            std::fs::write(&file, text).unwrap();
            check(file).unwrap();
        }
        let old = format!("{board}[heading]\nmisfit_s = 60.0\n");
        assert!(of(&old)[0].starts_with("line 6: heading.misfit_s no longer exists"));
        let long = of(&format!(
            "{board}[calibration]\nparticles = 1000\nmax_iterations = 100000\n"
        ));
        assert!(long[0].contains("may take 10 s"), "{long:?}");
        let paper = of(&format!(
            "{board}[calibration]\nprofile = \"paper\"\nstop = \"basic\"\n"
        ));
        assert!(paper.is_empty(), "{paper:?}");
        let seldom = of(&format!("{board}rate_hz = 1\n"));
        assert!(seldom[0].contains("set heading.stale_s"), "{seldom:?}");
        let uneven = format!("{board}rate_hz = 0.7\n");
        assert!(of(&uneven)[0].ends_with("to 2.2 or more"));
        assert!(of(&format!("{uneven}[heading]\nstale_s = 2.2\n")).is_empty());
        let pole = format!("{board}[true_north]\nlatitude_deg = 86\nlongitude_deg = 139\n");
        assert!(of(&pole)[0].contains("near a magnetic pole"));
        let turned =
            format!("{board}[mounting]\nboard_axes = \"-x -y +z\"\nheading_offset_deg = 3\n");
        assert!(of(board).is_empty() && of(&custom).is_empty() && of(&turned).is_empty());
        assert_eq!(of("[i2c]\nbus = 2"), [Settings::UNSET]);
        std::fs::write(&log, "").unwrap();
        assert!(of(&replay).is_empty());
    }

    #[test]
    fn what_is_shown_can_be_read_again() {
        let config =
            Config::parse("a.toml", "[source]\nspeed = 7\n[log]\nfilter = \"warn\"").unwrap();
        let text = shown(&config).unwrap();
        assert_eq!(Config::parse("b.toml", &text).unwrap(), config);
    }
}
