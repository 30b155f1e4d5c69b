//! A whole log looked through once, for one calibration of all that is in it.

use std::borrow::Cow;

use nalgebra::Vector3;

use super::collector::is_level;
use super::intake::Intake;
use super::{Event, Pipeline, Setup};
use crate::calibration::outcome::{Outcome, Verdict};
use crate::calibration::plane::show_space;
use crate::calibration::settings::{ModeChoice, WindowChoice};
use crate::calibration::thinning::Thinned;
use crate::calibration::verdict::Refusal;
use crate::calibration::{CompletedTurn, FieldSample, Request, during, last_rest};
use crate::outliers::Dropped;
use crate::reading::{Field, Reading};
use crate::turn::Turn;

/// Faster than this is rotation, rad/s: a hand that holds still stays below 5 degrees a second.
const ROTATING_RAD_S: f64 = 0.087;

/// An axis is named as empty if more than this share of its samples have no number.
const EMPTY_SHARE: f64 = 0.05;

/// Finds the samples, the turns and the rotation of a log.
pub struct Survey {
    setup: Setup,
    /// The chip axes of the plane, if it is named.
    plane: Option<[usize; 2]>,
    intake: Intake,
    samples: Thinned,
    turns: Vec<Turn>,
    /// When the first rotation began and the last one ended, seconds.
    rotation_s: Option<(f64, f64)>,
    has_gyro: bool,
    /// How many samples there were, and in how many each axis had no number.
    fields: usize,
    empty: [usize; 3],
    /// What the daemon would have made of the log without its full turns, where motion may calibrate.
    motion: Option<Pipeline>,
}

/// An axis without a number in many samples: its cells are empty, or it was at the end of its range.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EmptyAxis {
    /// The chip axis: 0 is X.
    pub axis: usize,
    /// In how many samples.
    pub empty: usize,
    /// Of so many.
    pub samples: usize,
}

impl Survey {
    /// A survey of a log for a calibration with these settings; `plane` are the chip axes of the plane, if it is named.
    pub fn new(setup: Setup, plane: Option<[usize; 2]>) -> Self {
        let motion_counts = plane.is_none() && setup.calibration.window != WindowChoice::All;
        Self {
            intake: Intake::new(&setup, None),
            motion: motion_counts.then(|| Pipeline::new(setup.clone(), None)),
            setup,
            plane,
            samples: Thinned::default(),
            turns: Vec::new(),
            rotation_s: None,
            has_gyro: false,
            fields: 0,
            empty: [0; 3],
        }
    }

    /// Takes the next reading. `new_stretch`: the log's clock has jumped before it; its time must still be later than those before, since
    /// samples are found by their times.
    pub fn take(&mut self, reading: &Reading, new_stretch: bool) {
        if new_stretch {
            self.intake.saturation.begin_stretch();
            self.learn(Event::NewStretch);
        }
        self.learn(Event::Reading(*reading));
        let (turns, rotation_s) = (&mut self.turns, &mut self.rotation_s);
        let (reading, _) = self.intake.take(reading, |tick, turn| {
            turns.extend(turn);
            if tick.rate_rad_s.norm() > ROTATING_RAD_S {
                let (first, _) = rotation_s.unwrap_or((tick.t_s, tick.t_s));
                *rotation_s = Some((first, tick.t_s));
            }
        });
        self.has_gyro |= reading.rate_rad_s.is_some();
        if let Some(field) = &reading.field_mgauss {
            self.fields += 1;
            for (empty, value) in self.empty.iter_mut().zip(field) {
                *empty += usize::from(value.is_none());
            }
        }
        let field = reading
            .field_mgauss
            .and_then(|field| needed(&field, self.plane));
        if let Some(field_mgauss) = field
            && let Some(t_s) = self.intake.measured_s(reading.t_s, field_mgauss)
        {
            let sample = FieldSample {
                t_s,
                field_mgauss,
                pose: self.intake.attitude.pose_at(t_s),
            };
            let open_s = self.setup.turn.time_limit_s;
            self.samples.push(sample, &self.turns, open_s);
        }
    }

    /// Whether the turns are fitted, as the daemon would fit them. Turns about one level axis do not determine a heading; the
    /// estimate learns from them, too.
    fn fits_turns(&self) -> bool {
        let settings = &self.setup.calibration;
        let axes = self.turns.iter().map(|turn| turn.axis_body);
        let all_fit = settings.mode != ModeChoice::Auto && !self.turns.is_empty();
        all_fit || self.turns.iter().any(is_level) || show_space(axes, settings)
    }

