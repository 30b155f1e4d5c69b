//! Restores what was known before an axis saturated, which is recognised only after some of its samples have been taken.

use super::filter::Filter;
use super::filter::gyro_bias::BiasLearnt;
use super::gyro_check::GyroCheck;
use super::iron_watch::IronWatch;
use super::rival::IronTrial;
use super::visit::VisitWatch;
use super::{Estimate, Rival, Sample};

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
            filter.learn_of_gyro_bias(&learnt, self.parameters_fixed);
            filter.pass(&meanwhile);
        }
        if let Some(proven) = &mut kept.proven {
            proven.wait(&learnt);
        }
        self.active = kept.active;
        self.rival = kept.rival;
        self.proven = kept.proven;
        self.gyro = kept.gyro;
        self.gyro.lose_frame();
        self.iron = kept.iron;
        self.trial = IronTrial::default();
        self.visit = VisitWatch::default();
        // Later checkpoints of other axes contain the bad samples, so they are set anew.
        for other in 0..3 {
            let kept_s = self.checkpoints[other].as_ref().map(|one| one.sample.t_s);
            if kept_s.is_some_and(|kept_s| kept_s > kept.sample.t_s) {
                self.checkpoints[other] = None;
                self.set_checkpoint(other);
            }
        }
    }

    /// Drops all checkpoints: the frame that they refer to is gone, or a turn has been adopted since they were set.
    pub(super) fn forget_checkpoints(&mut self) {
        self.checkpoints = [const { None }; 3];
    }
}
