//! What the estimate has learnt by motion, and when that is worth keeping.

use nalgebra::Vector3;

use super::judge::wrong_strength;
use super::{Action, Pipeline};
use crate::calibration::model::{Calibration, Parameters};
use crate::calibration::outcome::Outcome;
use crate::calibration::policy::CalibrationOrigin;
use crate::calibration::verdict::{Bound, Limit, Refusal};
use crate::estimate::UNKNOWN_SD_DEG;

/// What is learnt is kept again when its deviation falls below this share of the kept one's.
const MORE_CERTAIN: f64 = 0.6;
/// It is also kept again when the hard iron has moved by this many of the deviations at which a heading still counts as good.
const MOVED: f64 = 3.0;
/// Least time before it is kept again, seconds.
const KEEP_EVERY_S: f64 = 60.0;
/// The gyro's bias is kept if its deviation on each axis is below this, rad/s (0.5°/s): half of what a start expects it to have changed by.
const KNOWN_BIAS_RAD_S: f64 = 0.0087;

/// How far learning has come.
#[derive(Clone, Debug)]
pub(super) struct Learning {
    /// The calibration to start with, until the estimate has begun.
    pub(super) initial: Option<Calibration>,
    /// Whether there has been a calibration worth a heading.
    pub(super) calibrated: bool,
    /// The parameters kept last, their deviation, degrees, and when. The deviation is unknown at first if a pipeline starts with a
    /// turn's calibration: the fit's leaves out the place and the rotation between the chips.
    last: Option<Parameters>,
    last_sd_deg: Option<f64>,
    last_s: f64,
}

impl Learning {
    pub(super) fn new(initial: Option<Calibration>) -> Self {
        Self {
            calibrated: initial.is_some(),
            last: initial.map(|one| one.parameters),
            last_sd_deg: match &initial {
                None => Some(f64::INFINITY),
                Some(one) => one.covariance.as_ref().map(|_| one.heading_sd_deg),
            },
            initial,
            last_s: f64::NEG_INFINITY,
        }
    }

    /// The times that follow have nothing to do with those before.
    pub(super) fn begin_stretch(&mut self) {
        self.last_s = f64::NEG_INFINITY;
    }

    /// Whether what is learnt may be kept again.
    pub(super) fn is_due(&self, now_s: f64) -> bool {
        now_s - self.last_s >= KEEP_EVERY_S
    }

    /// Something has been kept.
    pub(super) fn keep(&mut self, parameters: &Parameters, sd_deg: f64, t_s: f64) {
        self.last = Some(*parameters);
        (self.last_sd_deg, self.last_s) = (Some(sd_deg), t_s);
    }

    /// Distance of this hard iron, chip axes, from the last kept, in its plane if it is planar, milligauss.
    fn moved_mgauss(&self, bias_mgauss: &Vector3<f64>) -> f64 {
        match &self.last {
            None => 0.0,
            Some(Parameters::Spatial(last)) => (bias_mgauss - last.bias_mgauss).norm(),
            Some(Parameters::Planar(last)) => (last.project(bias_mgauss) - last.bias_mgauss).norm(),
        }
    }
}

impl Pipeline {
    /// What the estimate knows, as the outcome of a turn that is less certain. `None` if a calibration has been kept, or if the estimate is
    /// too uncertain for a heading.
    pub(super) fn conclude_as_known(&mut self) -> Option<Outcome> {
        if self.learning.last.is_some() || !self.is_known_within(self.setup.pipeline.publish_sd_deg)
        {
            return None;
        }
        let outcome = self.keep_what_is_known()?;
        self.learning.calibrated = true;
        Some(outcome)
    }

    /// Whether the estimate is as certain as this, and nothing speaks against it.
    fn is_known_within(&self, sd_deg: f64) -> bool {
        self.estimate.north_sd_deg() <= sd_deg
            && !self.estimate.disturbed()
            && self.estimate.improbable_strength_mgauss().is_none()
    }

    /// Takes note that what the estimate knows is kept, and returns it as an outcome.
    fn keep_what_is_known(&mut self) -> Option<Outcome> {
        let outcome = self.outcome_of_motion()?;
        let parameters = outcome.calibration?.parameters;
        let sd_deg = self.estimate.north_sd_deg();
        self.learning.keep(&parameters, sd_deg, self.times.now_s);
        Some(outcome)
    }

    /// What the estimate knows, as an outcome; `None` before it has begun.
    fn outcome_of_motion(&self) -> Option<Outcome> {
        Outcome::of_motion(self.learnt_calibration()?, self.estimate.measured_axes())
    }

    /// What the estimate knows, as a calibration to keep; `None` before the estimate has begun.
    pub(super) fn learnt_calibration(&self) -> Option<Calibration> {
        let calibration = self.estimate.calibration()?;
        Some(self.with_biases(calibration))
    }

    /// This calibration with the gyro's bias, if that is known, and the accelerometer's.
    pub(super) fn with_biases(&self, calibration: Calibration) -> Calibration {
        Calibration {
            gyro_bias_deg_s: self.gyro_bias_deg_s(),
            accel_bias_m_s2: self.intake.attitude.force_bias_m_s2(),
            ..calibration
        }
    }

