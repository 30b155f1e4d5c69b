//! The evidence for the condition, and which report is news.

use super::{Action, Pipeline};
use crate::condition::{self, Condition, Evidence, SourceFault};
use crate::estimate::GyroFault;
use crate::reading::Reading;

/// A field that was disturbed is called so until it has been calm for this long, seconds.
const CALM_S: f64 = 3.0;
/// Progress is news when it has changed by this share of a turn …
const PROGRESS_STEP: f64 = 0.05;
/// … and this much later than the last news of it, seconds.
const PROGRESS_EVERY_S: f64 = 0.25;

impl Pipeline {
    /// Judges the condition anew, and reports it if that is news.
    pub(super) fn update_condition(&mut self, actions: &mut Vec<Action>) -> Condition {
        // A magnetometer that has had no time to give a reading is not silent. Before the first reading time counts from 0.
        let first_s = self.readings_s.map_or(0.0, |(first_s, _)| first_s);
        let beginning = self.whole_field_s.max(self.overflow_s) < first_s
            && self.now_s - first_s <= self.setup.pipeline.stale_s;
        let fault = self.fault.as_ref().or(self.frozen.as_ref());
        if beginning && fault.is_none() {
            return Condition::Stale;
        }
        let gyro_live = self.now_s - self.rate_s <= self.setup.attitude.gap_s;
        let report = condition::judge(&Evidence {
            t_s: self.now_s,
            fault,
            silent_s: self.now_s - self.whole_field_s,
            overflowing: self.overflow_s > self.whole_field_s,
            stale_s: self.setup.pipeline.stale_s,
            calibrated: self.learning.calibrated,
            calibrating: self.job.is_some_and(|job| !job.unwanted),
            wanted: self.wanted().is_some(),
            turned: self.intake.turns.progress(),
            learnt: self.learnt(),
            motion_wanted: self.estimate.motion_wanted(),
            refused: self
                .refused
                .as_ref()
                .map(|(reason, message)| (*reason, message.as_str())),
            heading_sd_deg: self.sd_deg,
            good_sd_deg: self.setup.pipeline.good_sd_deg,
            strength_deviation: self.strength_deviation,
            impossible_mgauss: self.estimate.impossible_mgauss(),
            // Without a gyro the estimate sees nothing, and the field's strength is all that tells.
            disturbed: if gyro_live {
                self.now_s - self.disturbed_s < CALM_S
            } else {
                self.strength_deviation.abs() > condition::STRENGTH_TOLERANCE
            },
            tilt_known: self.intake.attitude.accelerometer_live(self.now_s),
            gyro_live,
            gyro_fault: if self.intake.attitude.clipping() {
                Some("gyro_clipped")
            } else {
                self.estimate.gyro_fault().map(GyroFault::reason)
            },
        });
        let condition = report.condition;
        let news = self.report.as_ref().is_none_or(|last| {
            let progressed = match (last.progress, report.progress) {
                (Some(old), Some(new)) => {
                    (new - old).abs() >= PROGRESS_STEP && report.t_s - last.t_s >= PROGRESS_EVERY_S
                }
                _ => false,
            };
            (last.condition, last.reason) != (condition, report.reason) || progressed
        });
        if news {
            self.report = Some(report.clone());
            actions.push(Action::Report(report));
        }
        condition
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
