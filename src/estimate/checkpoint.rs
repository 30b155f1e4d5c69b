//! Restores what was known before an axis saturated, or before the gyro hung: both are recognised only after some samples have been taken.

use super::filter::Filter;
use super::filter::gyro_bias::BiasLearnt;
use super::gyro_check::GyroCheck;
use super::iron_watch::IronWatch;
use super::rival::IronTrial;
use super::visit::VisitWatch;
use super::{Estimate, MOST_PERIOD_S, Rival, Sample};

/// Index of the gyro's checkpoint, after those of the magnetometer's three axes.
const GYRO: usize = 3;
/// A gyro that repeats its reading for longer than usual by this, seconds, may hang: ten readings at 100 Hz, which noise does not repeat.
const HANGS_S: f64 = 0.1;
/// A gyro that repeats its reading for this long at rest, while the field stands still, has no noise, seconds.
const NOISELESS_S: f64 = 0.5;

/// What was known at a sample.
pub(super) struct Checkpoint {
    active: Filter,
    rival: Option<Rival>,
    proven: Option<Filter>,
    gyro: GyroCheck,
    iron: IronWatch,
    sample: Sample,
}

impl Estimate {
    /// Keeps what is known now, since what follows of this axis of the magnetometer, or of the gyro, may turn out to be no measurement. An
    /// earlier checkpoint of the same stays.
    pub fn set_checkpoint(&mut self, index: usize) {
        if let (None, Some(sample)) = (&self.checkpoints[index], self.last) {
            self.checkpoints[index] = Some(Box::new(Checkpoint {
                active: self.active.clone(),
                rival: self.rival.clone(),
                proven: self.proven.clone(),
                gyro: self.gyro.clone(),
                iron: self.iron.clone(),
                sample,
            }));
        }
    }

    /// Drops this checkpoint: what followed counts as measured.
    pub fn drop_checkpoint(&mut self, index: usize) {
        self.checkpoints[index] = None;
    }

    /// What followed this checkpoint was not measured: goes back to what was known before.
    pub fn go_back(&mut self, index: usize) {
        let (Some(mut kept), Some(last)) = (self.checkpoints[index].take(), self.last) else {
            return;
        };
        let meanwhile = self.input(&last, &kept.sample);
        // What a hung gyro shows of its bias is no measurement.
        let measured = index != GYRO && !last.board.still;
        let (before, after) = (&kept.sample.board.gyro_bias, &last.board.gyro_bias);
        let learnt = BiasLearnt::between(before, after, measured);
        let rival = kept.rival.as_mut().map(|rival| &mut rival.filter);
        for filter in [&mut kept.active].into_iter().chain(rival) {
            filter.take_gyro_bias(&learnt, false, self.parameters_fixed);
            filter.pass(&meanwhile, self.parameters_fixed);
        }
        if let Some(proven) = &mut kept.proven {
            proven.take_gyro_bias(&learnt.unmeasured(), true, true);
        }
        self.active = kept.active;
        self.rival = kept.rival;
        self.proven = kept.proven;
        // What speaks against a hung gyro stays.
        if index != GYRO {
            if kept.gyro.fault().is_none() {
                self.suspended = None;
            }
            self.gyro = kept.gyro;
        }
        self.gyro.lose_frame();
        self.iron = kept.iron;
        self.trial = IronTrial::default();
        self.visit = VisitWatch::default();
        // Later checkpoints contain the bad samples, so they are set anew.
        for other in 0..self.checkpoints.len() {
            let kept_s = self.checkpoints[other].as_ref().map(|one| one.sample.t_s);
            if kept_s.is_some_and(|kept_s| kept_s > kept.sample.t_s) {
                self.checkpoints[other] = None;
                self.set_checkpoint(other);
            }
        }
    }

    /// Sets the gyro's checkpoint while its reading repeats. At rest a gyro without noise repeats it anyway: then the checkpoint is dropped.
    /// Called before a sample is taken.
    pub(super) fn watch_for_hung_gyro(&mut self, sample: &Sample) {
        let constant_s = sample.board.gyro_constant_s;
        self.gyro_noiseless |= sample.board.still && constant_s > MOST_PERIOD_S;
        if sample.board.still && self.gyro_noiseless {
            self.drop_checkpoint(GYRO);
        } else if constant_s > HANGS_S {
            self.set_checkpoint(GYRO);
        }
    }

    /// Whether the gyro hung until this sample, which is the newest: its reading has changed after it was repeated, and the rotation that it
    /// claimed meanwhile does not explain the field. Then what it taught is taken back. In `another_frame` that rotation is unknown.
    ///
    /// A gyro without noise repeats its reading in an even rotation, too; then the field agrees.
    pub(super) fn take_back_hung_gyro(&mut self, sample: &Sample, another_frame: bool) -> bool {
        let over = sample.board.gyro_constant_s <= HANGS_S;
        let Some(kept) = self.checkpoints[GYRO].as_ref().filter(|_| over) else {
            return false;
        };
        let mut meanwhile = self.input(sample, &kept.sample);
        meanwhile.rate_rad_s = meanwhile.turned_rad / meanwhile.period_s;
        let mut filter = kept.active.clone();
        filter.pass(&meanwhile, true);
        let hung = !another_frame && filter.begun && filter.is_odd(&meanwhile);
        if hung {
            self.gyro_bias = Some(sample.board.gyro_bias);
            self.go_back(GYRO);
        } else {
            let lasted = sample.t_s - kept.sample.t_s > NOISELESS_S;
            self.gyro_noiseless |= filter.begun && kept.sample.board.still && lasted;
            self.drop_checkpoint(GYRO);
        }
        hung
    }

    /// The gyro is at fault. If it has repeated its reading, what it taught meanwhile is taken back. Returns whether that was so.
    pub(super) fn forget_hung_gyro(&mut self) -> bool {
        let (Some(kept), Some(last)) = (self.checkpoints[GYRO].take(), self.last) else {
            return false;
        };
        let (before, after) = (&kept.sample.board.gyro_bias, &last.board.gyro_bias);
        let learnt = BiasLearnt::between(before, after, false);
        (self.active, self.proven) = (kept.active, kept.proven);
        for filter in [Some(&mut self.active), self.proven.as_mut()]
            .into_iter()
            .flatten()
        {
            filter.take_gyro_bias(&learnt, true, true);
        }
        true
    }

    /// Drops all checkpoints: the frame that they refer to is gone, or a turn has been adopted since they were set.
    pub(super) fn forget_checkpoints(&mut self) {
        self.checkpoints = Default::default();
    }
}
