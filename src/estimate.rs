//! The running estimate: one recursive filter over the field, the iron, the chips' axes and the gyro.
//!
//! It takes the usable magnetometer samples. State, covariance and innovations answer every question: which way the board points and how
//! certainly, whether that may be published, whether the field is disturbed, and how good the calibration is. `filter` has the model and
//! its equations, `covariance` where each parameter stands in it, `prior` what a filter starts from.
//!
//! Beside the active filter there may be a `rival`, which explains the samples in another way: with the result of a full turn, without
//! it, or with iron that has just come or gone. `iron_watch` detects a hard iron that moves further than its covariance allows. `visit`
//! carries on the filters from before something magnetic came near a still board; `checkpoint` has what was known before an axis may have
//! been saturated or the gyro hung, and `suspended` follows the samples during a fault of the gyro.
//!
//! `gyro_check` compares the gyro with field and gravity, `place` the field with the earth's. The other files answer: `heading` gives the
//! heading and its deviation (`level`: where down is, and how certainly; `kept`: headings by a stored calibration alone), `strength` the
//! field's strength, `learnt` the calibration.

use nalgebra::{Matrix3, Vector3};

use crate::attitude::{BoardMotion, BoardState, GyroBias};
use crate::calibration::model::Calibration;
use crate::frame::Mounting;
use crate::reading::STRONGEST_MGAUSS;
use crate::true_north::EarthField;

mod checkpoint;
mod covariance;
mod filter;
mod gyro_check;
mod heading;
mod iron_watch;
mod kept;
mod learnt;
mod level;
mod place;
mod prior;
mod rival;
mod strength;
mod suspended;
mod visit;

use checkpoint::Checkpoint;
use filter::gyro_bias::BiasLearnt;
use filter::{Filter, Input};
use gyro_check::GyroCheck;
pub use gyro_check::GyroFault;
pub use heading::UNKNOWN_SD_DEG;
use iron_watch::IronWatch;
use level::Level;
use place::PlaceEvidence;
use prior::{Measured, Prior};
use rival::{IronTrial, Rival};
use suspended::{Suspended, filter_taking_samples};
use visit::VisitWatch;

/// An axis counts as measured while the deviation of its bias is below this share of the field. In a horizontal field, that error turns
/// headings by 9°; the default limit for publishing is 10°.
const MEASURED: f64 = 0.15;

/// Samples contradict the estimate if their mean normalised innovation squared per degree of freedom reaches this: innovations are then
/// twice as large as expected.
const CONTRADICTED: f64 = 4.0;

/// Limits of the time between two samples, seconds. The lower one keeps quotients finite. After a longer pause, in which the gyro alone
/// has carried the frame, the frame begins anew from the iron: a gyro bias known to 0.5°/s has then turned it by 5°.
const LEAST_PERIOD_S: f64 = 1e-4;
const MOST_PERIOD_S: f64 = 10.0;

/// One magnetometer sample, with what gyro and accelerometer say of it.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// When the chip measured it, seconds, not corrected for `lag_s`.
    pub t_s: f64,
    /// Raw field, magnetometer chip axes, milligauss.
    pub field_mgauss: Vector3<f64>,
    /// Lag of the magnetometer for which the motion is already corrected, seconds.
    pub lag_s: f64,
    /// How the board lay and turned when the magnetometer measured.
    pub motion: BoardMotion,
    /// The board's state when the sample came.
    pub board: BoardState,
}

/// A heading and its deviation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EstimatedHeading {
    /// Degrees clockwise from magnetic north, [0, 360).
    pub heading_deg: f64,
    /// One standard deviation, degrees.
    pub sd_deg: f64,
}

