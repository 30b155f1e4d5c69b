//! Axes of the magnetometer that read the same number while the board turns: they are stuck, or at the end of their range, and the
//! chip does not say so.
//!
//! Noise keeps a sound axis from reading the same again and again, but a coarse one may, and so may one about which the board turns.
//! The gyro tells how far an axis has swung round, and the other axes how much field there is in the plane in which it did. Where a
//! sound axis would have changed, even around the extreme, where it changes least, this one is saturated. The number that it reads
//! is no measurement from then on.

use std::f64::consts::PI;

use nalgebra::Vector3;

use crate::frame::{Mountings, hypot};
use crate::reading::Reading;

/// So many samples read the same: noise of a step makes that a chance of 1 in 10 000 …
const SAMPLES: u32 = 10;
/// … while the board turns about the axis by no more than this share of what the axis swings round: that changes the other axes alone.
const ABOUT_ITSELF: f64 = 0.5;
/// A sound axis would have changed by more than this, milligauss: two steps of the coarsest chip, an AK8963 of 14 bits.
const LEAST_CHANGE_MGAUSS: f64 = 12.0;
/// Slower rates may be the gyro's bias, rad/s (20°/s).
const MOVING_RAD_S: f64 = 0.35;
/// Over a longer time the gyro does not tell how the board has turned, seconds.
const GAP_S: f64 = 0.5;

/// Readings in, readings without saturated axes out.
#[derive(Clone, Debug)]
pub(super) struct Saturation {
    mountings: Mountings,
    rate: Option<(f64, Vector3<f64>)>,
    field: Option<Vector3<f64>>,
    runs: [Option<SameReading>; 3],
    /// What each axis reads where it measures nothing; the newest first.
    ends: [[Option<End>; 2]; 3],
}

/// A number that an axis read where it measured nothing.
#[derive(Clone, Copy, Debug)]
struct End {
    value: f64,
    /// Whether it has read smaller ones and larger ones since: then it was stuck for a while, and this is no end of its range.
    smaller: bool,
    larger: bool,
}

impl End {
    fn new(value: f64) -> Self {
        Self {
            value,
            smaller: false,
            larger: false,
        }
    }

    /// As it is after the axis has read this; `None` once it is no end.
    fn after(self, value: f64) -> Option<Self> {
        let end = Self {
            smaller: self.smaller || value < self.value,
            larger: self.larger || value > self.value,
            ..self
        };
        Some(end).filter(|end| !(end.smaller && end.larger))
    }
}

/// An axis has read the same number since.
#[derive(Clone, Copy, Debug)]
struct SameReading {
    since_s: f64,
    /// The field when it began.
    first: Vector3<f64>,
    samples: u32,
    /// How far the board has turned, magnetometer chip axes, radians.
    turned_rad: Vector3<f64>,
}

impl SameReading {
    /// How much a sound axis had changed at least by now, milligauss; `None` while that is not known.
    fn least_change_mgauss(&self, axis: usize, field: &Vector3<f64>) -> Option<f64> {
        let [next, third] = [(axis + 1) % 3, (axis + 2) % 3];
        let swung_rad = hypot(self.turned_rad[next], self.turned_rad[third]);
        if self.turned_rad[axis].abs() > ABOUT_ITSELF * swung_rad {
            return None;
        }
        let change = field - self.first;
        // A field h in the plane in which the axis swings by φ, as far to one side of the extreme as to the other, changes across it by
        // 2 h sin φ/2, and along it by h (1 − cos φ/2).
        let across = hypot(change[next], change[third]);
        Some(0.5 * across * (0.25 * swung_rad.min(PI)).tan())
    }
}

impl Saturation {
    pub(super) fn new(mountings: &Mountings) -> Self {
        Self {
            mountings: *mountings,
            rate: None,
            field: None,
            runs: [None; 3],
            ends: [[None; 2]; 3],
        }
    }

    /// The times of the readings to come have nothing to do with those before.
    pub(super) fn begin_stretch(&mut self) {
        self.rate = None;
        self.runs = [None; 3];
    }

