//! The accelerometer's readings, on the even clock and low-passed.

use nalgebra::{UnitQuaternion, Vector3};

use super::clock::TICK_S;

/// An accelerometer that is silent for longer is absent, seconds.
const SILENT_S: f64 = 1.0;
/// A reading is used for at most this long, seconds: the board goes on turning.
const HOLD_S: f64 = 0.1;
/// The force is low-passed over this time for those who compare it with gravity, seconds: vibration is shorter.
const LOW_PASS_S: f64 = 0.2;
/// The deviation of `down` is averaged over this time, seconds.
const SHAKEN_S: f64 = 2.0;
/// Gravity, m/s²: within half a percent anywhere.
pub const GRAVITY_M_S2: f64 = 9.81;
/// Weaker readings point nowhere: a dead part answers zeros.
const LEAST_M_S2: f64 = 0.1;

/// Specific force in the body frame, m/s².
#[derive(Default)]
pub(super) struct ForceReadings {
    previous: Option<(f64, Vector3<f64>)>,
    newest: Option<(f64, Vector3<f64>)>,
    /// The newest, turned into the current body axes.
    carried: Vector3<f64>,
    /// The force low-passed once, twice and three times.
    low_passed: [Vector3<f64>; 3],
    /// Mean square of what is left of the low pass's lag in `down`, m²/s⁴.
    lag2: f64,
    /// Mean square of what its strength differs from gravity's, m²/s⁴.
    length_error2: f64,
    /// Sum and count of the readings since the last tick.
    since_tick: (Vector3<f64>, u32),
}

impl ForceReadings {
    /// Takes a reading; one that cannot be a specific force is passed over.
    pub(super) fn take(&mut self, t_s: f64, force: Vector3<f64>) {
        if force.norm() < LEAST_M_S2 {
            return;
        }
        match self.newest {
            Some((newest_s, _)) if (0.0..HOLD_S).contains(&(t_s - newest_s)) => {
                let gain = 1.0 - (-(t_s - newest_s) / LOW_PASS_S).exp();
                let mut input = force;
                for stage in &mut self.low_passed {
                    *stage += (input - *stage) * gain;
                    input = *stage;
                }
                let [once, twice, thrice] = self.low_passed;
                let off = once.norm() - GRAVITY_M_S2;
                let left = once - 2.0 * twice + thrice;
                let gain = 1.0 - (-(t_s - newest_s) / SHAKEN_S).exp();
                self.length_error2 += (off * off - self.length_error2) * gain;
                self.lag2 += (left.norm_squared() - self.lag2) * gain;
            }
            // A step back by less than `SILENT_S` is a late reading.
            Some((newest_s, _)) if (-SILENT_S..0.0).contains(&(t_s - newest_s)) => return,
            // The board may have turned meanwhile.
            _ => {
                self.low_passed = [force; 3];
                self.since_tick = Default::default();
            }
        }
        self.previous = self.newest;
        self.newest = Some((t_s, force));
        self.carried = force;
        self.since_tick.0 += force;
        self.since_tick.1 += 1;
    }

    /// Specific force for the tick that ends at `end_s`, in which the board turns at `rate` (rad/s): the mean if several readings fell into
    /// it; otherwise a point on the line between the last two; after the newest reading, that reading turned with the board. `None` if no
    /// reading is recent enough.
    pub(super) fn take_tick(&mut self, end_s: f64, rate: &Vector3<f64>) -> Option<Vector3<f64>> {
        let (newest_s, newest) = self.newest.filter(|(t, _)| end_s - t <= HOLD_S)?;
        let since_s = (end_s - newest_s).clamp(0.0, TICK_S);
        let turn = UnitQuaternion::from_scaled_axis(rate * since_s);
        self.carried = turn.inverse_transform_vector(&self.carried);
        let (sum, count) = std::mem::take(&mut self.since_tick);
        if count > 1 {
            return Some(sum / f64::from(count));
        }
        let earlier = self.previous.filter(|(t, _)| *t < newest_s);
        let Some((previous_s, previous)) = earlier.filter(|_| end_s < newest_s) else {
            return Some(self.carried);
        };
        let part = ((end_s - previous_s) / (newest_s - previous_s)).max(0.0);
        Some(previous + (newest - previous) * part)
    }

