//! The only file that knows the pipeline: readings in, what a client sees out.

use std::convert::Infallible;
use std::path::Path;

use headingd::calibration::calibrate;
use headingd::calibration::model::{Calibration, Model, Parameters, Spatial};
use headingd::condition::Condition;
use headingd::frame::{Mountings, heading_deg};
use headingd::pipeline::{Action, Event, Pipeline, Setup};
use headingd::reading::Reading;
use headingd::sensor::replay::Replay;
use headingd::true_north::EarthField;
use nalgebra::{Matrix3, Vector3};

/// What is published for a magnetometer reading.
#[derive(Clone, Copy, Debug)]
pub struct Shown {
    pub condition: Condition,
    pub reason: &'static str,
    pub heading_deg: Option<f64>,
    pub instantaneous_deg: Option<f64>,
    pub sd_deg: Option<f64>,
}

impl Shown {
    pub fn good(&self) -> bool {
        self.condition == Condition::Good
    }
}

/// A calibration that was accepted.
#[derive(Clone)]
pub struct Accepted {
    pub t_s: f64,
    /// The deviation that it claims for its headings, degrees.
    pub claimed_sd_deg: f64,
    calibration: Calibration,
    mountings: Mountings,
}

impl Accepted {
    /// The heading of a level board from this field, chip axes.
    pub fn level_heading_deg(&self, raw: &Vector3<f64>) -> Option<f64> {
        let corrected = self.calibration.parameters.correct(raw)?;
        heading_deg(&self.mountings.mag.to_body(corrected), &Vector3::z())
    }
}

/// The calibration of a board whose chip makes `matrix · field + bias` of the field.
pub fn true_calibration(matrix: Matrix3<f64>, bias: Vector3<f64>, strength: f64) -> Calibration {
    let parameters = Parameters::Spatial(Spatial {
        model: Model::Symmetric,
        bias_mgauss: bias,
        matrix,
    });
    Calibration::of(parameters, strength, 5.0, 0.3)
}

/// The pipeline, with the world around it.
pub struct Daemon {
    pipeline: Pipeline,
    mountings: Mountings,
    reason: &'static str,
    pub accepted: Vec<Accepted>,
}

impl Daemon {
    pub fn new(mountings: Mountings, stored: Option<Calibration>) -> Self {
        let setup = Setup {
            mountings,
            ..Setup::default()
        };
        Self {
            pipeline: Pipeline::new(setup, stored),
            mountings,
            reason: "",
            accepted: Vec::new(),
        }
    }

    /// The field that a model of the earth's says is here.
    pub fn put_place(&mut self, place: EarthField) {
        self.pipeline
            .handle(Event::Place(Some(place)), &mut Vec::new());
    }

    /// Hands on a reading. The answer, if the magnetometer was in it.
    pub fn read(&mut self, reading: Reading) -> Option<Shown> {
        let mut shown = None;
        let (reason, accepted, mountings) = (&mut self.reason, &mut self.accepted, self.mountings);
        let carry_out = |action| -> Result<Option<Event>, Infallible> {
            match action {
                Action::Publish(heading) => {
                    shown = Some(Shown {
                        condition: heading.condition,
                        reason,
                        // What a client gets: see the encoder of ATT.
                        heading_deg: heading.fused_deg.filter(|_| heading.condition.may_steer()),
                        instantaneous_deg: heading.instantaneous_deg,
                        sd_deg: heading.sd_deg,
                    });
                }
                Action::Report(report) => *reason = report.reason,
                Action::Calibrate(request) => {
                    let outcome = Box::new(calibrate(&request));
                    return Ok(Some(Event::Calibrated(outcome)));
                }
                Action::Conclude(outcome, _) => {
                    accepted.extend(outcome.calibration.map(|calibration| Accepted {
                        t_s: reading.t_s,
                        claimed_sd_deg:
                            outcome.heading_sd_deg.unwrap_or(calibration.heading_sd_deg),
                        calibration,
                        mountings,
                    }));
                }
                Action::Turned(_) | Action::Warn(_) => {}
            }
            Ok(None)
        };
        let Ok(()) = self.pipeline.play(Event::Reading(reading), carry_out);
        shown
    }

    /// The active calibration.
    pub fn calibration(&self) -> Option<Calibration> {
        self.pipeline.calibration()
    }

    /// Hard iron and rotation between magnetometer and gyro, chip axes, if those of all three axes are known.
    pub fn spatial(&self) -> Option<Spatial> {
        match self.pipeline.calibration()?.parameters {
            Parameters::Spatial(spatial) => Some(spatial),
            Parameters::Planar(_) => None,
        }
    }
}

/// A recorded log: mountings, and its rows with the true heading in degrees where the log knows it.
pub type Log = (Mountings, Vec<(Reading, Option<f64>)>);

/// Reads a log, if there is one.
pub fn log(path: &Path) -> Option<Log> {
    let replay = Replay::open(path).ok()?;
    let mountings = replay.header().mountings;
    let rows = replay
        .map(|entry| {
            let entry = entry.unwrap_or_else(|error| panic!("{error}"));
            (entry.reading, entry.heading_truth_deg)
        })
        .collect();
    Some((mountings, rows))
}
