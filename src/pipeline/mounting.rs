//! A board that is told how it is mounted.

use nalgebra::Vector3;

use super::Pipeline;
use super::saturation::Saturation;
use crate::frame::Mountings;
use crate::reading::Reading;

impl Pipeline {
    /// Where down is now, a unit vector of body axes, and how fast the board turns, rad/s; `None` while nothing feels it.
    pub fn down(&self) -> Option<(Vector3<f64>, f64)> {
        let down = self.intake.attitude.down(self.now_s)?;
        let rate_rad_s = self.rate_rad_s(self.now_s);
        Some((down, rate_rad_s.map_or(0.0, |rate| rate.norm())))
    }

    /// The chips are mounted otherwise. What is known of them is in their own axes and stays, as over a restart; what was
    /// carried along in body axes is forgotten.
    pub(super) fn mount(&mut self, mountings: Mountings) {
        let calibration = self.calibration();
        let force = self.intake.attitude.specific_force_m_s2(self.now_s);
        let last_force = Reading {
            t_s: self.now_s,
            specific_force_m_s2: force.map(|body| self.setup.mountings.accel.to_chip(body)),
            ..Reading::default()
        };
        self.setup.mountings = mountings;
        self.intake.saturation = Saturation::new(&mountings);
        self.discard_outcome();
        self.forget_estimate(calibration);
        self.begin_stretch(calibration.as_ref());
        // Otherwise the accelerometer would count as silent until its next reading.
        self.intake.attitude.take(&last_force, |_| {});
    }
}
