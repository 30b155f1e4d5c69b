//! When to ask for a calibration, and on which samples.

use nalgebra::Vector3;

use super::{Action, CalibrationJob, Pipeline};
use crate::calibration::plane::show_space;
use crate::calibration::settings::ModeChoice;
use crate::calibration::{CompletedTurn, FieldSample, Request, last_rest};
use crate::turn::Turn;

/// Limits the buffer to samples of this rate, that of the fastest chip which headingd drives, an HMC5983. Of a faster serial board it
/// keeps less than `buffer_s`.
const FASTEST_MAG_HZ: f64 = 220.0;

/// Two turns that follow each other within this time and about the same axis calibrate together, seconds: as in the paper's tests. More
/// than two would cost more with each turn of a board that keeps turning.
const TURNS_FOLLOW_S: f64 = 3.0;

/// A planar calibration is of use for headings only if its turn was about the vertical, within this angle.
const LEVEL_TURN_DEG: f64 = 30.0;

/// Whether a planar calibration on this turn is of use.
pub(super) fn is_level(turn: &Turn) -> bool {
    turn.from_vertical_deg
        .is_none_or(|angle| angle < LEVEL_TURN_DEG)
}

impl Pipeline {
    /// Keeps a sample for a calibration, and drops what is too old or exceeds the buffer.
    pub(super) fn buffer_sample(&mut self, t_s: f64, field_mgauss: Vector3<f64>) {
        let pose = self.intake.attitude.pose_at(t_s);
        self.buffer.push_back(FieldSample {
            t_s,
            field_mgauss,
            pose,
        });
        let oldest_s = t_s - self.setup.pipeline.buffer_s;
        let most = (self.setup.pipeline.buffer_s * FASTEST_MAG_HZ) as usize;
        let old = self.buffer.partition_point(|one| one.t_s < oldest_s);
        let surplus = self.buffer.len().saturating_sub(most);
        self.buffer.drain(..old.max(surplus));
        self.drop_turns_before(oldest_s);
    }

    fn drop_turns_before(&mut self, oldest_s: f64) {
        let old = self
            .completed
            .partition_point(|turn| turn.start_s < oldest_s);
        self.completed.drain(..old);
    }

    /// Takes note of a full turn.
    pub(super) fn turned(&mut self, turn: Turn, actions: &mut Vec<Action>) {
        // Turns need no magnetometer, so samples that would drop old turns may be missing.
        self.drop_turns_before(turn.end_s - self.setup.pipeline.buffer_s);
        self.completed.push_back(turn);
        actions.push(Action::Turned(turn));
        match &mut self.job {
            Some(job) => job.again = true,
            None => self.ask_for_calibration(actions),
        }
    }

    /// Asks for a calibration on the turns just completed, if they allow one.
    pub(super) fn ask_for_calibration(&mut self, actions: &mut Vec<Action>) {
        let Some(origin) = self.wanted() else {
            return;
        };
        let Some(request) = self.request() else {
            return;
        };
        self.job = Some(CalibrationJob {
            origin,
            unwanted: false,
            again: false,
            end_s: self
                .completed
                .back()
                .map_or(self.times.now_s, |turn| turn.end_s),
        });
        actions.push(Action::Calibrate(Box::new(request)));
    }

    fn request(&self) -> Option<Request> {
        let last = self.completed.back()?;
        let settings = &self.setup.calibration;
        let axes = self.completed.iter().map(|turn| turn.axis_body);
        let spatial = settings.mode != ModeChoice::Planar && show_space(axes, settings);
        if !spatial && (settings.mode == ModeChoice::Spatial || !is_level(last)) {
            return None;
        }
        let count = if spatial {
            self.completed.len()
        } else {
            self.turns_together()
        };
        let turns = self.completed.range(self.completed.len() - count..);
        let window = turns.clone().next()?.start_s..=last.end_s;
        let from = self
            .buffer
            .partition_point(|sample| sample.t_s < *window.start());
        let samples: Vec<_> = (self.buffer.range(from..))
            .take_while(|sample| window.contains(&sample.t_s))
            .copied()
            .collect();
        let turns = turns
            .map(|turn| CompletedTurn::among(&samples, turn))
            .collect();
        Some(Request {
            moving: 0..samples.len(),
            rest: last_rest(self.buffer.range(..from)),
            samples,
            turns,
            plane: None,
            mounting: self.setup.mountings.mag,
            settings: settings.clone(),
            limits: self.setup.verdict.clone(),
        })
    }

    /// How many of the newest turns calibrate together.
    fn turns_together(&self) -> usize {
        let mut newest_first = self.completed.iter().rev();
        let (Some(later), Some(earlier)) = (newest_first.next(), newest_first.next()) else {
            return 1;
        };
        let tolerance = self.setup.turn.axis_tolerance_deg.to_radians().cos();
        let follows = later.start_s - earlier.end_s < TURNS_FOLLOW_S
            && earlier.end_s > self.times.bad_turn_s
            && earlier.axis_body.dot(&later.axis_body).abs() > tolerance;
        if follows { 2 } else { 1 }
    }
}
