//! What can be set about the pipeline itself.

use crate::check::{Fault, settings};

settings! {
    /// Settings of the pipeline itself; those of its rooms stand with them.
    #[derive(Copy)]
    pub struct Settings {
        /// A magnetometer sample older than this is stale, and no heading is published.
        stale_s: f64 = 0.5, 0.1..=10.0, "seconds";
        /// Samples are kept this long for a calibration, and so the first of two turns may be this old.
        buffer_s: f64 = 120.0, 10.0..=600.0, "seconds";
        /// A heading is published once its deviation is below this.
        publish_sd_deg: f64 = 10.0, 1.0..=45.0, "degrees";
        /// The state is `good` once the deviation is below this, and `degraded` with reason `learning` before.
        good_sd_deg: f64 = 3.0, 0.5..=20.0, "degrees";
    }
    also Settings::check_order;
}

impl Settings {
    /// Else a state could be good without a heading.
    fn check_order(&self, faults: &mut Vec<Fault>) {
        if self.good_sd_deg > self.publish_sd_deg {
            let right = format!("at most publish_sd_deg, which is {}", self.publish_sd_deg);
            faults.push(Fault::new(
                "good_sd_deg",
                self.good_sd_deg.to_string(),
                right,
            ));
        }
    }
}
