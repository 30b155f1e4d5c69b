//! How fast the gyro's bias walks, by how it moves.
//!
//! A filter that expects a slow walk follows a chip that warms up too late: by data sheets its bias changes by 0.16 (MPU-6050) to 0.32 °/s
//! (ITG-3200) a kelvin, and a board gets some kelvin warmer within minutes. Over a window of length T, a filter with covariance P and
//! walk q expects its bias to move by the variance P_before + q T − P_after. The walk is set so that the bias moves by as much:
//! covariance matching (Mehra, IEEE Trans. Autom. Control 17, 1972).

use nalgebra::{Matrix3, Vector3};

/// Least walk of a gyro's bias, rad/s per √s: 0.3°/s in an hour.
pub(super) const LEAST_WALK_RAD_S: f64 = 0.000_087;
/// Most, rad/s per √s: an ITG-3200 that gets ten kelvin warmer in two minutes moves by 0.8°/s in a window.
const MOST_WALK_RAD_S: f64 = 0.0025;
/// Length of a window, seconds: some time constants of a filter whose bias drifts. Half or twice as much serves as well.
const WINDOW_S: f64 = 30.0;
/// The share of what a window shows that counts: the square of a single move scatters by as much as its mean.
const COUNTS: f64 = 0.5;

/// Follows the walk of a filter's bias.
#[derive(Clone, Debug, Default)]
pub struct BiasWalk {
    /// Bias and covariance when the window began, body axes.
    before: Option<(Vector3<f64>, Matrix3<f64>)>,
    window_s: f64,
    /// Variance that has been added on each axis since then, (rad/s)².
    added2: f64,
    /// Walk beyond the least one, (rad/s)² per second.
    beyond2: f64,
}

impl BiasWalk {
    /// Takes the bias that a filter has learnt, body axes, rad/s, its covariance, and the projection on what the filter sees of it. Returns the variance
    /// by which the bias walks on each axis within `period_s`, (rad/s)².
    pub fn take(
        &mut self,
        bias: &Vector3<f64>,
        covariance: &Matrix3<f64>,
        seen: &Matrix3<f64>,
        period_s: f64,
    ) -> f64 {
        if self.window_s >= WINDOW_S {
            if let Some((bias_before, covariance_before)) = self.before.take() {
                let added = Matrix3::identity() * self.added2;
                let expected = seen * (covariance_before + added - covariance) * seen;
                let moved2 = (seen * (bias - bias_before)).norm_squared();
                let more = (moved2 - expected.trace().max(0.0)) / (seen.trace() * self.window_s);
                let most2 = MOST_WALK_RAD_S.powi(2) - LEAST_WALK_RAD_S.powi(2);
                self.beyond2 = (self.beyond2 + COUNTS * more).clamp(0.0, most2);
            }
            self.begin_window();
        }
        self.before.get_or_insert((*bias, *covariance));
        let walk2 = (LEAST_WALK_RAD_S.powi(2) + self.beyond2) * period_s;
        self.window_s += period_s;
        self.added2 += walk2;
        walk2
    }

    /// The filter has added this variance on each axis, (rad/s)², for another reason.
    pub fn doubt(&mut self, variance: f64) {
        self.added2 += variance;
    }

    /// The filter has forgotten the bias.
    pub fn begin_window(&mut self) {
        (self.before, self.window_s, self.added2) = (None, 0.0, 0.0);
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_xoshiro::Xoshiro256PlusPlus;

    use super::*;

    /// Noise of a rate over one second, °/s.
    const NOISE_DEG_S: f64 = 0.2;

    /// A Kalman filter follows the three biases that this one makes, °/s by the time. What it is off by at the end and what it expects, °/s, and how many
    /// times the least walk its walk is.
    fn follow(bias_deg_s: impl Fn(f64) -> f64) -> (f64, f64, f64) {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(3);
        let mut walk = BiasWalk::default();
        let noise = NOISE_DEG_S.to_radians();
        let (mut bias, mut variance) = (Vector3::zeros(), noise * noise);
        let truth = |second: i32| Vector3::repeat(bias_deg_s(f64::from(second)).to_radians());
        for second in 0..600 {
            // Twelve of these have the variance 1.
            let one = |rng: &mut Xoshiro256PlusPlus| {
                (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0
            };
            let read = truth(second) + Vector3::from_fn(|_, _| noise * one(&mut rng));
            let gain = variance / (variance + noise * noise);
            bias += (read - bias) * gain;
            variance *= 1.0 - gain;
            let covariance = Matrix3::identity() * variance;
            variance += walk.take(&bias, &covariance, &Matrix3::identity(), 1.0);
        }
        let off = (bias - truth(599)).norm() / 3f64.sqrt();
        let times = (1.0 + walk.beyond2 / LEAST_WALK_RAD_S.powi(2)).sqrt();
        (off.to_degrees(), variance.sqrt().to_degrees(), times)
    }

    #[test]
    fn a_bias_that_stays_walks_as_little_as_expected() {
        let (off, expected, times) = follow(|_| 0.4);
        assert!(off < 2.0 * expected, "{off} {expected}");
        assert!(times < 1.5, "{times}");
    }

    #[test]
    fn a_bias_that_drifts_is_followed() {
        let (off, expected, times) = follow(|t_s| t_s / 120.0);
        assert!(times > 3.0, "{times}");
        assert!(off < 2.0 * expected, "{off} {expected}");
        // With the least walk it is off by 0.34°/s.
        assert!(off < 0.12, "{off}");
    }

    #[test]
    fn a_drift_that_ends_leaves_the_least_walk() {
        let (_, _, times) = follow(|t_s| t_s.min(120.0) / 120.0);
        assert!(times < 1.5, "{times}");
    }

    #[test]
    fn a_jump_that_was_expected_is_no_walk() {
        let mut walk = BiasWalk::default();
        let covariance = Matrix3::identity() * 1e-8;
        let take = |walk: &mut BiasWalk, bias: f64, seconds: usize| {
            (0..seconds).fold(0.0, |_, _| {
                walk.take(
                    &Vector3::repeat(bias),
                    &covariance,
                    &Matrix3::identity(),
                    1.0,
                )
            })
        };
        let least = take(&mut walk, 0.0, 31);
        walk.doubt(0.02f64.powi(2));
        assert_eq!(take(&mut walk, 0.02, 31), least);
        assert!(take(&mut walk, 0.04, 31) > least);
        // What the filter forgot does not move.
        let mut walk = BiasWalk::default();
        take(&mut walk, 0.0, 31);
        walk.begin_window();
        assert_eq!(take(&mut walk, 0.02, 62), least);
    }
}
