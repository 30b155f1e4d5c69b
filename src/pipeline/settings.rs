//! What can be set about the pipeline itself.

use serde::{Deserialize, Serialize};

use crate::check::{Check, Fault, within};

/// Settings of the pipeline itself; those of its rooms stand with them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// A magnetometer sample older than this is stale, and no heading is published: 0.1 to 10 seconds.
    pub stale_s: f64,
    /// Samples are kept this long for a calibration, and so the first of two turns may be this old:
    /// 10 to 600 seconds.
    pub buffer_s: f64,
    /// A field whose strength is off by more than this share of what the calibration expects is
    /// called disturbed: 0.02 to 1.
    pub strength_tolerance: f64,
    /// A calibration that field or gyro disagree with for this long, while the board is moved and in several
    /// orientations, has stopped fitting: 10 to 3600 seconds.
    pub misfit_s: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            stale_s: 0.5,
            buffer_s: 120.0,
            strength_tolerance: 0.15,
            misfit_s: 120.0,
        }
    }
}

impl Check for Settings {
    fn check(&self) -> Vec<Fault> {
        let mut faults = Vec::new();
        within(&mut faults, "stale_s", self.stale_s, 0.1..=10.0, "seconds");
        within(
            &mut faults,
            "buffer_s",
            self.buffer_s,
            10.0..=600.0,
            "seconds",
        );
        within(
            &mut faults,
            "strength_tolerance",
            self.strength_tolerance,
            0.02..=1.0,
            "of the field",
        );
        within(
            &mut faults,
            "misfit_s",
            self.misfit_s,
            10.0..=3600.0,
            "seconds",
        );
        faults
    }
}
