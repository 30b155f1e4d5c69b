//! Detects jumps of the gyro's bias while the board lies still, as where two recordings of a board at rest were joined, or where the gyro's
//! firmware sets its zero anew.
//!
//! The rate then steps from one steady value to another. The rates of a hand and of a boat at anchor vary before and after. A motor that
//! begins to turn the board evenly, by less than 2°/s, looks the same: the bias is then in doubt until it is learnt again.

use std::collections::VecDeque;

use nalgebra::Vector3;

use super::clock::TICK_S;
use super::stillness::MOVING_RAD_S;

/// The rate is averaged over windows of this length, seconds.
const WINDOW_S: f64 = 0.5;
/// This many windows before a jump are compared with as many after it. The window between them, which contains the jump, is left out.
const COMPARED: usize = 6;
/// A jump is at least this many times the scatter of the windows. A slow sine reaches 6.8 times at most, with a period of 8 s.
const FACTOR: f64 = 10.0;
/// A smaller jump cannot be told from the bias's walk or a slow swing, rad/s (0.15°/s).
const LEAST_RAD_S: f64 = 0.0026;

/// Longest time from a jump until it is found, seconds.
pub(super) const FOUND_AFTER_S: f64 = (COMPARED as f64 + 1.0) * WINDOW_S;

/// The mean rates of the last windows.
#[derive(Default)]
pub(super) struct BiasJumps {
    windows: VecDeque<Vector3<f64>>,
    turned_rad: Vector3<f64>,
    window_s: f64,
}

impl BiasJumps {
    /// Takes the mean rate of a tick, bias included, and the bias learnt so far, body axes, rad/s. Returns the size of a jump, rad/s, once it
    /// shows.
    pub(super) fn take(&mut self, rate: Vector3<f64>, learnt_bias: &Vector3<f64>) -> Option<f64> {
        self.turned_rad += rate * TICK_S;
        self.window_s += TICK_S;
        // Half a tick, for sums of floats.
        if self.window_s < WINDOW_S - 0.5 * TICK_S {
            return None;
        }
        let mean = std::mem::take(&mut self.turned_rad) / std::mem::take(&mut self.window_s);
        if (mean - learnt_bias).norm() > MOVING_RAD_S {
            self.windows.clear();
            return None;
        }
        if self.windows.len() > 2 * COMPARED {
            self.windows.pop_front();
        }
        self.windows.push_back(mean);
        let jump = self.jump_rad_s()?;
        self.windows.clear();
        Some(jump)
    }

    fn jump_rad_s(&self) -> Option<f64> {
        if self.windows.len() <= 2 * COMPARED {
            return None;
        }
        let (before, squares_before) = mean_and_squares(self.windows.iter().take(COMPARED));
        let (after, squares_after) = mean_and_squares(self.windows.iter().skip(COMPARED + 1));
        let jump = (after - before).norm();
        let scatter = ((squares_before + squares_after) / (2 * COMPARED - 2) as f64).sqrt();
        (jump > LEAST_RAD_S.max(FACTOR * scatter)).then_some(jump)
    }
}

/// The mean of `COMPARED` rates, and the sum of the squared distances from it.
fn mean_and_squares<'a>(
    rates: impl Iterator<Item = &'a Vector3<f64>> + Clone,
) -> (Vector3<f64>, f64) {
    let mean = rates.clone().sum::<Vector3<f64>>() / COMPARED as f64;
    let squares = rates.map(|rate| (rate - mean).norm_squared()).sum();
    (mean, squares)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;

    /// The jumps found in a minute of this rate about the vertical, °/s, with when they were found.
    fn jumps(rate_deg_s: impl Fn(f64) -> f64) -> Vec<(f64, f64)> {
        let mut watch = BiasJumps::default();
        let mut found = Vec::new();
        for tick in 1..=6000 {
            let t_s = f64::from(tick) * TICK_S;
            // Three incommensurable sines stand in for 0.1 °/s of noise.
            let noise = |k: f64| 0.14 * (k * f64::from(tick)).sin();
            let rate = Vector3::new(noise(2.1), noise(1.3), noise(1.7) + rate_deg_s(t_s));
            let jump = watch.take(rate.map(f64::to_radians), &Vector3::zeros());
            found.extend(jump.map(|jump| (t_s, jump.to_degrees())));
        }
        found
    }

    #[test]
    fn a_bias_that_jumps_at_rest_is_found_within_seconds() {
        for at_s in [20.0, 20.2, 20.4] {
            let found = jumps(|t_s| if t_s < at_s { 0.1 } else { -0.4 });
            let [(found_s, jump)] = found[..] else {
                panic!("{found:?}");
            };
            assert!((jump - 0.5).abs() < 0.05, "{jump}");
            assert!(found_s - at_s <= FOUND_AFTER_S, "{found_s}");
        }
    }

    #[test]
    fn a_swing_and_a_bias_that_walks_are_no_jumps() {
        for period_s in [2.0, 5.0, 8.0, 20.0, 240.0] {
            let found = jumps(|t_s| (TAU * t_s / period_s).sin());
            assert_eq!(found, [], "a swing in {period_s} s");
        }
        assert_eq!(jumps(|t_s| 0.01 * t_s), []);
        assert_eq!(jumps(|t_s| if t_s < 20.0 { 0.0 } else { 20.0 }), []);
    }
}