/// The estimate.
pub struct Estimate {
    mounting: Mounting,
    /// Calibration in use until the active filter begins: the one given at the start, or the last turn's that was adopted. A gyro fault
    /// falls back to it if `proven` is `None`.
    kept: Option<Calibration>,
    active: Filter,
    rival: Option<Rival>,
    parameters_fixed: bool,
    last: Option<Sample>,
    /// The gyro's bias at the last sample. It stays when the frame is lost.
    gyro_bias: Option<GyroBias>,
    gyro: GyroCheck,
    /// What was known when the gyro was last shown to be right.
    proven: Option<Filter>,
    suspended: Option<Box<Suspended>>,
    /// One for each axis of the magnetometer and one for the gyro, set when it begins to repeat a number: the axis may be saturated, and
    /// the gyro may hang. Boxed: dropping an empty `Option` of 25 kB copies as much, four times a sample.
    checkpoints: [Option<Box<Checkpoint>>; 4],
    /// Whether the gyro repeats its reading at rest, as one without noise does.
    gyro_noiseless: bool,
    iron: IronWatch,
    visit: VisitWatch,
    trial: IronTrial,
    replaced: bool,
    lost: bool,
    level: Level,
    place: Option<PlaceEvidence>,
    warning: Option<String>,
}

impl Estimate {
    /// An estimate of a magnetometer mounted like this that knows nothing, or what a calibration says.
    pub fn new(mounting: Mounting, calibration: Option<&Calibration>) -> Self {
        Self {
            mounting,
            kept: calibration.copied(),
            active: fresh(calibration, &mounting),
            rival: None,
            parameters_fixed: false,
            last: None,
            gyro_bias: None,
            gyro: GyroCheck::default(),
            proven: None,
            suspended: None,
            checkpoints: Default::default(),
            gyro_noiseless: false,
            iron: IronWatch::default(),
            visit: VisitWatch::default(),
            trial: IronTrial::default(),
            replaced: false,
            lost: false,
            level: Level::default(),
            place: None,
            warning: None,
        }
    }

    /// Starts again from this calibration, at the same place.
    pub fn restart(&mut self, mounting: Mounting, calibration: Option<&Calibration>) {
        let place = self.place.take().map(PlaceEvidence::unweighed);
        *self = Self {
            place,
            ..Self::new(mounting, calibration)
        };
    }

    /// The earth's field at the place of the compass, if that is known.
    pub fn put_place(&mut self, field: Option<&EarthField>) {
        let before = self.place.take();
        self.place = field.map(|field| PlaceEvidence::new(field).after(before));
    }

    /// Whether the field points up where the earth's points down at the place of the compass, or the other way round.
    pub fn reversed(&self) -> bool {
        self.place.as_ref().is_some_and(|place| place.reversed)
    }

    /// What the user should know of the place, once.
    pub fn take_warning(&mut self) -> Option<String> {
        self.warning.take()
    }

