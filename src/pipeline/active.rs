//! Which calibration is active, and whether another is wanted: outcomes, and what people ask for.

use super::intake::expect_force_bias;
use super::learn::Learning;
use super::{Action, Pipeline};
use crate::calibration::model::Calibration;
use crate::calibration::outcome::{CANCELLED, Outcome, Verdict};
use crate::calibration::policy::{CalibrationOrigin, Policy};
use crate::calibration::verdict::Refusal;
use crate::estimate::UNKNOWN_SD_DEG;
use crate::frame::hypot;

/// How much of the disagreement with the gyro is the fit's: the rest is the gyro's own and noise.
const GYRO_SHARE: f64 = 0.7;
/// A field that is off at rest is off by a bias in one direction: the heading's error, RMS over a turn, is this share of it.
const REST_SHARE: f64 = std::f64::consts::FRAC_1_SQRT_2;

/// Refusals of a turn that is not enough by itself, but may be a part of a calibration.
const MORE_HELPS: [&str; 2] = ["coverage", "heading_uncertainty"];

impl Pipeline {
    /// What a calibration would come from now; `None` if no motion would calibrate.
    pub fn wanted(&self) -> Option<CalibrationOrigin> {
        match self.policy {
            Policy::Locked if self.learning.calibrated => None,
            _ if self.armed => Some(CalibrationOrigin::Start),
            Policy::Off => None,
            _ => Some(CalibrationOrigin::Turn),
        }
    }

    /// Sets the policy. A running calibration that the policy does not allow is discarded; a lock also gives up what
    /// [`Pipeline::start`] asked for.
    pub(super) fn set_policy(&mut self, policy: Policy, actions: &mut Vec<Action>) {
        self.policy = policy;
        self.armed &= policy != Policy::Locked;
        self.asked_for = false;
        let wanted = self.wanted().is_some();
        if let Some(job) = &mut self.job {
            job.unwanted |=
                !wanted || (policy == Policy::Off && job.origin != CalibrationOrigin::Start);
        }
        self.refresh(actions);
    }

    /// Calibrates on each motion until one is not refused, with policy `off` too; all that was turned before is forgotten.
    pub(super) fn start(&mut self, actions: &mut Vec<Action>) {
        self.forget_motion();
        if !self.learning.calibrated {
            self.forget_estimate(None);
        }
        self.armed = true;
        self.refused = None;
        self.refresh(actions);
    }

    /// Gives up what [`Pipeline::start`] asked for, and a calibration under way.
    pub(super) fn cancel(&mut self, actions: &mut Vec<Action>) {
        self.forget_motion();
        (self.armed, self.asked_for) = (false, false);
        self.refresh(actions);
    }

    /// Makes another calibration the active one, or none: then earlier turns are forgotten.
    pub(super) fn activate(&mut self, calibration: Option<Calibration>, actions: &mut Vec<Action>) {
        self.forget_estimate(calibration);
        if calibration.is_none() {
            self.forget_motion();
        }
        self.discard_outcome();
        self.refused = None;
        self.refresh(actions);
    }

    fn forget_motion(&mut self) {
        self.intake.turns.reset();
        self.completed.clear();
        self.buffer.clear();
        self.forget_waiting_turns();
        self.discard_outcome();
    }

    pub(super) fn forget_waiting_turns(&mut self) {
        if let Some(job) = &mut self.job {
            job.again = false;
        }
    }

    /// The outcome of a calibration under way will not be used.
    pub(super) fn discard_outcome(&mut self) {
        if let Some(job) = &mut self.job {
            job.unwanted = true;
        }
    }

    /// The estimate starts anew, from this calibration or from nothing.
    pub(super) fn forget_estimate(&mut self, calibration: Option<Calibration>) {
        self.estimate
            .restart(self.setup.mountings.mag, calibration.as_ref());
        if let Some(calibration) = &calibration {
            expect_force_bias(&mut self.intake.attitude, calibration);
        }
        self.forget_learning(calibration);
    }

