//! How fast the gyro's bias walks, by how it moves.
//!
//! If a filter expects a slow walk, it lags behind the bias of a chip that warms up. Data sheets allow 0.16 (MPU-6050) to 0.32 °/s
//! (ITG-3200) a kelvin, and a board gets some kelvin warmer within minutes. A filter with covariance P and walk q expects its estimate
//! to move by P_before + q T − P_after (a variance) within a time T. The walk is raised or lowered until the estimate moves by as much:
//! covariance matching (Mehra, IEEE Trans. Autom. Control 17, 1972).

use nalgebra::{Matrix3, Vector3};

/// Least walk of a gyro's bias, rad/s per √s: 0.3°/s in an hour.
pub(super) const LEAST_WALK_RAD_S: f64 = 0.000_087;
/// Most, rad/s per √s: an ITG-3200 that gets ten kelvin warmer in two minutes moves by 0.8°/s in a window.
const MOST_WALK_RAD_S: f64 = 0.0025;
/// Length of a window, seconds: some time constants of a filter whose bias drifts. Half or twice as much serves as well.
const WINDOW_S: f64 = 30.0;
/// Share of a window's excess that is added to the walk: the square of one move scatters by as much as its mean.
const GAIN: f64 = 0.5;

/// Measures how fast a filter's bias walks.
#[derive(Clone, Debug, Default)]
pub struct BiasWalk {
    window: Option<WalkWindow>,
    /// Walk beyond the least one, (rad/s)² per second.
    beyond2: f64,
}

/// What the filter knew when a window began, body axes, and the variances that it has added on each axis since, (rad/s)².
#[derive(Clone, Debug)]
struct WalkWindow {
    bias: Vector3<f64>,
    covariance: Matrix3<f64>,
    s: f64,
    walked2: f64,
    doubted2: f64,
}

impl BiasWalk {
    /// Takes a filter's estimate of the bias, body axes, rad/s, and its covariance. `seen` removes the directions that the filter does not
    /// see. Returns the variance, (rad/s)², that the filter is to add on each axis for the next `period_s`.
    pub fn take(
        &mut self,
        bias: &Vector3<f64>,
        covariance: &Matrix3<f64>,
        seen: &Matrix3<f64>,
        period_s: f64,
    ) -> f64 {
        if let Some(before) = self.window.take_if(|window| window.s >= WINDOW_S) {
            self.match_walk(&before, bias, covariance, seen);
        }
        let walked2 = (LEAST_WALK_RAD_S.powi(2) + self.beyond2) * period_s;
        let window = self.window.get_or_insert(WalkWindow {
            bias: *bias,
            covariance: *covariance,
            s: 0.0,
            walked2: 0.0,
            doubted2: 0.0,
        });
        window.s += period_s;
        window.walked2 += walked2;
        walked2
    }

    fn match_walk(
        &mut self,
        before: &WalkWindow,
        bias: &Vector3<f64>,
        covariance: &Matrix3<f64>,
        seen: &Matrix3<f64>,
    ) {
        let added = Matrix3::identity() * (before.walked2 + before.doubted2);
        let expected = seen * (before.covariance + added - covariance) * seen;
        let expected2 = expected.trace().max(0.0);
        let moved2 = (seen * (bias - before.bias)).norm_squared();
        // A bias that is still being learnt moves by chance much further than it walks, so it shows little of its walk.
        let axes = seen.norm_squared();
        let by_walk = axes * before.walked2;
        let gain = GAIN * by_walk / expected2.max(by_walk);
        let excess = (moved2 - expected2) / (axes * before.s);
        let most2 = MOST_WALK_RAD_S.powi(2) - LEAST_WALK_RAD_S.powi(2);
        self.beyond2 = (self.beyond2 + gain * excess).clamp(0.0, most2);
    }

    /// The filter has added this variance on each axis, (rad/s)², for another reason.
    pub fn doubt(&mut self, variance: f64) {
        if let Some(window) = &mut self.window {
            window.doubted2 += variance;
        }
    }

    /// Begins a new window, since the filter has forgotten the bias: what it moved by before does not count.
    pub fn begin_window(&mut self) {
        self.window = None;
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_xoshiro::Xoshiro256PlusPlus;

    use super::*;

    /// Noise of a rate over one second, °/s.
    const NOISE_DEG_S: f64 = 0.2;

    /// A Kalman filter follows a bias, °/s by the time, that is the same on three axes and that it first expects within this deviation. Returns
    /// its error after these seconds, the error that it expects, °/s, and its walk as a multiple of the least.
    fn follow(
        seconds: i32,
        expected_deg_s: f64,
        bias_deg_s: impl Fn(f64) -> f64,
    ) -> (f64, f64, f64) {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(3);
        let mut walk = BiasWalk::default();
        let noise = NOISE_DEG_S.to_radians();
        let (mut bias, mut variance) = (Vector3::zeros(), expected_deg_s.to_radians().powi(2));
        let truth = |second: i32| Vector3::repeat(bias_deg_s(f64::from(second)).to_radians());
        for second in 0..seconds {
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
        let off = (bias - truth(seconds - 1)).norm() / 3f64.sqrt();
        let times = (1.0 + walk.beyond2 / LEAST_WALK_RAD_S.powi(2)).sqrt();
        (off.to_degrees(), variance.sqrt().to_degrees(), times)
    }

    #[test]
    fn a_bias_that_stays_walks_as_little_as_expected() {
        let (off, expected, times) = follow(600, 0.2, |_| 0.4);
        assert!(off < 2.0 * expected, "{off} {expected}");
        assert!(times < 1.5, "{times}");
    }

    #[test]
    fn a_bias_that_is_learnt_does_not_walk() {
        for bias_deg_s in [0.0, 2.0, 5.0] {
            let (_, _, times) = follow(61, 3.3, |_| bias_deg_s);
            assert!(times < 2.0, "{times} with {bias_deg_s} °/s");
        }
    }

    #[test]
    fn a_bias_that_drifts_is_followed() {
        let (off, expected, times) = follow(600, 0.2, |t_s| t_s / 120.0);
        assert!(times > 3.0, "{times}");
        assert!(off < 2.0 * expected, "{off} {expected}");
        // With the least walk it is off by 0.34°/s.
        assert!(off < 0.12, "{off}");
    }

    #[test]
    fn a_drift_that_ends_leaves_the_least_walk() {
        let (_, _, times) = follow(600, 0.2, |t_s| t_s.min(120.0) / 120.0);
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
