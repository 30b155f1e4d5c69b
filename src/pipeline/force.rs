//! Which calibration is in force, and whether another is wanted: outcomes, and what people order.

use super::fitness::Fitness;
use super::{Action, FREE_PAUSE_S, Pipeline, RESTART_DEG};
use crate::calibration::Rival;
use crate::calibration::model::Calibration;
use crate::calibration::outcome::{Outcome, Verdict};
use crate::calibration::policy::{Policy, Reason};
use crate::frame::wrap_360;
use crate::heading::Compass;

impl Pipeline {
    /// Why a motion would be calibrated on now; `None` if none would.
    pub fn wanted(&self) -> Option<Reason> {
        match self.policy {
            Policy::Locked if self.compass.is_some() => None,
            _ if self.armed => Some(Reason::Start),
            Policy::Off => None,
            _ if self.fitness.is_misfit() => Some(Reason::Stale),
            _ => Some(Reason::Turn),
        }
    }

    /// The calibration in force, as a candidate made for this reason meets it.
    pub(super) fn rival(&self, reason: Reason) -> Option<Rival> {
        self.calibration().map(|&calibration| Rival {
            calibration,
            doubted: reason == Reason::Stale,
        })
    }

    /// From now on calibrates so. What is under way and not wanted any more is given up.
    pub(super) fn set_policy(&mut self, policy: Policy, actions: &mut Vec<Action>) {
        self.policy = policy;
        let wanted = match self.wanted() {
            None => false,
            Some(_) => policy != Policy::Off || self.asked == Reason::Start,
        };
        self.unwanted |= self.calibrating && !wanted;
        self.refresh(actions);
    }

    /// Calibrates on the next motion, whatever the policy; all that was turned before is forgotten.
    pub(super) fn start(&mut self, actions: &mut Vec<Action>) {
        self.forget_motion();
        self.armed = true;
        self.refused = None;
        self.refresh(actions);
    }

    /// Gives up what [`Pipeline::start`] asked for, and a calibration under way.
    pub(super) fn cancel(&mut self, actions: &mut Vec<Action>) {
        self.forget_motion();
        self.armed = false;
        self.refresh(actions);
    }

    /// Puts another calibration in force, or none: without one, only what is turned from now on counts.
    pub(super) fn put_in_force(
        &mut self,
        calibration: Option<Calibration>,
        actions: &mut Vec<Action>,
    ) {
        match calibration {
            Some(calibration) => self.use_calibration(calibration),
            None => {
                self.compass = None;
                self.fitness = Fitness::default();
                self.attitude.restart_fusion();
                self.forget_motion();
            }
        }
        self.unwanted |= self.calibrating;
        self.refused = None;
        self.refresh(actions);
    }

    fn forget_motion(&mut self) {
        self.turns.reset();
        self.made.clear();
        self.buffer.clear();
        self.waiting = false;
        self.unwanted |= self.calibrating;
    }

    fn use_calibration(&mut self, calibration: Calibration) {
        let new = Compass::new(calibration, self.setup.mountings.mag);
        // A fusion that begins anew follows the field closely at first, tilts and all.
        if self
            .turned_by_deg(&new)
            .is_none_or(|turned| turned > RESTART_DEG)
        {
            self.attitude.restart_fusion();
        }
        self.compass = Some(new);
        self.fitness = Fitness::default();
        self.strength_deviation = 0.0;
    }

    pub(super) fn conclude(&mut self, mut outcome: Box<Outcome>, actions: &mut Vec<Action>) {
        self.calibrating = false;
        if std::mem::take(&mut self.unwanted) {
            give_up(&mut outcome, self.compass.is_some());
        } else {
            self.armed &= self.asked != Reason::Start || outcome.verdict == Verdict::Rejected;
            match (outcome.verdict, outcome.calibration) {
                (Verdict::Accepted, Some(calibration)) => {
                    self.use_calibration(calibration);
                    self.refused = None;
                }
                (Verdict::Kept, _) => {
                    // It does as well as a good one on the same motion: whatever was wrong is over.
                    self.fitness = Fitness::default();
                    self.refused = None;
                }
                _ => {
                    self.refused = Some((outcome.reason, outcome.message.clone()));
                    self.free_check_s = self.now_s + FREE_PAUSE_S;
                }
            }
        }
        actions.push(Action::Conclude(outcome));
        if std::mem::take(&mut self.waiting) {
            self.ask_for_calibration(actions);
        }
        self.update_condition(actions);
    }

    /// How far this calibration turns the heading of the newest sample, degrees, if there is one in force.
    fn turned_by_deg(&self, new: &Compass) -> Option<f64> {
        let sample = self.buffer.back()?;
        let down = self.attitude.down(sample.t_s);
        let heading = |compass: &Compass| {
            let corrected = compass.correct(&sample.field_mgauss, down.as_ref());
            compass.heading_deg(&corrected, down.as_ref())
        };
        let turned = wrap_360(heading(new)? - heading(self.compass.as_ref()?)?);
        Some(turned.min(360.0 - turned))
    }

    /// Before the first reading there is nothing to say of the condition.
    fn refresh(&mut self, actions: &mut Vec<Action>) {
        if self.readings_s.is_some() {
            self.update_condition(actions);
        }
    }
}

/// What became of a calibration that nobody wants any more.
fn give_up(outcome: &mut Outcome, calibrated: bool) {
    outcome.verdict = if calibrated {
        Verdict::Kept
    } else {
        Verdict::Rejected
    };
    outcome.reason = "cancelled";
    outcome.message =
        "given up: it was cancelled, or something else was ordered while it was computed"
            .to_owned();
    outcome.calibration = None;
}