    /// Takes a sample. With `fixed`, the parameters stay as they are. Returns whether a dead or hung gyro measures again: the attitude has
    /// followed it, and is to begin anew. Other faults do not count, since the field may have caused them.
    pub fn take(&mut self, sample: &Sample, fixed: bool) -> bool {
        self.parameters_fixed = fixed;
        if fixed {
            self.rival = None;
        }
        self.watch_for_hung_gyro(sample);
        let unbroken = self.last.is_some();
        let previous = self.last.replace(*sample).unwrap_or(*sample);
        let input = self.input(sample, &previous);
        let period_s = input.period_s;
        let another_frame = std::mem::take(&mut self.lost)
            || sample.motion.pose.frame_id != previous.motion.pose.frame_id;
        let lost = another_frame || sample.t_s - previous.t_s > MOST_PERIOD_S;
        if self.take_back_hung_gyro(sample, another_frame) {
            self.lose_frame();
            return true;
        }
        if lost {
            self.visit = VisitWatch::default();
            self.gyro.lose_frame();
            self.forget_checkpoints();
        }
        let iron_open = self.trial.filter().is_some();
        let followed = filter_taking_samples(&self.active, self.suspended.as_deref());
        let right = self.gyro.take(&input, followed, iron_open);
        let at_fault = self.gyro.fault().is_some() || self.suspended.is_some();
        // While the board is still, what the attitude measures does not count: at rest the filters measure the bias themselves.
        let measured = unbroken && !at_fault && !sample.board.still;
        self.learn_of_gyro_bias(sample, measured, lost || at_fault);
        if at_fault {
            return self.follow_gyro_fault(&input, lost);
        }
        self.active.follow(&input, lost, self.parameters_fixed);
        if let Some(rival) = &mut self.rival {
            rival.filter.follow(&input, lost, self.parameters_fixed);
        }
        let blocked = lost || self.parameters_fixed || self.rival.is_some();
        self.trial.follow(&input, &self.active, blocked);
        let down = sample.motion.pose.orientation * Vector3::z();
        self.level.take(down, lost, period_s);
        if right && !self.disturbed() {
            self.proven = Some(self.active.clone());
        }
        if !sample.board.still {
            if let Some(place) = &mut self.place {
                self.warning = place.weigh(&self.active, period_s).or(self.warning.take());
            }
            self.judge_rival(period_s);
            self.try_iron(&input);
        }
        let (rival, fixed) = (self.rival.as_ref(), self.parameters_fixed);
        if let Some(restored) = self.visit.take(&input, &self.active, rival, fixed) {
            self.active = restored.active;
            self.rival = restored.rival;
            self.iron = IronWatch::default();
            self.trial = IronTrial::default();
        }
        self.iron.take(&self.active, period_s);
        false
    }

    /// Passes the change of the attitude's gyro bias to all filters. With `measured`, the active filter, its rival and those kept for a
    /// visit or an iron trial also learn from it. With `walks` (frame lost or gyro at fault) no prediction adds their bias walk, so the
    /// attitude's is added here.
    fn learn_of_gyro_bias(&mut self, sample: &Sample, measured: bool, walks: bool) {
        let after = sample.board.gyro_bias;
        let before = self.gyro_bias.replace(after).unwrap_or(after);
        let learnt = BiasLearnt::between(&before, &after, measured);
        let rival = self.rival.as_mut().map(|one| &mut one.filter);
        let active_and_rival = [Some(&mut self.active), rival].into_iter().flatten();
        let kept = self.visit.filters().chain(self.trial.filter());
        for filter in active_and_rival.chain(kept) {
            filter.take_gyro_bias(&learnt, walks, self.parameters_fixed);
        }
        let learnt = learnt.unmeasured();
        if let Some(suspended) = &mut self.suspended {
            suspended.filter.take_gyro_bias(&learnt, false, true);
        }
        if let Some(proven) = &mut self.proven {
            proven.take_gyro_bias(&learnt, true, true);
        }
    }

    /// Whether the active filter has begun: until then at most the kept calibration is known.
    pub fn has_begun(&self) -> bool {
        self.active.begun
    }

    /// Makes the filters' input from a sample and the one before it. The first sample is its own predecessor.
    fn input(&self, sample: &Sample, before: &Sample) -> Input {
        let motion = &sample.motion;
        Input {
            to_frame: motion.pose.orientation.to_rotation_matrix().into_inner(),
            vertical_known: motion.pose.vertical_known,
            rate_rad_s: motion.rate_rad_s,
            field_mgauss: self.mounting.to_body(sample.field_mgauss),
            turned_rad: motion.turned_rad - before.motion.turned_rad,
            missed_rad2: motion.missed_rad2 - before.motion.missed_rad2,
            period_s: (sample.t_s - before.t_s).clamp(LEAST_PERIOD_S, MOST_PERIOD_S),
            lag_s: sample.lag_s,
            board: sample.board,
        }
    }

    /// Estimated lag of the magnetometer behind the gyro, seconds, 0 to 0.12.
    pub fn lag_s(&self) -> f64 {
        filter_taking_samples(&self.active, self.suspended.as_deref())
            .lag_s()
            .max(0.0)
    }

