//! Full turns: when the board has turned by 345° net, about the vertical or about an axis of its own.
//!
//! Two detectors count the same rotation: one about the vertical, however the board is held, and one about a
//! body axis that stays in place. The first to reach a full turn reports it, and both restart. They count net:
//! turning back subtracts.

use nalgebra::{UnitVector3, Vector3};

use crate::attitude::{BoardMotion, TICK_S};
use crate::check::settings;

mod chain;
#[cfg(test)]
mod tests;
mod vertical;

use chain::Chain;
use vertical::Vertical;

/// Progress, as a share of a turn, from which the detector about the vertical takes precedence.
const ABOUT_TO_TURN: f64 = 0.9;
/// From then on the chain's detector waits for that one for this much rotation, radians (20°), and without limit while that one waits for
/// the rest of a turn.
const PATIENCE_RAD: f64 = 0.35;

/// Highest mean rate of a full turn, degrees a second: a faster one means that the gyro's unit is wrong.
const FASTEST_DEG_S: f64 = 360.0;

/// A full turn that the board has made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turn {
    /// When it began, seconds.
    pub start_s: f64,
    /// When it was complete, seconds.
    pub end_s: f64,
    /// Unit vector in the body frame about which the board turned, right-handed.
    pub axis_body: Vector3<f64>,
    /// Angle between the axis and the vertical, 0 to 90 degrees, if the vertical is known.
    pub from_vertical_deg: Option<f64>,
}

settings! {
    /// Settings of the turn detection.
    #[derive(Copy)]
    pub struct Settings {
        /// Net rotation that makes a turn, degrees.
        angle_deg: f64 = 345.0, 180.0..=720.0, "degrees";
        /// How far the axis of a turn about a body axis may stray, degrees.
        axis_tolerance_deg: f64 = 25.0, 5.0..=45.0, "degrees";
        /// A rotation that takes longer is no turn, seconds.
        time_limit_s: f64 = 120.0, 5.0..=600.0, "seconds";
    }
}

/// Finds full turns, tick by tick.
pub struct TurnDetector {
    settings: Settings,
    vertical: Vertical,
    chain: Chain,
    newest_s: Option<f64>,
}

impl TurnDetector {
    /// A detector that has seen no rotation yet.
    pub fn new(settings: &Settings) -> Self {
        Self {
            settings: *settings,
            vertical: Vertical::new(settings),
            chain: Chain::new(settings),
            newest_s: None,
        }
    }

    /// Takes the next tick; returns the turn that it completes, unless that is too fast for one.
    ///
    /// A gap between ticks resets the count.
    pub fn tick(&mut self, tick: &BoardMotion) -> Option<Turn> {
        let follows = |newest_s| (0.0..=1.5 * TICK_S).contains(&(tick.t_s - newest_s));
        if !self.newest_s.is_some_and(follows) {
            self.reset();
        }
        self.newest_s = Some(tick.t_s);
        let vertical = if tick.pose.vertical_known {
            self.vertical.tick(tick)
        } else {
            self.vertical = Vertical::new(&self.settings);
            None
        };
        let patience_rad = if self.vertical.waits {
            f64::INFINITY
        } else if self.vertical.progress() > ABOUT_TO_TURN {
            PATIENCE_RAD
        } else {
            0.0
        };
        let turn = vertical.or_else(|| self.chain.tick(tick, patience_rad));
        if turn.is_some() {
            // The other detector must not count the same rotation again.
            self.reset();
            self.newest_s = Some(tick.t_s);
        }
        let shortest_s = self.settings.angle_deg / FASTEST_DEG_S;
        turn.filter(|turn| turn.end_s - turn.start_s >= shortest_s)
    }

    /// How much of a turn the detector that is further on has counted, 0 to 1.
    pub fn progress(&self) -> f64 {
        self.vertical
            .progress()
            .max(self.chain.progress())
            .clamp(0.0, 1.0)
    }

    /// Forgets what has been counted.
    pub fn reset(&mut self) {
        *self = Self::new(&self.settings);
    }
}

/// Angle between an axis, either way round, and the vertical, degrees; `None` if there is no axis.
fn from_vertical_deg(axis_earth: Vector3<f64>) -> Option<f64> {
    let axis = UnitVector3::try_new(axis_earth, 1e-9)?;
    Some(axis.z.abs().min(1.0).acos().to_degrees())
}
