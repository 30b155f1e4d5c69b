//! The way back to before samples that were no measurements: a saturated axis is recognised only after some of its samples have been taken.

use super::filter::Filter;
use super::{Estimate, Sample};

/// What was known at a sample.
pub(super) struct Checkpoint {
    active: Filter,
    proven: Option<Filter>,
    /// The newest sample that it knows of.
    sample: Sample,
}

impl Estimate {
    /// Keeps what is known now: the samples to come may turn out to be no measurements. An earlier checkpoint stays.
    pub fn set_checkpoint(&mut self) {
        if let (None, Some(sample)) = (&self.checkpoint, self.last) {
            self.checkpoint = Some(Checkpoint {
                active: self.active.clone(),
                proven: self.proven.clone(),
                sample,
            });
        }
    }

    /// The samples since the checkpoint were measurements.
    pub fn drop_checkpoint(&mut self) {
        self.checkpoint = None;
    }

    /// The samples since the checkpoint were no measurements: goes back to what was known before them.
    pub fn go_back(&mut self) {
        let (Some(checkpoint), Some(last)) = (self.checkpoint.take(), self.last) else {
            return;
        };
        let Checkpoint {
            mut active,
            mut proven,
            sample,
        } = checkpoint;
        let shift = last.gyro_bias_rad_s - sample.gyro_bias_rad_s;
        active.shift_gyro_bias(&shift);
        active.pass(&self.input(&last, &sample));
        if let Some(proven) = &mut proven {
            proven.shift_gyro_bias(&shift);
        }
        self.active = active;
        self.proven = proven;
        // It knows these samples.
        self.rival = None;
    }
}
