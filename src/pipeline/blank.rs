//! Headings that say nothing of north.

use nalgebra::Vector3;

use super::{Action, Pipeline};
use crate::attitude::Tilt;
use crate::condition::Condition;
use crate::heading::{Heading, MagStatus};

impl Pipeline {
    /// A reading that overflowed still counts and still tells the tilt, but no field and no heading.
    pub(super) fn publish_without_field(&mut self, t_s: f64, actions: &mut Vec<Action>) {
        let condition = self
            .report
            .as_ref()
            .map_or(Condition::Stale, |report| report.condition);
        let down = self.attitude.down(t_s);
        let mut heading = self.heading(t_s, down.as_ref(), condition);
        heading.mag_status = MagStatus::HighField;
        actions.push(Action::Publish(heading));
    }

    /// One with nothing in it but time and tilt.
    pub(super) fn heading(
        &mut self,
        t_s: f64,
        down: Option<&Vector3<f64>>,
        condition: Condition,
    ) -> Heading {
        self.seq += 1;
        let tilt = down.map(Tilt::of_down);
        Heading {
            seq: self.seq,
            t_s,
            condition,
            fused_deg: None,
            instantaneous_deg: None,
            raw_deg: None,
            sd_deg: None,
            pitch_deg: tilt.map(|tilt| tilt.pitch_rad.to_degrees()),
            roll_deg: tilt.map(|tilt| tilt.roll_rad.to_degrees()),
            field_mgauss: None,
            strength_mgauss: None,
            mag_status: MagStatus::Calibration,
        }
    }
}