    /// Standard deviation of `down`, radians. The board's accelerations, now and of late, show along gravity only; across it they are taken to
    /// be as large.
    pub(super) fn down_sd_rad(&self) -> f64 {
        let now = self.low_passed[0].norm() - GRAVITY_M_S2;
        (self.length_error2.max(now * now) + self.lag2).sqrt() / GRAVITY_M_S2
    }

    /// Specific force low-passed over 0.2 s; `None` while the accelerometer is silent.
    pub(super) fn low_passed(&self, t_s: f64) -> Option<Vector3<f64>> {
        self.live(t_s).then_some(self.low_passed[0])
    }

    /// Down, a unit vector of body axes, by the specific force less the accelerometer's bias, m/s². `None` while it is silent. On a board
    /// that tilts steadily a low pass lags by its time; double smoothing (Brown, 1956) does not, and what is left of the lag is about the
    /// second difference of the stages.
    pub(super) fn down(&self, t_s: f64, bias: &Vector3<f64>) -> Option<Vector3<f64>> {
        let [once, twice, _] = self.low_passed;
        let force = self.live(t_s).then_some(2.0 * once - twice - bias)?;
        (-force).try_normalize(1e-9)
    }

    /// Time since the newest reading, seconds.
    pub(super) fn held_s(&self, t_s: f64) -> f64 {
        self.newest
            .map_or(0.0, |(newest_s, _)| (t_s - newest_s).max(0.0))
    }

    /// The newest reading; `None` while the accelerometer is silent.
    pub(super) fn newest(&self, t_s: f64) -> Option<Vector3<f64>> {
        let (_, force) = self.newest?;
        self.live(t_s).then_some(force)
    }

    /// Whether there is recent accelerometer data.
    pub(super) fn live(&self, t_s: f64) -> bool {
        self.newest
            .is_some_and(|(newest_s, _)| (t_s - newest_s).abs() <= SILENT_S)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tick_gets_the_line_the_mean_or_nothing() {
        let mut readings = ForceReadings::default();
        let still = Vector3::zeros();
        assert_eq!(readings.take_tick(0.0, &still), None);
        readings.take(0.0, Vector3::x());
        readings.take(0.04, Vector3::x() * 5.0);
        readings.take(0.041, Vector3::x() * 3.0);
        assert_eq!(readings.take_tick(0.04, &still), Some(Vector3::x() * 3.0));
        readings.take(0.081, Vector3::x() * 5.0);
        assert_eq!(readings.take_tick(0.061, &still), Some(Vector3::x() * 4.0));
        assert_eq!(readings.take_tick(0.09, &still), Some(Vector3::x() * 5.0));
        assert_eq!(readings.take_tick(0.2, &still), None);
        assert!(readings.live(0.2) && !readings.live(1.09));
        assert_eq!(readings.low_passed(1.09), None);
    }

    #[test]
    fn what_was_felt_before_a_silence_is_not_down() {
        let mut readings = ForceReadings::default();
        for count in 0..200 {
            readings.take(f64::from(count) * 0.01, Vector3::x() * GRAVITY_M_S2);
        }
        assert_eq!(readings.down_sd_rad(), 0.0);
        readings.take(2.2, Vector3::y() * (GRAVITY_M_S2 + 2.0));
        assert_eq!(readings.down(2.2, &Vector3::zeros()), Some(-Vector3::y()));
        assert!(readings.down_sd_rad() > 0.2);
    }

    /// An accelerometer that is read ten times a second, on a board that turns by a quarter meanwhile.
    #[test]
    fn a_reading_that_is_held_turns_with_the_board() {
        let mut readings = ForceReadings::default();
        readings.take(0.0, Vector3::x());
        let rate = Vector3::z() * std::f64::consts::FRAC_PI_2 / 0.1;
        let ends_s = (1..=10).map(|tick| f64::from(tick) * TICK_S);
        let held = ends_s.map(|end_s| readings.take_tick(end_s, &rate).unwrap());
        let last = held.last().unwrap();
        assert!((last + Vector3::y()).norm() < 1e-9, "{last}");
    }

    #[test]
    fn a_dead_accelerometer_has_no_readings() {
        let mut readings = ForceReadings::default();
        readings.take(0.0, Vector3::zeros());
        assert_eq!(readings.low_passed(0.0), None);
    }
}