    /// The frame is lost: drops the last sample and the rival. The next sample begins a new frame.
    pub fn lose_frame(&mut self) {
        self.last = None;
        self.lost = true;
        self.rival = None;
        self.trial = IronTrial::default();
    }

    /// Whether two explanations of the samples are being compared.
    pub fn has_rival(&self) -> bool {
        self.rival.is_some()
    }

    /// Whether the active filter has been replaced by its rival since this was last asked.
    pub fn take_replaced(&mut self) -> bool {
        std::mem::take(&mut self.replaced)
    }

    /// Takes the result of a full turn. If the result knows the hard iron better, a filter with it becomes active and the present one its
    /// rival, else the other way round. Returns whether the result is active.
    pub fn adopt_turn(&mut self, calibration: &Calibration, sample: Option<&Sample>) -> bool {
        let Some(sample) = sample.filter(|_| self.active.begun) else {
            self.restart(self.mounting, Some(calibration));
            return true;
        };
        let mut turned = self.active.clone();
        let measured = Measured::by(calibration, &self.mounting);
        let input = self.input(sample, sample);
        let better = measured
            .iter()
            .filter(|one| one.matrix == Matrix3::zeros())
            .all(|one| one.variance < self.active.variance_of(one));
        turned.replace(&measured, &input);
        // Restoring a checkpoint would undo the turn.
        self.forget_checkpoints();
        self.visit = VisitWatch::default();
        self.trial = IronTrial::default();
        if better {
            self.kept = Some(*calibration);
            self.proven = None;
            self.iron = IronWatch::default();
            let known = std::mem::replace(&mut self.active, turned);
            self.start_rival(known);
        } else {
            self.start_rival(turned);
        }
        better
    }

    /// The corrected sample D⁻¹ (y − b), body axes, milligauss. As long as a kept planar calibration is used alone, it lies in that plane.
    pub fn corrected(&self, field_mgauss: &Vector3<f64>) -> Option<Vector3<f64>> {
        if let Some(kept) = self.kept_alone() {
            let chip = kept.parameters.correct(field_mgauss)?;
            return Some(self.mounting.to_body(chip));
        }
        let body = self.mounting.to_body(*field_mgauss);
        Some(self.active.matrix().try_inverse()? * (body - self.active.bias_mgauss()))
    }

    /// The kept calibration while nothing else is known: the active filter has not begun, nor started from a calibration with a covariance.
    fn kept_alone(&self) -> Option<&Calibration> {
        let filter_knows = |kept: &&Calibration| self.active.begun || kept.covariance.is_some();
        self.kept.as_ref().filter(|kept| !filter_knows(kept))
    }

    /// Which body axes have a bias that is known.
    pub fn measured_axes(&self) -> [bool; 3] {
        if let Some(kept) = self.kept_alone() {
            return kept::measured_axes(kept, &self.mounting);
        }
        let limit = MEASURED * self.strength_mgauss().clamp(1.0, STRONGEST_MGAUSS);
        let sd = self.active.bias_sd_mgauss();
        std::array::from_fn(|axis| sd[axis] < limit)
    }

    /// The hard iron, magnetometer chip axes, milligauss.
    pub fn bias_mgauss(&self) -> Vector3<f64> {
        self.mounting.to_chip(self.active.bias_mgauss())
    }

    /// Whether the field here is not the earth's, or the samples are not as the estimate expects them.
    pub fn disturbed(&self) -> bool {
        self.active.begun
            && (self.active.disturbed()
                || self.active.consistency >= CONTRADICTED
                || self.iron.moved())
    }

    /// What is wrong with the gyro, if field and gyro show it.
    pub fn gyro_fault(&self) -> Option<GyroFault> {
        self.gyro.fault()
    }
}

/// A filter that knows what a calibration says of a magnetometer mounted like this, or nothing.
fn fresh(calibration: Option<&Calibration>, mounting: &Mounting) -> Filter {
    let prior = calibration.map_or_else(Prior::unknown, |c| Prior::of(c, mounting));
    Filter::new(&prior)
}