    /// The calibration to go on from is this one, or none.
    pub(super) fn forget_learning(&mut self, calibration: Option<Calibration>) {
        self.learning = Learning::new(calibration);
        self.strength_deviation = 0.0;
        self.asked_for = false;
        self.sd_deg = UNKNOWN_SD_DEG;
    }

    pub(super) fn conclude(&mut self, mut outcome: Box<Outcome>, actions: &mut Vec<Action>) {
        let Some(job) = self.job.take() else {
            return;
        };
        if job.unwanted {
            *outcome = outcome.refused(Refusal::new("cancelled", CANCELLED));
            if self.learning.calibrated {
                outcome.verdict = Verdict::Kept;
            }
        } else {
            let accepted = outcome.verdict == Verdict::Accepted;
            if let Some(refusal) = self.objection_to_gyro().filter(|_| accepted) {
                *outcome = outcome.refused(refusal);
            }
            self.armed &=
                job.origin != CalibrationOrigin::Start || outcome.verdict == Verdict::Rejected;
            match (outcome.verdict, outcome.calibration) {
                (Verdict::Accepted, Some(calibration)) => {
                    outcome.calibration = Some(self.with_biases(calibration));
                    self.adopt(&mut outcome, &calibration);
                    let on_trial = outcome.verdict == Verdict::Kept;
                    self.asked_for = on_trial && job.origin == CalibrationOrigin::Start;
                    self.refused = None;
                }
                (verdict, _) => {
                    if verdict == Verdict::Rejected && !MORE_HELPS.contains(&outcome.reason) {
                        self.times.bad_turn_s = job.end_s;
                    }
                    self.refused = Some(Refusal::new(outcome.reason, outcome.message.clone()));
                }
            }
        }
        actions.push(Action::Conclude(outcome, job.origin));
        if job.again {
            self.ask_for_calibration(actions);
        }
        self.update_condition(actions);
    }

    /// The estimate takes the result of a turn, or keeps what it knows where that is more certain.
    fn adopt(&mut self, outcome: &mut Outcome, calibration: &Calibration) {
        // The disagreement with the gyro is added to the fit's deviation, however small its residuals are.
        let gyro_deg = GYRO_SHARE * outcome.gyro_rms_deg.unwrap_or(0.0);
        let measures = outcome.measures.as_ref();
        let rest = measures.and_then(|measures| measures.rest_share);
        let rest_deg = REST_SHARE * rest.unwrap_or(0.0).to_degrees();
        let doubted = Calibration {
            heading_sd_deg: hypot(calibration.heading_sd_deg, hypot(gyro_deg, rest_deg)),
            ..*calibration
        };
        if self.estimate.adopt_turn(&doubted, self.sample.as_ref()) {
            self.learning.calibrated = true;
            // The fit's own deviation knows nothing of the place and of how the chips lie to each other.
            let sd_deg = self.estimate.north_sd_deg().max(calibration.heading_sd_deg);
            self.learning
                .keep(&calibration.parameters, sd_deg, self.times.now_s);
            // The fit's own stays with the calibration: a pipeline that starts from this calibration adds the uncertainty
            // of the place itself.
            outcome.heading_sd_deg = Some(sd_deg);
            return;
        }
        if let Some(known) = self.conclude_as_known() {
            *outcome = known;
            return;
        }
        outcome.verdict = Verdict::Kept;
        outcome.reason = "less_certain";
        outcome.message =
            "what is known is more certain than this turn, and stays unless the turn fits the next readings better"
                .to_owned();
        outcome.calibration = None;
    }

    /// Updates the condition after a command, but not before the first reading. What would help may have changed, though the condition has
    /// not.
    fn refresh(&mut self, actions: &mut Vec<Action>) {
        if self.readings_s.is_some() {
            let message = self.judge().message;
            self.report.take_if(|last| last.message != message);
            self.update_condition(actions);
        }
    }
}
