//! `headingd replay`: a recorded log through the same pipeline as live readings, as fast as it goes.

use std::io::{self, BufWriter, StdoutLock, Write};
use std::path::{Path, PathBuf};

use super::read_log::{read_log, tell_dropped, tell_skips};
use super::{Failure, config_file, output, tell};
use crate::calibration::calibrate;
use crate::calibration::model::Calibration;
use crate::calibration::outcome::Outcome;
use crate::calibration::policy::CalibrationOrigin;
use crate::date;
use crate::heading::Heading;
use crate::pipeline::{Action, Event, Pipeline};
use crate::publish::gpsd::{self, Device, WatchPolicy};
use crate::recording::{TimeOfDay, UNKNOWN_SENSOR};
use crate::sensor::replay::Replay;
use crate::store::{CalibrationRecord, History, Identity, Store, StoreError};
use crate::true_north::TrueNorth;
use crate::wall_clock::unix_now_s;

/// Replay a recorded log, as fast as it goes
///
/// Prints the JSON lines that a client of the socket with every stream enabled gets: ATT for each
/// magnetometer reading, STATE for each change of condition or progress, CALIBRATION for each calibration. The same
/// log, configuration and seed give the same bytes; nothing is read from or written to a store unless
/// --store says so.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example: headingd replay turn.csv | grep CALIBRATION")]
pub struct Args {
    /// The log (`headingd simulate` writes one). "-" is standard input
    pub log: PathBuf,
    /// Configuration; its table source and the chips' axes are of no effect here [default: $HEADINGD_CONFIG, else /etc/headingd/headingd.toml, if
    /// there is one]
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Seed of the swarm, in place of the configuration's
    #[arg(long, value_name = "N")]
    pub seed: Option<u64>,
    /// Start with this calibration (`headingd calibrate --out` writes one)
    #[arg(long, value_name = "FILE")]
    pub calibration: Option<PathBuf>,
    /// Start with the calibration kept in this folder, and keep new ones there
    #[arg(long, value_name = "DIR", conflicts_with = "calibration")]
    pub store: Option<PathBuf>,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    let mut config = config_file::load(args.config.as_deref())?;
    if let Some(seed) = args.seed {
        config.calibration.seed = seed;
    }
    let replay = Replay::open(&args.log)?;
    let header = replay.header();
    let mut keep = Keep {
        store: None,
        history: History::new(Identity::new(header.sensor_name(), header.mountings.mag)),
        most: config.store.history,
    };
    let calibration = keep.open(args)?;
    let board = keep.history.board(&config.mounting.board());
    let pipeline = Pipeline::new(config.setup(&header.mountings, &board), calibration);
    let lines = JsonLines {
        device: Device {
            path: args.log.display().to_string(),
            activated: None,
            sensor: header.sensor.clone(),
            bps: None,
        },
        time: TimeOfDay::new(header),
        true_north: TrueNorth::new(&config.true_north),
        out: BufWriter::with_capacity(1 << 16, io::stdout().lock()),
        line: String::new(),
    };
    play(replay, pipeline, lines, &mut keep)
}

fn play(
    mut replay: Replay,
    mut pipeline: Pipeline,
    mut lines: JsonLines,
    keep: &mut Keep,
) -> Result<(), Failure> {
    lines.greet()?;
    let policy = keep.history.policy;
    let mut play = |event, lines: &mut JsonLines| {
        pipeline.play(event, |action| carry_out(action, lines, keep))
    };
    play(Event::Policy(policy), &mut lines)?;
    read_log(&mut replay, |entry, begins_stretch| {
        if begins_stretch {
            play(Event::NewStretch, &mut lines)?;
            lines.time.begin_stretch();
        }
        lines.time.at(entry.reading.t_s);
        play(Event::Reading(entry.reading), &mut lines)
    })?;
    output(lines.out.flush())?;
    tell_dropped(&pipeline.dropped());
    tell_skips(&replay)
}

/// Carries out the action. Returns the event that the pipeline is to be given next, if one follows.
fn carry_out(
    action: Action,
    lines: &mut JsonLines,
    keep: &mut Keep,
) -> Result<Option<Event>, Failure> {
    match action {
        Action::Publish(heading) => {
            if let Some(news) = lines.att(heading)? {
                tell(news);
            }
            return Ok(lines.true_north.take_field().map(Event::Place));
        }
        Action::Warn(news) => tell(news),
        Action::Report(report) => lines.write(&gpsd::state(&report))?,
        Action::Turned(_) => {}
        Action::Calibrate(request) => {
            let outcome = calibrate(&request);
            return Ok(Some(Event::Calibrated(Box::new(outcome))));
        }
        Action::Conclude(outcome, _) => {
            lines.write(&gpsd::calibration(&outcome))?;
            if let Some(calibration) = outcome.calibration {
                keep.save(&outcome, calibration)?;
            }
        }
    }
    Ok(None)
}

