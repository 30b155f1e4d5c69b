//! `headingd calibrate`: one calibration of a log, offline.

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::builder::{PossibleValuesParser, TypedValueParser};

use super::read_log::{read_log_on, tell_dropped, tell_skips};
use super::wording::plain_text;
use super::{
    Failure, config_file, number, overwrite, print, print_json, tell, word, write_calibrations,
};
use crate::calibration::calibrate;
use crate::calibration::outcome::{Outcome, Verdict};
use crate::calibration::policy::CalibrationOrigin;
use crate::calibration::settings::{ModeChoice, ModelChoice, Profile, StopChoice, WindowChoice};
use crate::calibration::verdict::Refusal;
use crate::config::Config;
use crate::frame::rounded;
use crate::pipeline::{EmptyAxis, Survey};
use crate::sensor::replay::Replay;
use crate::store::{CalibrationFile, CalibrationRecord, History, Identity};
use crate::wall_clock::unix_now_s;

/// Calibrate on a recorded log
///
/// Uses everything from the start of the first rotation to the end of the last; in a plane, only while the board is as level as
/// in its turns. Without a full turn that is level, or turns about two axes, it uses what the running estimate learns from all
/// motion in the log, if that is certain enough; it does the same where such turns are refused, unless a mode is named. With --plane,
/// --window all, or no gyro in the log, it fits the whole log. Exit status: 0 accepted, 3 refused.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Example: headingd calibrate turn.csv --reference-mgauss 163 --out here.json"
)]
pub struct Args {
    /// The log (`headingd simulate` writes one). "-" is standard input
    pub log: PathBuf,
    /// The plane of the turn, all three axes, or whichever the turns allow
    #[arg(long, value_parser = word::<ModeChoice>(ModeChoice::WORDS))]
    pub mode: Option<ModeChoice>,
    /// The shape of the scale factor matrix in space: `symmetric` takes in soft iron and cross-coupling,
    /// `auto` chooses it where the samples ask for it
    #[arg(long, value_parser = word::<ModelChoice>(ModelChoice::WORDS))]
    pub model: Option<ModelChoice>,
    /// The plane: from the gyro, or two chip axes, and then no turn is looked for
    #[arg(long, default_value = "gyro", value_parser = PossibleValuesParser::new(["gyro", "xy", "xz", "yz"]).map(plane))]
    pub plane: Plane,
    /// The swarm's coefficients: `standard` converges, `paper` is as published
    #[arg(long, value_parser = word::<Profile>(Profile::WORDS))]
    pub profile: Option<Profile>,
    /// The samples that the swarm sees: RIST's window, the turns, or all (and then all are fitted)
    #[arg(long, value_parser = word::<WindowChoice>(WindowChoice::WORDS))]
    pub window: Option<WindowChoice>,
    /// The swarm's stopping rule: MPSOT's three levels, or the maximum number of iterations and the minimum error alone
    #[arg(long, value_parser = word::<StopChoice>(StopChoice::WORDS))]
    pub stop: Option<StopChoice>,
    /// Strength of the field, milligauss: horizontal for a planar calibration, total for a spatial one. Without it,
    /// or where motion calibrates, the scale factors have a mean of 1
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    #[arg(value_parser = number("a number of milligauss", 10.0..=1000.0))]
    pub reference_mgauss: Option<f64>,
    /// Seed of the swarm
    #[arg(long, value_name = "N")]
    pub seed: Option<u64>,
    /// Configuration, for everything that has no option here [default: $HEADINGD_CONFIG, else /etc/headingd/headingd.toml, if there is one]
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Write an accepted calibration to this file (`headingd replay --calibration` reads it). "-" is standard output; the
    /// summary goes to standard error then
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Print one JSON object
    #[arg(long)]
    pub json: bool,
}

/// The chip axes that span it; none where the gyro tells. An alias hides the `Option` from clap, which would take it for an argument
/// that may be missing.
pub type Plane = Option<[usize; 2]>;

fn plane(word: String) -> Plane {
    match word.as_str() {
        "xy" => Some([0, 1]),
        "xz" => Some([0, 2]),
        "yz" => Some([1, 2]),
        _ => None,
    }
}

pub fn run(args: &Args) -> Result<(), Failure> {
    let config = settings(args)?;
    if args.plane.is_some() && config.calibration.mode == ModeChoice::Spatial {
        return Err(Failure::new(
            Failure::USAGE,
            "a plane is named, but the mode is spatial: leave out --plane, or set another --mode",
        ));
    }
    let to_standard_output = args.out.as_deref() == Some(Path::new("-"));
    if to_standard_output && args.json {
        return Err(Failure::new(
            Failure::USAGE,
            "--json and --out - both want standard output: name a file",
        ));
    }
    if let Some(out) = &args.out {
        overwrite::refuse(out, Some(&args.log), args.config.as_deref(), &config)?;
    }
    let (identity, outcome) = calibrated(args, &config)?;
    let written = match (&args.out, outcome.calibration) {
        (Some(path), Some(calibration)) => {
            let record =
                CalibrationRecord::of(&outcome, calibration, CalibrationOrigin::Log, unix_now_s());
            write_calibrations(path, &CalibrationFile::of(History::of(identity, record)))
        }
        _ => Ok(()),
    };
    if args.json {
        print_json(&outcome)?;
    } else if to_standard_output {
        tell(summary(&outcome).trim_end());
    } else {
        print(&summary(&outcome))?;
    }
    match outcome.verdict {
        Verdict::Accepted => written,
        // Standard output has said why.
        _ => Err(Failure::new(Failure::REFUSED, "")),
    }
}