    /// The gyro's bias, gyro chip axes; `None` while it is not known well.
    fn gyro_bias_deg_s(&self) -> Option<Vector3<f64>> {
        let (bias, variance) = self.estimate.gyro_bias()?;
        let known = variance.max() < KNOWN_BIAS_RAD_S.powi(2);
        let chip = self.setup.mountings.gyro.to_chip(bias);
        known.then(|| chip.map(f64::to_degrees))
    }

    /// How much has been learnt on the way to a heading, 0 to 1: the logarithm of the deviation, from
    /// `UNKNOWN_SD_DEG` down.
    pub(super) fn learnt(&self) -> f64 {
        let wanted = self.setup.pipeline.publish_sd_deg;
        let sd_deg = self.estimate.north_sd_deg().max(wanted);
        ((UNKNOWN_SD_DEG / sd_deg).ln() / (UNKNOWN_SD_DEG / wanted).ln()).clamp(0.0, 1.0)
    }

    /// Reports what the estimate has learnt once that is good, and again when it is much better than what is kept, when the iron has
    /// moved, or when a rival has replaced the estimate. `due`: something may be kept again.
    pub(super) fn conclude_motion(&mut self, due: bool, actions: &mut Vec<Action>) {
        let sd_deg = self.estimate.north_sd_deg();
        let replaced = self.estimate.take_replaced();
        let to_be_saved = replaced || self.learning.last_sd_deg == Some(f64::INFINITY);
        // A turn that was asked for has lost its trial once there is neither a rival nor a new estimate.
        self.asked_for &= to_be_saved || self.estimate.has_rival();
        let good_sd_deg = self.setup.pipeline.good_sd_deg;
        let good = self.is_known_within(good_sd_deg);
        let last_sd_deg = self.learning.last_sd_deg;
        if last_sd_deg.is_none() && self.estimate.has_begun() {
            self.learning.last_sd_deg = Some(sd_deg);
        }
        let better = last_sd_deg.is_some_and(|last_sd_deg| sd_deg <= MORE_CERTAIN * last_sd_deg);
        let limit_mgauss = MOVED * good_sd_deg.to_radians() * self.estimate.horizontal_mgauss();
        let moved = self.learning.moved_mgauss(&self.estimate.bias_mgauss()) > limit_mgauss;
        if !(good && due && (better || moved || replaced)) {
            // A new estimate that is not good yet: save it as soon as it is.
            if replaced {
                self.learning.last_sd_deg = Some(f64::INFINITY);
            }
            return;
        }
        let won = self.asked_for && !self.estimate.has_rival();
        let asked_for = won.then_some(CalibrationOrigin::Start);
        let Some(origin) = self.wanted().or(asked_for) else {
            return;
        };
        let Some(outcome) = self.keep_what_is_known() else {
            return;
        };
        (self.armed, self.asked_for) = (false, false);
        self.refused = None;
        actions.push(Action::Conclude(Box::new(outcome), origin));
    }

    /// The calibration learnt so far, and its limits. It is accepted if it is as certain as one that the daemon would keep, and otherwise
    /// refused. `None` before the board has turned far enough for an estimate to begin.
    pub fn learnt_by_motion(&self) -> Option<(Outcome, [Limit; 3])> {
        let limit = |name, unit, measured, bound| Limit {
            name,
            unit,
            measured,
            bound,
        };
        let [right, predicted] =
            [self.gyro_is_right(), !self.estimate.disturbed()].map(|yes| f64::from(u8::from(yes)));
        let sd_deg = self.estimate.north_sd_deg();
        let most = Bound::AtMost(self.setup.pipeline.good_sd_deg);
        let limits = [
            limit("gyro turns as the field does", "", right, Bound::True),
            limit(
                "field at the end as the motion predicts",
                "",
                predicted,
                Bound::True,
            ),
            limit("predicted heading uncertainty", "degrees", sd_deg, most),
        ];
        let outcome = self.outcome_of_motion()?;
        let outcome = match self.objection_to_motion(&limits) {
            Some(refusal) => outcome.refused(refusal),
            None => outcome,
        };
        Some((outcome, limits))
    }

    /// What a calibration is refused for if the gyro is wrong.
    pub(super) fn objection_to_gyro(&self) -> Option<Refusal> {
        (!self.gyro_is_right()).then(|| {
            Refusal::new(
                "gyro_angle",
                "field and gyro do not turn together: check the gyro's wiring, mounting, sign and range",
            )
        })
    }

    fn objection_to_motion(&self, [_, predicted, certain]: &[Limit; 3]) -> Option<Refusal> {
        if let Some(refusal) = self.objection_to_gyro() {
            return Some(refusal);
        }
        if let Some(strength) = self.estimate.improbable_strength_mgauss() {
            return Some(Refusal::new("field_unit", wrong_strength(strength)));
        }
        if !predicted.is_kept() {
            return Some(Refusal::new(
                "outliers",
                "at the end of the log the field is not what the motion predicts: something magnetic came or went",
            ));
        }
        (!certain.is_kept()).then(|| {
            let (sd_deg, most_deg) = (certain.measured, self.setup.pipeline.good_sd_deg);
            Refusal::new(
                "heading_uncertainty",
                format!(
                    "no level full turn was recognised, and by motion headings are uncertain by {sd_deg:.1} degrees (at most {most_deg:.1}): move the board about, and {}",
                    self.estimate.motion_wanted()
                ),
            )
        })
    }
}
