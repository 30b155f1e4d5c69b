//! A second filter beside the active one, which explains the samples in another way.
//!
//! Both predict the samples that follow in motion. The one with the smaller innovations becomes, or stays, the active one.

use super::Estimate;
use super::filter::{Filter, Input};

/// A filter wins when its log-likelihood leads by this much. The limit is high (e¹² to 1) because the errors of consecutive samples are
/// correlated. With half or twice this value or `MOST_A_SAMPLE`, the simulated cases are decided in the same way.
const DECIDED: f64 = 12.0;
/// A sample adds no more than this to the lead: one that came late or was disturbed fits the less certain filter better, whichever is
/// right.
const MOST_A_SAMPLE: f64 = 0.5;
/// A rival that has not won after this much motion, seconds, is dropped: twice the 15 s in which a magnet is to be learnt.
const RIVAL_LASTS_S: f64 = 30.0;
/// If a disturbance exceeds this share of the field for this long in motion, a rival assumes that iron on the board causes it.
const IRON_TRIED_FROM: f64 = 0.08;
const IRON_TRIED_AFTER_S: f64 = 1.0;
/// A frame with less undisturbed motion than this, seconds, may have begun with the wrong iron, and so with a wrong field: it may take that
/// long to detect a magnet.
const FRAME_TRUSTED_AFTER_S: f64 = 5.0;

/// A second explanation of the samples.
#[derive(Clone)]
pub(super) struct Rival {
    pub(super) filter: Filter,
    /// Log-likelihood of the rival less that of the active one, at the sample before.
    last_lead: f64,
    /// How much better it has explained the samples since it began.
    lead: f64,
    moved_s: f64,
}

/// Prepares a rival that takes a disturbance for iron on the board.
#[derive(Default)]
pub(super) struct IronTrial {
    disturbed_s: f64,
    /// The active filter from before the field jumped, carried on while the field is disturbed. The active one takes the jump for
    /// unevenness of the field, which makes north uncertain and is forgotten slowly.
    before_jump: Option<Box<Filter>>,
}

impl IronTrial {
    /// Takes a sample that the active filter has followed. While `blocked`, no rival may start.
    pub(super) fn follow(&mut self, input: &Input, active: &Filter, blocked: bool) {
        if blocked || !(active.odd() || active.disturbed()) {
            self.before_jump = None;
        } else if let Some(before) = &mut self.before_jump {
            before.pass(input, false);
        } else if active.odd() && !active.disturbed() {
            self.before_jump = Some(Box::new(active.clone()));
        }
    }

    /// The kept filter.
    pub(super) fn filter(&mut self) -> Option<&mut Filter> {
        self.before_jump.as_deref_mut()
    }
}

impl Estimate {
    /// The better explanation of the samples wins.
    pub(super) fn judge_rival(&mut self, period_s: f64) {
        let Some(rival) = &mut self.rival else {
            return;
        };
        rival.moved_s += period_s;
        let ahead = rival.filter.log_likelihood - self.active.log_likelihood;
        rival.lead += (ahead - rival.last_lead).clamp(-MOST_A_SAMPLE, MOST_A_SAMPLE);
        rival.last_lead = ahead;
        let won = rival.lead > DECIDED;
        let lost = rival.lead < -DECIDED || rival.moved_s > RIVAL_LASTS_S;
        let Some(ended) = self.rival.take_if(|_| won || lost) else {
            return;
        };
        if won {
            self.active = ended.filter;
            // The proven filter has the old iron.
            self.proven = None;
            self.replaced = true;
            self.trial = IronTrial::default();
        }
    }

    /// A disturbance that stays while the board moves may be iron on the board.
    pub(super) fn try_iron(&mut self, input: &Input) {
        if self.rival.is_some() || self.parameters_fixed || !self.active.begun {
            return;
        }
        let trial = &mut self.trial;
        if trial.before_jump.is_none() && self.active.unevenness_share() < IRON_TRIED_FROM {
            trial.disturbed_s = (trial.disturbed_s - input.period_s).max(0.0);
            return;
        }
        trial.disturbed_s += input.period_s;
        if trial.disturbed_s < IRON_TRIED_AFTER_S {
            return;
        }
        let filter = if let Some(mut before) = std::mem::take(trial).before_jump {
            self.gyro.forget_field();
            let (innovation, _) = before.foresee(input);
            before.doubt_iron(innovation.norm());
            *before
        } else {
            let mut filter = self.active.clone();
            filter.doubt_iron(filter.unevenness_mgauss());
            if filter.undisturbed_s < FRAME_TRUSTED_AFTER_S {
                filter.restart_frame(input);
            }
            filter
        };
        self.start_rival(filter);
    }

    pub(super) fn start_rival(&mut self, filter: Filter) {
        self.rival = Some(Rival {
            last_lead: filter.log_likelihood - self.active.log_likelihood,
            lead: 0.0,
            filter,
            moved_s: 0.0,
        });
    }
}
