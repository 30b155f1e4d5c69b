//! Whether the raw field stands still. A gyro's bias looks to the gyro like a slow steady turn; the magnetic
//! field tells them apart, calibrated or not.

use nalgebra::Vector3;

use crate::reading::HELD_S;

/// Time constants of a fast and a slow low-pass of the field, seconds.
const FAST_S: f64 = 0.3;
const SLOW_S: f64 = 1.5;
/// A steady turn of 2°/s moves a weak horizontal field, of 150 mG, further than this between the two filters.
const MOVED_MGAUSS: f64 = 5.0;
/// A second pair of filters, which part while the board swings slowly, as a boat at anchor does: 0.2°/s moves a weak
/// horizontal field further than that between them.
const DRIFT_FAST_S: f64 = 2.0;
const DRIFT_SLOW_S: f64 = 20.0;
/// After a turn the second pair restarts, and it is used again this long afterwards, seconds: by then a swing of 0.6°/s separates its two
/// filters.
const SETTLED_S: f64 = 10.0;
/// Margin for noise on top of `MOVED_MGAUSS`: so many deviations of what noise makes of the fast low-pass, and at most so much; more would
/// hide a turn.
const NOISE_SDS: f64 = 2.5;
const NOISE_MARGIN_LIMIT_MGAUSS: f64 = 15.0;
/// A field that moves counts as still again below this share of the limit, so that the answer does not flicker.
const STOPS: f64 = 0.6;
/// A larger step from one reading to the next is a spike, not noise.
const SPIKE_MGAUSS: f64 = 50.0;
/// The field cannot be called steady before this time, seconds; rest takes 1.5 s more to be seen.
const WARM_UP_S: f64 = 0.5;
/// A magnetometer that is silent for longer tells nothing, and its filters restart, seconds.
const SILENT_S: f64 = 1.0;

/// Two pairs of low-passes of the raw field, a fast and a slow one each, which part while the board turns.
#[derive(Default)]
pub(super) struct FieldMotion {
    filters: Option<LowPasses>,
}

struct LowPasses {
    since_s: f64,
    newest_s: f64,
    newest: Vector3<f64>,
    fast: Vector3<f64>,
    slow: Vector3<f64>,
    drift_fast: Vector3<f64>,
    drift_slow: Vector3<f64>,
    /// When the newest sample came. Rows may repeat it until there is a new one.
    measured_s: f64,
    /// Slow mean of the squared step from sample to sample, and of the time between them.
    step_squared: f64,
    step_s: f64,
    moving: bool,
    /// Time since the first pair was last apart, seconds.
    quiet_s: f64,
}

impl FieldMotion {
    /// Takes a whole field, milligauss.
    pub(super) fn take(&mut self, t_s: f64, field: Vector3<f64>) {
        let silent = |filters: &LowPasses| !(0.0..=SILENT_S).contains(&(t_s - filters.newest_s));
        if self.filters.as_ref().is_none_or(silent) {
            self.filters = Some(LowPasses {
                since_s: t_s,
                newest_s: t_s,
                measured_s: t_s,
                newest: field,
                fast: field,
                slow: field,
                drift_fast: field,
                drift_slow: field,
                step_squared: 0.0,
                step_s: 0.0,
                moving: false,
                quiet_s: f64::INFINITY,
            });
        } else if let Some(filters) = &mut self.filters {
            filters.take(t_s, field);
        }
    }

    /// Whether the field moves; `None` if the magnetometer is silent.
    pub(super) fn moving(&self, t_s: f64) -> Option<bool> {
        let filters = self.filters.as_ref()?;
        if (t_s - filters.newest_s).abs() > SILENT_S {
            return None;
        }
        Some(filters.moving || filters.newest_s - filters.since_s < WARM_UP_S)
    }
}

