//! A second filter beside the active one, which explains the samples in another way.
//!
//! Both predict the samples that follow in motion. The one with the smaller innovations becomes, or stays, the active one.

use super::Estimate;
use super::filter::Filter;

/// A filter wins when its log-likelihood leads by this much. The limit is high (e¹² to 1) because the errors of consecutive samples are
/// correlated. Half or twice this value, or the one below, decides the simulated cases in the same way.
const DECIDED: f64 = 12.0;
/// A sample adds no more than this to the lead: one that came late or was disturbed fits the less certain filter better, whichever is
/// right.
const MOST_A_SAMPLE: f64 = 0.5;
/// A rival that has not won after this much motion, seconds, is dropped: twice the 15 s in which a magnet is to be learnt.
const RIVAL_LASTS_S: f64 = 30.0;
/// If a disturbance exceeds this share of the field for this long in motion, a rival assumes that iron on the board causes it.
const IRON_TRIED_FROM: f64 = 0.08;
const IRON_TRIED_AFTER_S: f64 = 1.0;

/// A second explanation of the samples.
#[derive(Clone)]
pub(super) struct Rival {
    pub(super) filter: Filter,
    /// Log-likelihood of the rival less that of the active one, at the sample before.
    ahead: f64,
    /// How much better it has explained the samples since it began.
    lead: f64,
    moved_s: f64,
}

impl Estimate {
    /// The better explanation of the samples wins.
    pub(super) fn compare(&mut self, period_s: f64) {
        let Some(rival) = &mut self.rival else {
            return;
        };
        rival.moved_s += period_s;
        let ahead = rival.filter.log_likelihood() - self.active.log_likelihood();
        rival.lead += (ahead - rival.ahead).clamp(-MOST_A_SAMPLE, MOST_A_SAMPLE);
        rival.ahead = ahead;
        let lead = rival.lead;
        if lead > DECIDED {
            self.active = rival.filter.clone();
            // It explains what follows by another iron.
            self.proven = None;
            self.rival = None;
            self.replaced = true;
            self.disturbed_s = 0.0;
        } else if lead < -DECIDED || rival.moved_s > RIVAL_LASTS_S {
            self.rival = None;
        }
    }

    /// A disturbance that stays while the board moves may be iron on the board.
    pub(super) fn try_iron(&mut self, period_s: f64) {
        if self.rival.is_some() || self.frozen || !self.active.begun() {
            return;
        }
        if self.active.disturbance() < IRON_TRIED_FROM {
            self.disturbed_s = (self.disturbed_s - period_s).max(0.0);
            return;
        }
        self.disturbed_s += period_s;
        if self.disturbed_s < IRON_TRIED_AFTER_S {
            return;
        }
        self.disturbed_s = 0.0;
        let mut filter = self.active.clone();
        filter.doubt_iron();
        self.start_rival(filter);
    }

    pub(super) fn start_rival(&mut self, filter: Filter) {
        self.rival = Some(Rival {
            ahead: filter.log_likelihood() - self.active.log_likelihood(),
            lead: 0.0,
            filter,
            moved_s: 0.0,
        });
    }
}
