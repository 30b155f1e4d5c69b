//! A field that turns all the way round, again and again, while the gyro does not.
//!
//! A gyro whose rad/s are taken for degrees, or one that reads noise, predicts next to nothing. On a level board gravity does not move
//! either, so that `gyro_check` has no second reference, and a magnet beside the board may cause any single change. But a magnet does not
//! go round the board three times the same way. The field goes round the middle of what was seen, so that iron on the board does not
//! matter.

use std::f64::consts::TAU;

use nalgebra::Vector2;

use crate::estimate::filter::Input;
use crate::estimate::prior::FIELD_MGAUSS;
use crate::frame::wrap_pi;

/// A gyro is silent after so many turns of the field, radians. The first one finds the middle.
const SILENT_AFTER_RAD: f64 = 3.0 * TAU;
/// More of them count no more than this, so that a gyro that turns again is soon believed.
const MOST_RAD: f64 = 4.0 * TAU;
/// A gyro turns if it has read this share of the field's turns, about any axis. A board that only rolls and pitches has to lean by 6° to
/// move a field of 670 mG round a circle as wide as `LEAST_WIDTH`, and its gyro then reads sin 6° of the field's turns.
const TURNS: f64 = 0.1;
/// Three turns that take longer are not waited for, seconds: the gyro's bias adds up.
const LASTS_S: f64 = 300.0;
/// The field must cover this much on both axes, as a share of a usual field: noise and hum go round a smaller circle, and the horizontal
/// field up to a dip of 80° a larger one.
const LEAST_WIDTH: f64 = 0.3;

/// Counts the field's turns about the body axis that is nearest to the vertical.
#[derive(Clone, Debug, Default)]
pub(super) struct FieldTurns {
    axis: usize,
    /// Smallest and largest field on the other two axes, as shares of `FIELD_MGAUSS`.
    range: Option<(Vector2<f64>, Vector2<f64>)>,
    age_s: f64,
    /// Direction of the field from its middle at the sample before, radians.
    last_rad: Option<f64>,
    /// How far the field has turned about its middle, radians.
    field_rad: f64,
    /// Length of all rotations that the gyro has read, about any axis and either way, radians.
    gyro_rad: f64,
}

impl FieldTurns {
    /// No turns yet, about this body axis.
    fn about(axis: usize) -> Self {
        Self {
            axis,
            ..Self::default()
        }
    }

    /// Takes a sample.
    pub(super) fn take(&mut self, input: &Input) {
        let axis = input.upright_axis();
        self.age_s += input.period_s;
        let late = self.age_s > LASTS_S && !self.gyro_is_silent();
        if axis != self.axis || late {
            *self = Self::about(axis);
        }
        let field = input.field_mgauss.remove_row(axis) / FIELD_MGAUSS;
        let (low, high) = self.range.map_or((field, field), |(low, high)| {
            (low.inf(&field), high.sup(&field))
        });
        self.range = Some((low, high));
        self.gyro_rad += input.turned_rad.norm();
        if (high - low).min() < LEAST_WIDTH {
            return;
        }
        let from_middle = field - (low + high) / 2.0;
        let now_rad = from_middle.y.atan2(from_middle.x);
        let last_rad = self.last_rad.replace(now_rad).unwrap_or(now_rad);
        self.field_rad += wrap_pi(now_rad - last_rad);
        if self.gyro_rad > TURNS * self.field_rad.abs().max(TAU) {
            *self = Self::about(axis);
        } else if self.field_rad.abs() > MOST_RAD {
            let less = MOST_RAD / self.field_rad.abs();
            self.field_rad *= less;
            self.gyro_rad *= less;
        }
    }

    /// Whether the field has turned, and the gyro has not.
    pub(super) fn gyro_is_silent(&self) -> bool {
        self.field_rad.abs() >= SILENT_AFTER_RAD
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Rotation3, Vector3};

    use super::*;

    /// A level board with iron on it that turns at 29°/s, sampled at 10 Hz.
    #[derive(Default)]
    struct TurningBoard {
        turns: FieldTurns,
        angle_rad: f64,
    }

    impl TurningBoard {
        /// Turns on by so many turns, while the gyro reads this share of its rate.
        fn turn(&mut self, turns: f64, reads: f64) {
            let rate_rad_s = 0.5f64.copysign(turns);
            for _ in 0..(turns * TAU / rate_rad_s / 0.1).round() as u32 {
                self.angle_rad += rate_rad_s * 0.1;
                let to_frame = Rotation3::new(Vector3::z() * self.angle_rad);
                let field = to_frame.inverse() * Vector3::new(60.0, 190.0, -420.0);
                let iron = Vector3::new(90.0, -400.0, 150.0);
                let read = Vector3::z() * (rate_rad_s * reads);
                let input = Input::turning_at(to_frame.into_inner(), read, field + iron);
                self.turns.take(&input);
            }
        }
    }

    #[test]
    fn a_gyro_that_does_not_turn_as_the_field_does_three_times_is_silent() {
        // Nothing, and rad/s taken for degrees.
        for reads in [0.0, 0.017] {
            for way in [1.0, -1.0] {
                let mut board = TurningBoard::default();
                board.turn(way * 2.5, reads);
                assert!(!board.turns.gyro_is_silent());
                board.turn(way * 1.5, reads);
                assert!(board.turns.gyro_is_silent());
                board.turn(way * 20.0, reads);
                board.turn(way, 1.0);
                assert!(!board.turns.gyro_is_silent());
            }
        }
    }

    #[test]
    fn a_gyro_that_turns_or_sways_or_a_field_that_goes_to_and_fro_is_no_silence() {
        let mut board = TurningBoard::default();
        for _ in 0..10 {
            board.turn(2.0, 0.5);
            assert!(!board.turns.gyro_is_silent());
        }
        // Leaning by 8° all the way round, it shows the strongest field a wide circle.
        let mut coned = FieldTurns::default();
        for step in 0..2000 {
            let lies = |step: u32| {
                let round = Rotation3::new(Vector3::z() * (f64::from(step) * 0.1));
                round * Rotation3::new(Vector3::x() * 0.14) * round.inverse()
            };
            let (before, now) = (lies(step), lies(step + 1));
            let rate_rad_s = (before.inverse() * now).scaled_axis() / 0.1;
            let field = now.inverse() * Vector3::new(0.0, 30.0, -669.0);
            coned.take(&Input::turning_at(now.into_inner(), rate_rad_s, field));
            assert!(!coned.gyro_is_silent());
        }
        let mut waved = TurningBoard::default();
        for _ in 0..10 {
            waved.turn(0.8, 0.0);
            waved.turn(-0.8, 0.0);
            assert!(!waved.turns.gyro_is_silent());
        }
    }
}