impl LowPasses {
    fn take(&mut self, t_s: f64, field: Vector3<f64>) {
        let dt_s = t_s - self.newest_s;
        let gain_over = |dt_s: f64, tau_s: f64| 1.0 - (-dt_s / tau_s.max(1e-3)).exp();
        // At first all samples have the same weight. Otherwise a noisy first sample would look like motion.
        let age_s = t_s - self.since_s;
        let gain = |tau_s: f64| gain_over(dt_s, tau_s.min(age_s));
        self.fast += (field - self.fast) * gain(FAST_S);
        self.slow += (field - self.slow) * gain(SLOW_S);
        self.drift_fast += (field - self.drift_fast) * gain(DRIFT_FAST_S);
        self.quiet_s += dt_s;
        self.drift_slow += (field - self.drift_slow) * gain(DRIFT_SLOW_S.min(self.quiet_s));
        if field != self.newest || t_s - self.measured_s >= HELD_S {
            let step = (field - self.newest).norm().min(SPIKE_MGAUSS);
            let step_s = t_s - self.measured_s;
            let slow = gain_over(step_s, SLOW_S);
            self.step_squared += (step * step - self.step_squared) * slow;
            self.step_s += (step_s - self.step_s) * slow;
            (self.measured_s, self.newest) = (t_s, field);
        }
        self.newest_s = t_s;

        let noise = (0.5 * self.step_squared * self.step_s / (2.0 * FAST_S)).sqrt();
        let unmoved = MOVED_MGAUSS + (NOISE_SDS * noise).min(NOISE_MARGIN_LIMIT_MGAUSS);
        let limit = if self.moving {
            STOPS * unmoved
        } else {
            unmoved
        };
        if (self.fast - self.slow).norm() > limit {
            self.quiet_s = 0.0;
            self.drift_fast = self.fast;
            self.drift_slow = self.fast;
        }
        let drifts = (self.drift_fast - self.drift_slow).norm() > limit;
        self.moving = drifts || self.quiet_s < SETTLED_S;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A field turning at `rate_deg_s` with noise of `noise_mgauss`, for 20 s at 50 Hz: what part of the
    /// last 15 s was called moving.
    fn moving_part(rate_deg_s: f64, noise_mgauss: f64) -> f64 {
        let mut motion = FieldMotion::default();
        let mut moving = 0;
        for i in 0..1000 {
            let t = i as f64 * 0.02;
            let noise = noise(i, noise_mgauss);
            motion.take(t, turned((rate_deg_s * t).to_radians()) + noise);
            if t >= 5.0 && motion.moving(t) == Some(true) {
                moving += 1;
            }
        }
        f64::from(moving) / 750.0
    }

    /// Three incommensurable sines stand in for noise of this standard deviation, milligauss.
    fn noise(sample: usize, sd: f64) -> Vector3<f64> {
        Vector3::new(2.1, 1.3, 1.7).map(|k| sd * 2f64.sqrt() * (k * sample as f64).sin())
    }

    /// The field of a board that has turned by this angle, radians.
    fn turned(angle: f64) -> Vector3<f64> {
        Vector3::new(180.0 * angle.cos(), -180.0 * angle.sin(), 420.0)
    }

    /// A chip at 10 Hz, and rows at 100 Hz that repeat its last sample.
    #[test]
    fn a_sample_that_rows_repeat_is_one_sample() {
        let noisy = |repeated: u32| {
            let mut motion = FieldMotion::default();
            for row in 0..200 * repeated {
                let wobble = 20.0 * f64::from(row / repeated * 21).sin();
                let t_s = f64::from(row) * 0.1 / f64::from(repeated);
                motion.take(t_s, Vector3::new(180.0 + wobble, 80.0, 420.0));
            }
            let filters = motion.filters.unwrap();
            filters.step_squared * filters.step_s
        };
        let ratio = noisy(10) / noisy(1);
        assert!((0.8..1.25).contains(&ratio), "{ratio}");
    }

    #[test]
    fn a_slow_turn_moves_the_field_and_noise_does_not() {
        assert_eq!(moving_part(3.0, 0.0), 1.0);
        assert!(moving_part(3.0, 3.0) > 0.95);
        assert_eq!(moving_part(0.0, 0.0), 0.0);
        assert_eq!(moving_part(0.0, 5.0), 0.0);
    }

    #[test]
    fn a_noisy_first_sample_is_no_motion() {
        let mut motion = FieldMotion::default();
        let odd = Vector3::new(10.0, -8.0, 6.0);
        motion.take(0.0, turned(0.0) + odd);
        for i in 1..500 {
            let t = i as f64 * 0.02;
            motion.take(t, turned(0.0) + noise(i, 2.0));
            assert_eq!(motion.moving(t), Some(t < WARM_UP_S), "{t}");
        }
    }

    #[test]
    fn after_a_turn_the_field_is_steady_when_it_has_stood_still_for_ten_seconds() {
        let mut motion = FieldMotion::default();
        let mut steady_s = None;
        for i in 0..2000 {
            let t = i as f64 * 0.02;
            motion.take(t, turned(t.min(5.0)));
            if t > 5.0 && motion.moving(t) == Some(false) {
                steady_s.get_or_insert(t - 5.0);
            }
        }
        let steady_s = steady_s.unwrap();
        assert!((10.0..20.0).contains(&steady_s), "{steady_s}");
    }

    #[test]
    fn it_is_unknown_while_the_magnetometer_is_silent() {
        let mut motion = FieldMotion::default();
        assert_eq!(motion.moving(0.0), None);
        motion.take(0.0, Vector3::x());
        assert_eq!(motion.moving(0.5), Some(true));
        assert_eq!(motion.moving(1.5), None);
    }
}