/// What a client sees.
struct JsonLines {
    device: Device,
    time: TimeOfDay,
    true_north: TrueNorth,
    out: BufWriter<StdoutLock<'static>>,
    line: String,
}

impl JsonLines {
    /// What a client gets on connecting and on asking for every stream.
    fn greet(&mut self) -> Result<(), Failure> {
        let policy = WatchPolicy {
            enable: true,
            json: true,
            calibration: true,
            state: true,
            ..WatchPolicy::default()
        };
        self.write(&gpsd::version())?;
        self.write(&gpsd::devices(&gpsd::device(&self.device, None)))?;
        self.write(&gpsd::watch(&policy))
    }

    /// What comes back is to be told to the user.
    fn att(&mut self, mut heading: Heading) -> Result<Option<String>, Failure> {
        let time = self.time.at(heading.t_s);
        heading.declination_deg = self.true_north.declination_deg(time);
        self.line.clear();
        let time = time.map(date::rfc3339);
        let (device, time) = (&self.device.path, time.as_deref());
        gpsd::att_begin(&mut self.line, device, &heading, time);
        gpsd::att_end(&mut self.line, 0);
        self.line.push('\n');
        output(self.out.write_all(self.line.as_bytes()))?;
        Ok(self.true_north.news())
    }

    fn write(&mut self, line: &str) -> Result<(), Failure> {
        output(writeln!(self.out, "{line}"))
    }
}

/// The store, if one is used, and what it keeps of the log's sensor.
struct Keep {
    store: Option<Store>,
    history: History,
    most: usize,
}

impl Keep {
    /// Opens what the arguments name; the calibration to start with.
    fn open(&mut self, args: &Args) -> Result<Option<Calibration>, Failure> {
        if let Some(path) = &args.calibration {
            return Ok(Some(self.in_file(path)?));
        }
        let Some(directory) = &args.store else {
            return Ok(None);
        };
        let store = Store::open(directory).map_err(|error| match error {
            StoreError::Directory { .. } => {
                let remedy = "name a folder with --store that you may write";
                Failure::new(Failure::CANNOT_CREATE, format!("{error}; {remedy}"))
            }
            other => other.into(),
        })?;
        self.store = Some(store);
        let contents = Store::contents(directory)?;
        if let Some(history) = contents.find(&self.history.identity) {
            self.history = history.clone();
        } else if let Some(other) = contents.sensors.first() {
            tell(format_args!(
                "the calibration in {} is that of {}, the log is of {}: not used",
                directory.display(),
                other.identity,
                self.history.identity
            ));
        }
        Ok(self.history.active().map(|entry| entry.record.calibration))
    }

    /// The active calibration of a file: that of the log's sensor, or the only one if either does not say which sensor it is.
    fn in_file(&self, path: &Path) -> Result<Calibration, Failure> {
        let file = path.display();
        let contents = Store::read_file(path)?;
        let of_log = &self.history.identity;
        let history = match (contents.find(of_log), contents.sensors.as_slice()) {
            (Some(history), _) => history,
            (None, [history]) if may_be_same(&history.identity, of_log) => {
                let of_file = &history.identity;
                tell(format_args!(
                    "{file} is used, though it was made for {of_file}, and the log is of {of_log}"
                ));
                history
            }
            (None, _) => {
                let of_file = contents.owners();
                let message = format!(
                    "{file} is of {of_file}, but the log is of {of_log}: name a calibration of that sensor and mounting"
                );
                return Err(Failure::new(Failure::DATA, message));
            }
        };
        let entry = history.active().ok_or_else(|| {
            Failure::new(Failure::DATA, format!("no calibration in {file} is active"))
        })?;
        Ok(entry.record.calibration)
    }

    fn save(&mut self, outcome: &Outcome, calibration: Calibration) -> Result<(), Failure> {
        let Some(store) = &self.store else {
            return Ok(());
        };
        let known = self.history.clone();
        let record =
            CalibrationRecord::of(outcome, calibration, CalibrationOrigin::Log, unix_now_s());
        self.history.keep(record, self.most);
        store.save(&self.history, Some(&known))?;
        Ok(())
    }
}

/// Whether two sensors that differ may be one: they are mounted alike, and one of them has no name.
fn may_be_same(one: &Identity, other: &Identity) -> bool {
    let unnamed = [one, other].iter().any(|it| it.sensor == UNKNOWN_SENSOR);
    unnamed && one.mag_axes == other.mag_axes
}