    /// The reading, its saturated axes empty.
    pub(super) fn filter(&mut self, reading: &Reading) -> Reading {
        if let Some(rate) = reading.rate_rad_s {
            self.turn(reading.t_s, &rate);
        }
        let mut kept = *reading;
        if let Some(field) = reading.whole_field_mgauss()
            // Rows may repeat the last sample until there is a new one.
            && self.field.replace(field) != Some(field)
        {
            for axis in 0..3 {
                self.compare(axis, reading.t_s, &field);
            }
        }
        if let Some(field) = &mut kept.field_mgauss {
            for (axis, ends) in field.iter_mut().zip(&self.ends) {
                *axis = axis.filter(|value| !ends.iter().flatten().any(|end| end.value == *value));
            }
        }
        kept
    }

    fn turn(&mut self, t_s: f64, rate_rad_s: &Vector3<f64>) {
        let body = self.mountings.gyro.to_body(*rate_rad_s);
        let now = self.mountings.mag.to_chip(body);
        let (last_s, last) = self.rate.replace((t_s, now)).unwrap_or((t_s, now));
        if t_s - last_s > GAP_S || now.norm() < MOVING_RAD_S {
            self.runs = [None; 3];
            return;
        }
        for run in self.runs.iter_mut().flatten() {
            let share_s = t_s - last_s.max(run.since_s);
            run.turned_rad += 0.5 * (last + now) * share_s.max(0.0);
        }
    }

    /// The gyro is wrong: what it has told of how the axes swing is no evidence.
    pub(super) fn forget(&mut self) {
        self.runs = [None; 3];
        self.ends = [[None; 2]; 3];
    }

