//! Sensors that are not to be believed.

use super::Pipeline;
use crate::condition::SourceFault;
use crate::reading::Reading;

impl Pipeline {
    /// How many values were dropped since no sensor can have taken them.
    pub fn dropped(&self) -> u64 {
        self.outliers.dropped()
    }

    /// Looks whether a sensor says the same again and again.
    pub(super) fn watch(&mut self, reading: &Reading) {
        let found = self.frozen_watch.take(reading);
        if found.map(|frozen| frozen.code) != self.frozen.as_ref().map(|frozen| frozen.code) {
            self.frozen = found.map(|frozen| SourceFault {
                code: frozen.code,
                message: frozen.message.to_owned(),
            });
        }
    }

    /// Whether nothing is known to be wrong with the gyro.
    pub(super) fn gyro_is_right(&self) -> bool {
        self.estimate.gyro_fault().is_none()
    }
}
