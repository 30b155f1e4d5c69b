//! Notices one axis of a sensor that repeats its value while the noise of the other two is seen: it is not connected, or not read.
//!
//! Motion is no sign of it, since a board may turn about the other axes alone, and a simulated sensor has no noise. So only second
//! differences that reverse the one before count: noise reverses most of them, motion a few in a second.

use nalgebra::Vector3;

/// A sensor that repeats all of its values in so many rows has less noise than its finest step. Sources repeat fewer until the next reading.
const REPEATED_ROWS: u32 = 100;
/// The size of second differences is averaged over so many readings.
const MEAN_READINGS: f64 = 50.0;
/// One that is larger than the least mean so far by this factor, 4 to 6 deviations of noise, is motion or vibration.
const QUIET: f64 = 6.0;
/// An axis is dead if it has repeated its value while each of the others reversed so often. On an axis with half their noise, at the middle
/// of its finest step, the value repeats for so long by chance once in 10¹³ times.
const REVERSALS: u32 = 30;
/// They must do so within this many readings: only a vibration faster than a fifteenth of the sampling rate reverses as often.
const READINGS: u32 = 200;
/// A second difference counts if it exceeds the axis's finest step by this factor. Noise that is small against the step goes to and fro between
/// two values, which makes two steps, and may stand still on another axis.
const STEPS: f64 = 2.5;
/// It must also exceed this share of the repeated value: a log may have three digits.
const DIGITS: f64 = 0.01;

/// Follows the values of a sensor's three axes.
#[derive(Clone, Debug)]
pub struct AxisWatch {
    /// An axis beyond this may be at the end of its range.
    most: f64,
    last: Option<Vector3<f64>>,
    /// The last first and second difference, and the smallest change of each axis.
    change: Vector3<f64>,
    bend: Vector3<f64>,
    finest: Vector3<f64>,
    /// How many rows have repeated all values.
    repeated: u32,
    /// How many changes there were, the mean size of the recent second differences, and the least that it has been.
    changes: f64,
    mean: Vector3<f64>,
    quiet: Vector3<f64>,
    axes: [Repeats; 3],
    /// When a dead axis was read last, seconds.
    dead_s: f64,
}

/// How an axis repeats its value.
#[derive(Clone, Copy, Debug, Default)]
struct Repeats {
    readings: u32,
    /// How often each axis has reversed meanwhile.
    reversals: [u32; 3],
    dead: bool,
}

impl AxisWatch {
    /// Watches a sensor whose axes are judged up to this value.
    pub fn up_to(most: f64) -> Self {
        Self {
            most,
            last: None,
            change: Vector3::zeros(),
            bend: Vector3::zeros(),
            finest: Vector3::repeat(f64::INFINITY),
            repeated: 0,
            changes: 0.0,
            mean: Vector3::zeros(),
            quiet: Vector3::repeat(f64::INFINITY),
            dead_s: f64::NEG_INFINITY,
            axes: Default::default(),
        }
    }

    /// Takes the sensor's values, and returns them unless one of the axes is dead, which it is until it changes.
    pub fn take(&mut self, t_s: f64, values: Vector3<f64>) -> Option<Vector3<f64>> {
        let change = values - self.last.replace(values).unwrap_or(values);
        // A row that repeats all is no reading.
        if change == Vector3::zeros() {
            self.repeated = self.repeated.saturating_add(1);
            if self.repeated >= REPEATED_ROWS {
                self.quiet = Vector3::zeros();
            }
        } else {
            self.repeated = 0;
            let reversed = self.reversed(change);
            for (axis, repeats) in self.axes.iter_mut().enumerate() {
                if change[axis] != 0.0 || values[axis].abs() > self.most {
                    *repeats = Repeats::default();
                } else {
                    repeats.take(axis, &reversed, DIGITS * values[axis].abs());
                }
            }
        }
        if self.dead_axis().is_none() {
            return Some(values);
        }
        self.dead_s = t_s;
        None
    }

    /// The size of each axis's second difference if noise has reversed it, else 0.
    fn reversed(&mut self, change: Vector3<f64>) -> Vector3<f64> {
        let bend = change - std::mem::replace(&mut self.change, change);
        let before = std::mem::replace(&mut self.bend, bend);
        self.changes = (self.changes + 1.0).min(MEAN_READINGS);
        self.mean += (bend.abs() - self.mean) / self.changes;
        let changed = change
            .abs()
            .map(|size| if size > 0.0 { size } else { f64::INFINITY });
        self.finest = self.finest.inf(&changed);
        if self.changes < MEAN_READINGS {
            return Vector3::zeros();
        }
        self.quiet = self.quiet.inf(&self.mean);
        Vector3::from_fn(|axis, _| {
            let size = bend[axis].abs();
            let noise = STEPS * self.finest[axis] < size && size < QUIET * self.quiet[axis];
            if noise && bend[axis] * before[axis] < 0.0 {
                size
            } else {
                0.0
            }
        })
    }

