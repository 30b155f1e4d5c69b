//! What is done with every reading: impossible values are dropped, saturated axes emptied, and the board's motion followed.

use nalgebra::Vector3;

use super::Setup;
use super::force_unit::ForceUnit;
use super::saturation::{RunState, Saturation};
use crate::attitude::{Attitude, BoardMotion, GRAVITY_M_S2, Lateness};
use crate::calibration::model::Calibration;
use crate::frozen::{AxisWatch, MOVING_RAD_S};
use crate::outliers::Outliers;
use crate::reading::{HELD_S, Reading};
use crate::turn::{Turn, TurnDetector};

/// A board at rest reads gravity at most, and an accelerometer's bias is a tenth of it.
const RESTING_M_S2: f64 = 1.1 * GRAVITY_M_S2;

/// Takes readings in.
pub(super) struct Intake {
    pub(super) outliers: Outliers,
    pub(super) saturation: Saturation,
    pub(super) attitude: Attitude,
    pub(super) turns: TurnDetector,
    /// The newest measurement of the magnetometer: when it came, and the field.
    newest: Option<(f64, Vector3<f64>)>,
    late: Lateness,
    pub(super) force_unit: ForceUnit,
    pub(super) gyro_axes: AxisWatch,
    pub(super) accel_axes: AxisWatch,
}

impl Intake {
    /// With a calibration, gyro and accelerometer are expected to have the biases that go with it.
    pub(super) fn new(setup: &Setup, calibration: Option<&Calibration>) -> Self {
        let mut attitude = Attitude::new(&setup.attitude, &setup.mountings);
        expect_biases(&mut attitude, calibration);
        Self {
            outliers: Outliers::new(setup.attitude.gyro_range_deg_s),
            saturation: Saturation::new(&setup.mountings),
            attitude,
            turns: TurnDetector::new(&setup.turn),
            newest: None,
            late: Lateness::default(),
            force_unit: ForceUnit::default(),
            gyro_axes: AxisWatch::up_to(MOVING_RAD_S),
            accel_axes: AxisWatch::up_to(RESTING_M_S2),
        }
    }

    /// Takes a reading, and calls `on_tick` with each tick that it completes and the full turn that ends with the tick. Returns the reading
    /// without what is no measurement, and the state of each magnetometer axis.
    pub(super) fn take(
        &mut self,
        reading: &Reading,
        mut on_tick: impl FnMut(&BoardMotion, Option<Turn>),
    ) -> (Reading, [RunState; 3]) {
        let (mut reading, runs) = self.saturation.filter(&self.outliers.filter(reading));
        if let Some(force) = reading.specific_force_m_s2 {
            self.force_unit.take(reading.t_s, force.norm());
            reading.specific_force_m_s2 = self.accel_axes.take(reading.t_s, force);
        }
        if let Some(rate) = reading.rate_rad_s {
            reading.rate_rad_s = self.gyro_axes.take(reading.t_s, rate);
        }
        let turns = &mut self.turns;
        self.attitude
            .take(&reading, |tick| on_tick(tick, turns.tick(tick)));
        (reading, runs)
    }

    /// When the chip measured the field that came at `t_s`, not corrected for its lag; `None` if the source repeats the last
    /// value, as one does that reads faster than the chip measures. Noise makes every measurement differ. A host that pauses
    /// gives values late.
    pub(super) fn measured_s(&mut self, t_s: f64, field_mgauss: Vector3<f64>) -> Option<f64> {
        let still = self.attitude.still();
        let held = |(since_s, last): (f64, Vector3<f64>)| {
            field_mgauss == last && !(still && t_s - since_s >= HELD_S)
        };
        if self.newest.is_some_and(held) {
            return None;
        }
        self.newest = Some((t_s, field_mgauss));
        Some(t_s - self.late.take(t_s))
    }

    /// Forgets all motion: what follows does not go on from what was before. Gyro and accelerometer keep this calibration's
    /// biases.
    pub(super) fn begin_stretch(&mut self, setup: &Setup, calibration: Option<&Calibration>) {
        self.saturation.begin_stretch();
        self.renew_attitude(setup, calibration);
        self.newest = None;
        self.late = Lateness::default();
        self.force_unit = ForceUnit::default();
        self.gyro_axes = AxisWatch::up_to(MOVING_RAD_S);
        self.accel_axes = AxisWatch::up_to(RESTING_M_S2);
    }

    /// Forgets how the board lay and turned. Gyro and accelerometer keep the biases of this calibration.
    pub(super) fn renew_attitude(&mut self, setup: &Setup, calibration: Option<&Calibration>) {
        self.attitude.renew(&setup.attitude, &setup.mountings);
        expect_biases(&mut self.attitude, calibration);
        self.turns = TurnDetector::new(&setup.turn);
    }
}

/// Gyro and accelerometer are expected to have the biases that go with this calibration.
fn expect_biases(attitude: &mut Attitude, calibration: Option<&Calibration>) {
    let Some(calibration) = calibration else {
        return;
    };
    if let Some(bias_deg_s) = calibration.gyro_bias_deg_s {
        attitude.expect_gyro_bias(bias_deg_s.map(f64::to_radians));
    }
    expect_force_bias(attitude, calibration);
}

/// The accelerometer is expected to have the bias that goes with this calibration, or none: its parameters are right only with the tilt
/// that results.
pub(super) fn expect_force_bias(attitude: &mut Attitude, calibration: &Calibration) {
    attitude.expect_force_bias(calibration.accel_bias_m_s2.unwrap_or_default());
}
