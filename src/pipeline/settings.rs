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
    /// A heading is published once its deviation is below this: 1 to 45 degrees.
    pub publish_sd_deg: f64,
    /// The state is `good` once the deviation is below this, and `degraded` with reason `learning` before:
    /// 0.5 to 20 degrees.
    pub good_sd_deg: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            stale_s: 0.5,
            buffer_s: 120.0,
            publish_sd_deg: 10.0,
            good_sd_deg: 3.0,
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
            "publish_sd_deg",
            self.publish_sd_deg,
            1.0..=45.0,
            "degrees",
        );
        within(
            &mut faults,
            "good_sd_deg",
            self.good_sd_deg,
            0.5..=20.0,
            "degrees",
        );
        // Else a state could be good without a heading.
        if self.good_sd_deg > self.publish_sd_deg {
            faults.push(Fault {
                key: "good_sd_deg".to_owned(),
                found: self.good_sd_deg.to_string(),
                right: format!("at most publish_sd_deg, which is {}", self.publish_sd_deg),
            });
        }
        faults
    }
}
