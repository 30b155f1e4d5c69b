//! How much of what a gyro reads at rest is its own noise, and how much may be motion.
//!
//! A resting board does not turn: what its gyro reads turns the frame, but not the board. A boat at anchor may pass
//! for resting while it swings slowly. White noise averages out over seconds, and a slow swing does not: comparing both tells them
//! apart.

use nalgebra::Vector3;

/// The rate is averaged over this time, seconds: longer than a boat rolls (3 to 7 s), and short beside its swing (minutes).
const WINDOW_S: f64 = 10.0;
/// Noise and motion are means over this time, seconds.
const MEAN_S: f64 = 120.0;
/// So many windows are needed before the board may be said to rest.
const LEAST_WINDOWS: f64 = 3.0;
/// Least noise density of a gyro, rad/√s (0.005 °/s/√Hz): the best data sheet, the MPU-6050's.
const LEAST_NOISE: f64 = 0.000_087;
/// The filter states the bias of a resting gyro with more doubt than the gyro's noise causes, to leave room for a swing. So only this share
/// of the bias's variance counts as an explanation of the averaged rate's offset. At 1 a boat at anchor loses its heading; at 0.2 the
/// field's noise, which reaches the bias, passes for motion of a board on a table.
const BIAS_SHARE: f64 = 0.5;

/// Watches a gyro while the board rests.
#[derive(Clone, Default)]
pub(super) struct RestWatch {
    /// Turn of the window that runs, freed of the bias, body axes, radians, and its length, seconds.
    turned_rad: Vector3<f64>,
    window_s: f64,
    /// Turn of the sample before.
    last: Option<Vector3<f64>>,
    samples: f64,
    windows: f64,
    /// Densities of the rate, of one axis of white noise, and of motion on all axes, rad²/s.
    noise2: f64,
    motion2: f64,
}

impl RestWatch {
    /// Takes the turn during a sample's period of a resting board, freed of the bias, body axes, radians, and the bias's mean variance
    /// on an axis, (rad/s)².
    pub(super) fn take(&mut self, turned_rad: Vector3<f64>, period_s: f64, bias2: f64) {
        if let Some(last) = self.last.replace(turned_rad) {
            self.samples += 1.0;
            let density = (turned_rad - last).norm_squared() / 6.0 / period_s.max(1e-3);
            self.noise2 += gain(self.samples, period_s) * (density - self.noise2);
        }
        self.turned_rad += turned_rad;
        self.window_s += period_s;
        if self.window_s < WINDOW_S {
            return;
        }
        self.windows += 1.0;
        let explained = 3.0 * (self.noise2 + BIAS_SHARE * bias2 * self.window_s);
        let density = self.turned_rad.norm_squared() / self.window_s - explained;
        self.motion2 += gain(self.windows, self.window_s) * (density - self.motion2);
        (self.turned_rad, self.window_s) = (Vector3::zeros(), 0.0);
    }

    /// The rest is interrupted; what it has shown remains.
    pub(super) fn interrupt(&mut self) {
        (self.turned_rad, self.window_s, self.last) = (Vector3::zeros(), 0.0, None);
    }

    /// The share of the measured turn that is the gyro's noise, 0 to 1.
    pub(super) fn noise_share(&self) -> f64 {
        if self.windows < LEAST_WINDOWS {
            return 0.0;
        }
        let noise2 = self.noise2.max(LEAST_NOISE.powi(2));
        noise2 / (noise2 + self.motion2.max(0.0))
    }
}

/// Gain of an average: the plain mean at first, later a low-pass over `MEAN_S`.
fn gain(count: f64, period_s: f64) -> f64 {
    (1.0 / count).max((period_s / MEAN_S).min(1.0))
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_xoshiro::Xoshiro256PlusPlus;

    use super::*;

    /// The noise's share after 10 minutes at 10 Hz with a noise density of 0.05 °/s/√Hz, on a board that swings by `swing_deg` to either
    /// side in `period_s`, and whose bias is known to 0.01°/s.
    fn share(swing_deg: f64, period_s: f64) -> f64 {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(1);
        let mut watch = RestWatch::default();
        let noise = 0.05f64.to_radians() * 0.1f64.sqrt() * 12f64.sqrt();
        let speed = std::f64::consts::TAU / period_s;
        for sample in 0..6000 {
            let swing = swing_deg.to_radians() * speed * (speed * 0.1 * f64::from(sample)).cos();
            let white = Vector3::from_fn(|_, _| noise * (rng.random::<f64>() - 0.5));
            let turned = white + Vector3::z() * (swing * 0.1);
            watch.take(turned, 0.1, 0.01f64.to_radians().powi(2));
        }
        watch.noise_share()
    }

    #[test]
    fn a_gyro_on_a_table_reads_noise() {
        let noise = share(0.0, 300.0);
        assert!(noise > 0.8, "{noise}");
    }

    #[test]
    fn a_gyro_on_a_boat_at_anchor_reads_its_swing() {
        for (swing_deg, period_s) in [(40.0, 240.0), (15.0, 600.0)] {
            let noise = share(swing_deg, period_s);
            assert!(noise < 0.1, "{noise} while swinging by {swing_deg}°");
        }
    }
}