    fn compare(&mut self, axis: usize, t_s: f64, field: &Vector3<f64>) {
        let same = self.runs[axis].filter(|run| run.first[axis] == field[axis]);
        let mut run = same.unwrap_or(SameReading {
            since_s: t_s,
            first: *field,
            samples: 0,
            turned_rad: Vector3::zeros(),
        });
        run.samples += 1;
        self.runs[axis] = Some(run);
        let value = field[axis];
        let ends = &mut self.ends[axis];
        *ends = ends.map(|end| end?.after(value));
        if run.samples >= SAMPLES
            && !ends.iter().flatten().any(|end| end.value == value)
            && (run.least_change_mgauss(axis, field))
                .is_some_and(|change| change > LEAST_CHANGE_MGAUSS)
        {
            *ends = [Some(End::new(value)), ends[0].or(ends[1])];
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Rotation3;
    use rand::{RngExt, SeedableRng};
    use rand_xoshiro::Xoshiro256PlusPlus;

    use super::*;

    const EARTH: Vector3<f64> = Vector3::new(200.0, 0.0, 450.0);

    /// Readings at 50 Hz, 10 s long, of a board that turns at this rate, and what its magnetometer makes of the field.
    fn kept(
        rate_rad_s: impl Fn(f64) -> Vector3<f64>,
        mut read: impl FnMut(Vector3<f64>) -> Vector3<f64>,
    ) -> Vec<[Option<f64>; 3]> {
        let mut saturation = Saturation::new(&Mountings::default());
        let mut attitude = Rotation3::identity();
        let dt = 0.02;
        let reading = |step: u32| {
            let t_s = f64::from(step) * dt;
            let rate = rate_rad_s(t_s);
            attitude *= Rotation3::new(rate * dt);
            let field = read(attitude.inverse() * EARTH);
            let reading = Reading {
                t_s,
                field_mgauss: Some([Some(field.x), Some(field.y), Some(field.z)]),
                rate_rad_s: Some(rate),
                specific_force_m_s2: None,
            };
            saturation.filter(&reading).field_mgauss.unwrap()
        };
        (0..500).map(reading).collect()
    }

    fn level(_: f64) -> Vector3<f64> {
        Vector3::z()
    }

    fn tumbling(t_s: f64) -> Vector3<f64> {
        Vector3::new((0.7 * t_s).sin(), (0.45 * t_s).cos(), 1.0)
    }

    fn empty(kept: &[[Option<f64>; 3]], axis: usize) -> usize {
        kept.iter().filter(|field| field[axis].is_none()).count()
    }

    /// Noise of so many milligauss to either side, in steps of so many.
    fn noisy_by(noise_mgauss: f64, step_mgauss: f64) -> impl FnMut(Vector3<f64>) -> Vector3<f64> {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(1);
        move |field| {
            field.map(|b| {
                let noise = rng.random_range(-1.0..1.0) * noise_mgauss;
                ((b + noise) / step_mgauss).round() * step_mgauss
            })
        }
    }

    fn noisy(step_mgauss: f64) -> impl FnMut(Vector3<f64>) -> Vector3<f64> {
        noisy_by(2.0, step_mgauss)
    }

    #[test]
    fn an_axis_at_the_end_of_its_range_is_empty_and_the_others_are_not() {
        for motion in [level, tumbling] {
            let mut noisy = noisy(1.0);
            let kept = kept(motion, |field| noisy(field).map(|b| b.clamp(-150.0, 500.0)));
            // 41° to either side of 180°, of 573°.
            assert!(empty(&kept, 0) > 80, "{}", empty(&kept, 0));
            assert!(empty(&kept, 1) > 80, "{}", empty(&kept, 1));
            let missed = kept.iter().filter(|field| field[0] == Some(-150.0));
            assert!(missed.count() < 60);
        }
    }

    #[test]
    fn a_stuck_axis_is_empty() {
        let mut noisy = noisy(1.0);
        let kept = kept(level, |field| {
            let field = noisy(field);
            Vector3::new(87.0, field.y, field.z)
        });
        assert!(empty(&kept, 0) > 450);
        assert_eq!(empty(&kept, 1) + empty(&kept, 2), 0);
    }

    #[test]
    fn an_axis_that_was_stuck_is_sound_again() {
        let (mut noisy, mut count) = (noisy(1.0), 0);
        let kept = kept(level, |field| {
            count += 1;
            let field = noisy(field);
            let x = if count < 150 { 87.0 } else { field.x };
            Vector3::new(x, field.y, field.z)
        });
        assert!(empty(&kept[..150], 0) > 100);
        // It begins anew at 172°, where it reads less, and reads more from 296° on.
        assert!(kept.iter().any(|field| field[0] == Some(87.0)));
        assert_eq!(empty(&kept[470..], 0), 0);
    }

    /// How many values are missing of a board whose rows repeat each sample so many times.
    fn missing(
        motion: fn(f64) -> Vector3<f64>,
        mut read: impl FnMut(Vector3<f64>) -> Vector3<f64>,
        hold: usize,
    ) -> usize {
        let (mut count, mut held) = (0, Vector3::zeros());
        let kept = kept(motion, |field| {
            if count % hold == 0 {
                held = read(field);
            }
            count += 1;
            held
        });
        (0..3).map(|axis| empty(&kept, axis)).sum()
    }

    #[test]
    fn a_sound_axis_is_never_empty_however_coarse() {
        for step_mgauss in [0.1, 1.0, 3.0, 4.35, 6.0] {
            for noise_mgauss in [0.0, 0.5, 2.0] {
                for horizontal_mgauss in [150.0, 200.9, 263.0, 349.0] {
                    for hold in [1, 2, 10] {
                        for motion in [level, tumbling] {
                            let mut noisy = noisy_by(noise_mgauss, step_mgauss);
                            let larger = Vector3::new(horizontal_mgauss / EARTH.x, 1.0, 1.0);
                            let read = |field: Vector3<f64>| noisy(field.component_mul(&larger));
                            assert_eq!(
                                missing(motion, read, hold),
                                0,
                                "steps of {step_mgauss}, noise of {noise_mgauss}, {horizontal_mgauss} mG, held {hold} times"
                            );
                        }
                    }
                }
            }
        }
    }
}
