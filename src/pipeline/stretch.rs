//! A new stretch of readings, whose times have nothing to do with those before, and a board that is mounted otherwise.

use super::saturation::Saturation;
use super::{Pipeline, StreamTimes};
use crate::frame::Mountings;
use crate::reading::Reading;

impl Pipeline {
    /// Forgets all motion, and whatever is remembered by its time. Calibration, policy and the verdict on the last turn
    /// stay, and so do a calibration that is under way and the biases that go with the active one.
    pub(super) fn begin_stretch(&mut self) {
        let calibration = self.calibration();
        self.intake.begin_stretch(&self.setup, calibration.as_ref());
        self.buffer.clear();
        self.completed.clear();
        self.forget_waiting_turns();
        if let Some(job) = &mut self.job {
            job.end_s = f64::NEG_INFINITY;
        }
        self.sample = None;
        self.learning.begin_stretch();
        self.estimate.lose_frame();
        self.report = None;
        self.readings_s = None;
        self.awaited_s = f64::INFINITY;
        self.times = StreamTimes::default();
        self.strength_deviation = 0.0;
    }

    /// The chips are mounted otherwise. What is known of them is in their own axes and stays, as over a restart; what was
    /// carried along in body axes is forgotten.
    pub(super) fn mount(&mut self, mountings: Mountings) {
        let calibration = self.calibration();
        let force = self.intake.attitude.specific_force_m_s2(self.times.now_s);
        let last_force = Reading {
            t_s: self.times.now_s,
            specific_force_m_s2: force.map(|body| self.setup.mountings.accel.to_chip(body)),
            ..Reading::default()
        };
        self.setup.mountings = mountings;
        self.intake.saturation = Saturation::new(&mountings);
        self.discard_outcome();
        self.forget_estimate(calibration);
        self.begin_stretch();
        // Otherwise the accelerometer would count as silent until its next reading.
        self.intake.attitude.take(&last_force, |_| {});
    }
}
