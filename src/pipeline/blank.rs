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

    /// One with nothing in it but time, tilt, and what gyro and accelerometer say.
    pub(super) fn heading(
        &mut self,
        t_s: f64,
        down: Option<&Vector3<f64>>,
        condition: Condition,
    ) -> Heading {
        self.seq += 1;
        let tilt = down.map(Tilt::of_down);
        let rate_rad_s = (self.attitude.pose_at(t_s)).map(|_| self.attitude.rate_rad_s());
        // Without an accelerometer the board is taken to be level, as for its heading.
        let down = down.copied().unwrap_or_else(Vector3::z);
        Heading {
            pitch_deg: tilt.map(|tilt| tilt.pitch_rad.to_degrees()),
            roll_deg: tilt.map(|tilt| tilt.roll_rad.to_degrees()),
            turn_deg_min: rate_rad_s.map(|rate| 60.0 * rate.dot(&down).to_degrees()),
            rate_deg_s: rate_rad_s.map(|rate| rate.map(f64::to_degrees).into()),
            specific_force_m_s2: self.attitude.specific_force_m_s2(t_s).map(Into::into),
            mag_status: MagStatus::Calibration,
            ..Heading::unknown(self.seq, t_s, condition)
        }
    }
}