    /// Takes no actions: all full turns are fitted together at the end.
    fn learn(&mut self, event: Event) {
        if let Some(pipeline) = &mut self.motion {
            pipeline.handle(event, &mut Vec::new());
        }
    }

    /// How many values were dropped that no sensor can have taken.
    pub fn dropped(&self) -> Dropped {
        self.intake.outliers.dropped()
    }

    /// What is wrong with a sensor at the end of the log, or with how chips are mounted, as a code and as a sentence.
    pub fn fault(&self) -> Option<(&'static str, Cow<'static, str>)> {
        let motion = self.motion.as_ref()?;
        let unit = motion
            .wrong_unit()
            .map(|message| ("field_unit", message.into()));
        unit.or_else(|| motion.chip_fault())
    }

    /// How many samples are used, if the log is so long that these are not all.
    pub fn thinned_to(&self) -> Option<usize> {
        self.samples.is_thinned().then(|| self.samples.len())
    }

    /// The axis without a number in the most samples, if it is needed and these are many.
    pub fn empty_axis(&self) -> Option<EmptyAxis> {
        let axis = (0..3)
            .filter(|&axis| is_needed(axis, self.plane))
            .max_by_key(|&axis| self.empty[axis])?;
        let (empty, samples) = (self.empty[axis], self.fields);
        (empty as f64 > EMPTY_SHARE * samples as f64).then_some(EmptyAxis {
            axis,
            empty,
            samples,
        })
    }

    /// Returns the log's outcome: the estimate learnt by motion, or `calibrate`'s result on its turns, its rotation or all samples. `None`
    /// if there are no gyro readings, and nothing else tells the plane.
    pub fn conclude(self, calibrate: impl FnOnce(&Request) -> Outcome) -> Option<Outcome> {
        let mode = self.setup.calibration.mode;
        let needs_gyro = self.plane.is_none() && mode != ModeChoice::Spatial;
        // Two samples or fewer are refused as too few.
        if needs_gyro && !self.has_gyro && self.samples.len() > 2 {
            return None;
        }
        let learnt = self.learnt();
        if learnt.is_some() && !self.fits_turns() {
            return learnt;
        }
        let fault = self.fault();
        let fitted = calibrate(&self.into_request());
        // A named mode asks for the turns' result.
        let outcome = match learnt.filter(|_| mode == ModeChoice::Auto) {
            Some(learnt) => learnt.in_place_of(fitted),
            None => fitted,
        };
        Some(match fault {
            Some((reason @ "field_unit", message)) if outcome.verdict == Verdict::Accepted => {
                outcome.refused(Refusal::new(reason, message))
            }
            _ => outcome,
        })
    }

    /// What the motion has taught.
    fn learnt(&self) -> Option<Outcome> {
        let (mut outcome, _) = self.motion.as_ref()?.learnt_by_motion()?;
        outcome.samples.total = self.samples.len();
        Some(outcome)
    }

    /// What is asked of a calibration on the turns, on the rotation, or on all samples.
    fn into_request(self) -> Request {
        let samples = self.samples.into_samples();
        let turns = (self.turns.iter())
            .filter(|_| self.plane.is_none())
            .map(|turn| CompletedTurn::among(&samples, turn))
            .collect();
        let moving = match self.rotation_s {
            Some((first_s, last_s)) => during(&samples, first_s, last_s),
            None => 0..samples.len(),
        };
        Request {
            rest: last_rest(samples[..moving.start].iter()),
            moving,
            samples,
            turns,
            plane: (self.plane).map(|axes| axes.map(|axis| Vector3::ith(axis, 1.0))),
            mounting: self.setup.mountings.mag,
            settings: self.setup.calibration,
            limits: self.setup.verdict,
        }
    }
}

/// Whether an axis is needed: of a named plane only two are.
fn is_needed(axis: usize, plane: Option<[usize; 2]>) -> bool {
    plane.is_none_or(|axes| axes.contains(&axis))
}

/// The field, if the axes that are needed did not overflow. The third axis of a named plane is not looked at, and is 0.
fn needed(field: &Field, plane: Option<[usize; 2]>) -> Option<Vector3<f64>> {
    let needed = |axis: usize| match is_needed(axis, plane) {
        true => field[axis],
        false => Some(0.0),
    };
    Some(Vector3::new(needed(0)?, needed(1)?, needed(2)?))
}