/// The configuration, with the options laid over it.
fn settings(args: &Args) -> Result<Config, Failure> {
    let mut config = config_file::load(args.config.as_deref())?;
    let settings = &mut config.calibration;
    settings.mode = args.mode.unwrap_or(settings.mode);
    settings.model = args.model.unwrap_or(settings.model);
    settings.profile = args.profile.unwrap_or(settings.profile);
    settings.window = args.window.unwrap_or(settings.window);
    settings.stop = args.stop.unwrap_or(settings.stop);
    settings.seed = args.seed.unwrap_or(settings.seed);
    if let Some(reference) = args.reference_mgauss {
        (settings.horizontal_mgauss, settings.total_mgauss) = (Some(reference), Some(reference));
    }
    Ok(config)
}

/// The log's sensor, and what comes of a calibration on all of it.
fn calibrated(args: &Args, config: &Config) -> Result<(Identity, Outcome), Failure> {
    let mut replay = Replay::open(&args.log)?;
    let header = replay.header();
    let identity = Identity::new(header.sensor_name(), header.mountings.mag);
    let setup = config.setup(&header.mountings, &config.mounting.board());
    let mut survey = Survey::new(setup, args.plane);
    read_log_on(&mut replay, |entry, begins_stretch| {
        survey.take(&entry.reading, begins_stretch);
        Ok(())
    })?;
    tell_dropped(&survey.dropped());
    tell_skips(&replay)?;
    if let Some((reason, message)) = survey.fault() {
        tell(format_args!("at the end of the log: {message} ({reason})"));
    }
    let empty_axis = survey.empty_axis();
    let thinned_to = survey.thinned_to();
    let outcome = survey.conclude(|request| {
        if let Some(samples) = thinned_to {
            tell(format_args!(
                "the log is long: {samples} of its samples are used, those of turns first"
            ));
        }
        let begun = Instant::now();
        calibrate(request).with_elapsed(begun.elapsed())
    });
    let outcome = outcome.ok_or_else(|| {
        let message = format!(
            "{} has no gyro readings that can be used, so nothing tells the plane of a turn: check its columns and units, add \
             --mode spatial, or name the plane with --plane xy, xz or yz",
            args.log.display()
        );
        Failure::new(Failure::USAGE, message)
    })?;
    Ok((identity, because_empty(outcome, empty_axis)))
}

/// The outcome; one that was rejected names the empty axis, if there is one, as its reason: other faults may follow from it.
fn because_empty(outcome: Outcome, empty_axis: Option<EmptyAxis>) -> Outcome {
    let Some(empty) = empty_axis.filter(|_| outcome.verdict == Verdict::Rejected) else {
        return outcome;
    };
    let EmptyAxis {
        axis,
        empty,
        samples,
    } = empty;
    let name = ["X", "Y", "Z"][axis];
    let message = format!("chip axis {name} is empty in {empty} of {samples} samples");
    let refusal = if empty < samples {
        let remedy = "check the chip, choose a larger range, or move away from the magnet";
        let message = format!("{message}, stuck, or at the end of its range: {remedy}");
        Refusal::new("stuck_axis", message)
    } else {
        let others = ["yz", "xz", "xy"][axis];
        let remedy = format!("--plane {others}, without --mode spatial");
        let message = format!("{message}: name a plane whose two axes have numbers: {remedy}");
        Refusal::new("no_plane", message)
    };
    outcome.refused(refusal)
}

/// What the motion did not show, in words.
fn unseen(code: &str) -> &str {
    match code {
        "across_plane" => "bias and scale factor across the plane of the turn",
        "soft_iron" => "soft iron",
        other => other,
    }
}

fn summary(outcome: &Outcome) -> String {
    let list = |numbers: &[f64], digits: usize| {
        let words: Vec<String> = numbers.iter().map(|n| format!("{n:.digits$}")).collect();
        words.join("  ")
    };
    let Outcome {
        reason, message, ..
    } = outcome;
    let mut text = plain_text(outcome.verdict.word(), reason, message) + "\n";
    if let (Some(bias_mgauss), Some(scale)) = (&outcome.bias_mgauss, &outcome.scale) {
        let unit = match (outcome.reference_mgauss, outcome.method) {
            (Some(_), _) => "",
            (None, "motion") => "  (mean 1)",
            (None, _) => "  (mean 1: no reference was given)",
        };
        text += &format!("bias    {}  milligauss\n", list(bias_mgauss, 2));
        text += &format!("scale   {}{unit}\n", list(scale, 4));
    }
    if let Some([e1, e2]) = outcome.basis {
        text += &format!(
            "plane   ({:.3} {:.3} {:.3}) and ({:.3} {:.3} {:.3}) in chip axes\n",
            e1[0], e1[1], e1[2], e2[0], e2[1], e2[2]
        );
    }
    if let Some(turned_deg) = outcome.alignment_deg {
        let [x, y, z] = turned_deg.map(|degrees| rounded(degrees, 1));
        text += &format!(
            "turned  {x:.1}  {y:.1}  {z:.1}  degrees, from the gyro's axes to the magnetometer's\n"
        );
    }
    if let (false, Some(_)) = (outcome.unobserved.is_empty(), &outcome.bias_mgauss) {
        let words: Vec<&str> = outcome.unobserved.iter().copied().map(unseen).collect();
        text += &format!("unseen  {}\n", words.join("; "));
    }
    if let (Some(window), Some(swarm)) = (&outcome.window, &outcome.swarm) {
        text += &format!(
            "swarm   {} particles, {} iterations ({}), samples {} to {} of {}\n",
            swarm.particles,
            swarm.iterations,
            swarm.stop,
            window.start,
            window.end,
            outcome.samples.total
        );
    }
    text
}
