//! What is done with every reading: impossible values are dropped, saturated axes emptied, and the board's motion followed.

use nalgebra::Vector3;

use super::Setup;
use super::newest::Newest;
use super::saturation::{RunState, Saturation};
use crate::attitude::{Attitude, Tick};
use crate::outliers::Outliers;
use crate::reading::Reading;
use crate::turn::{Turn, TurnDetector};

/// Takes readings in.
pub(super) struct Intake {
    outliers: Outliers,
    pub(super) saturation: Saturation,
    pub(super) attitude: Attitude,
    pub(super) turns: TurnDetector,
    newest: Newest,
}

impl Intake {
    pub(super) fn new(setup: &Setup) -> Self {
        Self {
            outliers: Outliers::new(setup.attitude.gyro_range_deg_s),
            saturation: Saturation::new(&setup.mountings),
            attitude: Attitude::new(&setup.attitude, &setup.mountings),
            turns: TurnDetector::new(&setup.turn),
            newest: Newest::default(),
        }
    }

    /// Takes a reading, and calls `on_tick` with each tick that it completes and the full turn that ends with the tick. Returns what sensors
    /// have measured of the reading, and the state of each axis of the magnetometer.
    pub(super) fn take(
        &mut self,
        reading: &Reading,
        mut on_tick: impl FnMut(&Tick, Option<Turn>),
    ) -> (Reading, [RunState; 3]) {
        let (reading, runs) = self.saturation.filter(&self.outliers.filter(reading));
        let turns = &mut self.turns;
        self.attitude
            .take(&reading, |tick| on_tick(tick, turns.tick(tick)));
        (reading, runs)
    }

    /// When the chip measured the field that came at `t_s`; `None` if the source repeats its last value.
    pub(super) fn measured_s(&mut self, t_s: f64, field_mgauss: Vector3<f64>) -> Option<f64> {
        let still = self.attitude.still();
        self.newest.take(t_s, field_mgauss, still)
    }

    /// Forgets all motion: the times that follow have nothing to do with those before.
    pub(super) fn begin_stretch(&mut self, setup: &Setup) {
        self.saturation.begin_stretch();
        self.attitude = Attitude::new(&setup.attitude, &setup.mountings);
        self.turns = TurnDetector::new(&setup.turn);
        self.newest = Newest::default();
    }

    /// How many values were dropped since no sensor can have measured them.
    pub(super) fn dropped(&self) -> u64 {
        self.outliers.dropped()
    }
}
