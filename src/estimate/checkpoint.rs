//! Restores what was known before an axis saturated, or before the gyro hung: both are recognised only after some samples have been taken.

use super::filter::Filter;
use super::filter::gyro_bias::BiasLearnt;
use super::gyro_check::GyroCheck;
use super::iron_watch::IronWatch;
use super::rival::IronTrial;
use super::visit::VisitWatch;
use super::{Estimate, MOST_PERIOD_S, Rival, Sample};

/// The place of the gyro's checkpoint, after those of the magnetometer's three axes.
const GYRO: usize = 3;
/// A gyro that repeats its reading for longer than usual by this, seconds, may hang: ten readings at 100 Hz, which noise does not repeat.
const HANGS_S: f64 = 0.1;

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
    /// Keeps what is known now, since the next samples of this magnetometer axis may turn out to be no measurements. An earlier checkpoint
    /// of the axis stays.
    pub fn set_checkpoint(&mut self, axis: usize) {
        if let (None, Some(sample)) = (&self.checkpoints[axis], self.last) {
            self.checkpoints[axis] = Some(Box::new(Checkpoint {
                active: self.active.clone(),
                rival: self.rival.clone(),
                proven: self.proven.clone(),
                gyro: self.gyro.clone(),
                iron: self.iron.clone(),
                sample,
            }));
        }
    }

    /// Drops the checkpoint of this axis: its samples count as measurements.
    pub fn drop_checkpoint(&mut self, axis: usize) {
        self.checkpoints[axis] = None;
    }

    /// The samples of this axis since its checkpoint were no measurements: goes back to what was known before them.
    pub fn go_back(&mut self, axis: usize) {
        let (Some(mut kept), Some(last)) = (self.checkpoints[axis].take(), self.last) else {
            return;
        };
        let meanwhile = self.input(&last, &kept.sample);
        let learnt = BiasLearnt::between(
            &kept.sample.board.gyro_bias,
            &last.board.gyro_bias,
            !last.board.still,
        );
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
        if kept.gyro.fault().is_none() {
            self.suspended = None;
        }
        self.gyro = kept.gyro;
        self.gyro.lose_frame();
        self.iron = kept.iron;
        self.trial = IronTrial::default();
        self.visit = VisitWatch::default();
        // Later checkpoints of other axes contain the bad samples, so they are set anew.
        for other in 0..self.checkpoints.len() {
            let kept_s = self.checkpoints[other].as_ref().map(|one| one.sample.t_s);
            if kept_s.is_some_and(|kept_s| kept_s > kept.sample.t_s) {
                self.checkpoints[other] = None;
                self.set_checkpoint(other);
            }
        }
    }

    /// Sets a checkpoint while the gyro repeats its reading, unless it is one without noise, which repeats its reading at rest. Called before
    /// a sample is taken.
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
    /// claimed meanwhile does not explain the field. Then what it taught is taken back.
    ///
    /// A gyro without noise repeats its reading in an even rotation, too; then the field agrees.
    pub(super) fn take_back_hung_gyro(&mut self, sample: &Sample, lost: bool) -> bool {
        let over = sample.board.gyro_constant_s <= HANGS_S;
        let Some(kept) = self.checkpoints[GYRO].as_ref().filter(|_| over) else {
            return false;
        };
        let mut meanwhile = self.input(sample, &kept.sample);
        meanwhile.rate_rad_s = meanwhile.turned_rad / meanwhile.period_s;
        let mut filter = kept.active.clone();
        filter.pass(&meanwhile, true);
        let hung = lost || filter.begun && filter.is_odd(&meanwhile);
        if hung {
            self.gyro_bias = Some(sample.board.gyro_bias);
            self.go_back(GYRO);
        } else {
            self.gyro_noiseless |= kept.sample.board.still;
            self.drop_checkpoint(GYRO);
        }
        hung
    }

    /// The gyro is at fault: takes back what it has taught while it repeated its reading. Returns whether it does.
    pub(super) fn forget_hung_gyro(&mut self) -> bool {
        let Some(kept) = self.checkpoints[GYRO].take() else {
            return false;
        };
        self.active = kept.active;
        true
    }

    /// Drops all checkpoints: the frame that they refer to is gone, or a turn has been adopted since they were set.
    pub(super) fn forget_checkpoints(&mut self) {
        self.checkpoints = Default::default();
    }
}