    fn dead_axis(&self) -> Option<usize> {
        self.axes.iter().position(|repeats| repeats.dead)
    }

    /// The name of an axis that is dead, unless the sensor was read last before this time, seconds.
    pub fn dead_since(&self, since_s: f64) -> Option<&'static str> {
        let axis = self.dead_axis().filter(|_| self.dead_s >= since_s)?;
        Some(["x", "y", "z"][axis])
    }
}

impl Repeats {
    /// Takes a reading in which this axis has not changed, and others have reversed by this much.
    fn take(&mut self, axis: usize, reversed: &Vector3<f64>, least: f64) {
        if self.readings == READINGS && !self.dead {
            *self = Self::default();
        }
        self.readings = (self.readings + 1).min(READINGS);
        for (reversals, size) in self.reversals.iter_mut().zip(reversed.iter()) {
            *reversals += u32::from(*size > least);
        }
        let enough = |other: usize| other == axis || self.reversals[other] >= REVERSALS;
        self.dead |= (0..3).all(enough);
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    use rand_xoshiro::Xoshiro256PlusPlus;

    use super::*;

    /// After how many of 20,000 readings an axis is dead. Each has noise of this deviation, a finest step of 1, and moves like this.
    fn dead_after(noise: [f64; 3], moves: impl Fn(f64) -> [f64; 3]) -> Option<u32> {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(7);
        let mut watch = AxisWatch::up_to(1000.0);
        (0..20_000).find(|&reading| {
            let moved = moves(f64::from(reading) * 0.02);
            let values = Vector3::from_fn(|axis, _| {
                let chance: f64 = StandardNormal.sample(&mut rng);
                (moved[axis] + noise[axis] * chance).round()
            });
            watch.take(0.0, values).is_none()
        })
    }

    fn still(_: f64) -> [f64; 3] {
        [0.0; 3]
    }

    #[test]
    fn an_axis_without_the_noise_of_the_others_is_dead() {
        for noise in [1.0, 3.0, 20.0] {
            for axis in 0..3 {
                let noises = std::array::from_fn(|other| if other == axis { 0.0 } else { noise });
                let after = dead_after(noises, still).unwrap();
                assert!((60..600).contains(&after), "{noise}: {after}");
            }
        }
        let turning = |t_s: f64| [300.0 * (2.0 * t_s).sin(), 200.0 * (3.0 * t_s).cos(), 0.0];
        assert!(dead_after([3.0, 3.0, 0.0], turning).is_some());
    }

    #[test]
    fn quiet_axes_and_smooth_motion_are_no_dead_axis() {
        for noise in [0.0, 0.1, 0.2, 0.3, 0.5, 1.0, 5.0] {
            let half = [noise, noise, 0.5 * noise];
            for offset in [0.0, 0.5] {
                assert_eq!(dead_after(half, |_| [offset, offset, 0.0]), None, "{noise}");
            }
        }
        // After a rest, the others vibrate by many steps.
        for per_step in [1.5, 3.0] {
            for noise in [0.1, 0.3, 1.0] {
                let vibrating = |t_s: f64| {
                    let size = if t_s > 5.0 { 20.0 } else { 0.0 };
                    let phase = t_s / 0.02 * per_step;
                    [size * phase.sin(), size * (phase * 1.02).cos(), 0.0]
                };
                assert_eq!(
                    dead_after([noise, noise, 0.5 * noise], vibrating),
                    None,
                    "{noise}"
                );
            }
        }
        // Two axes have noise alone, or the others move without it.
        assert_eq!(dead_after([0.0, 0.0, 5.0], still), None);
        let wobbling = |t_s: f64| [100.0 * (9.0 * t_s).sin(), 100.0 * (8.0 * t_s).cos(), 0.0];
        assert_eq!(dead_after([0.0; 3], wobbling), None);
    }

    #[test]
    fn an_axis_at_the_end_of_its_range_is_not_dead_and_a_dead_one_lives_when_it_changes() {
        assert_eq!(dead_after([5.0, 5.0, 0.0], |_| [0.0, 0.0, 2000.0]), None);
        // Written with three digits.
        assert_eq!(dead_after([2.0, 2.0, 0.0], |_| [0.0, 0.0, 981.0]), None);
        let mut watch = AxisWatch::up_to(1.0);
        let noisy = |reading: u32, z| {
            let way = if reading.is_multiple_of(2) { 0.1 } else { -0.1 };
            let more = f64::from(reading % 5);
            Vector3::new(way * more, 0.02 * more - way, z)
        };
        let mut is_dead = |reading, z| watch.take(0.0, noisy(reading, z)).is_none();
        let dead: Vec<_> = (0..200).map(|reading| is_dead(reading, 0.0)).collect();
        assert!(!dead[10] && dead[199]);
        assert!(!is_dead(200, 0.3));
    }
}
