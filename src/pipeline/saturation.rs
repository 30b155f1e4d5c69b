//! Detects magnetometer axes that are stuck or clipped without an overflow flag: they read the same number while the board turns.
//!
//! Noise keeps a working axis from repeating a number, but a coarse axis may repeat it, and so may the axis about which the board turns.
//! The gyro gives the angle by which an axis has swung, and the other two axes give the field in that plane. If a working axis changes
//! under that rotation even around its extreme, where it changes least, and this one has not, its number is no measurement from
//! then on.

use std::f64::consts::PI;

use nalgebra::Vector3;

use crate::frame::{Mountings, hypot};
use crate::frozen::{GAP_S, MOVING_RAD_S};
use crate::reading::{LEAST_STEPS, Reading, SAME_SAMPLES};

/// Largest rotation about the axis itself, as a share of the angle by which the axis swings: it changes the other axes alone.
const ABOUT_ITSELF: f64 = 0.5;
/// Step of the coarsest chip, a 14-bit AK8963, milligauss: the most that a step is taken for.
const COARSEST_STEP_MGAUSS: f64 = 6.0;
/// The measured step grows by this factor with each sample (it doubles in 70), since a chip may change its range.
const STEP_GROWS: f64 = 1.01;

/// Whether an axis repeats a number while the board turns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum RunState {
    /// It does not, or the board is too slow to tell.
    NoRun,
    /// It has read the same number twice: it may be saturated.
    Begun,
    /// It goes on to read the same number.
    Running,
    /// It has turned out to be saturated since it began to repeat the number.
    Saturated,
}

/// Clears the saturated axes of readings.
#[derive(Clone, Debug, Default)]
pub(super) struct Saturation {
    mountings: Mountings,
    rate: Option<(f64, Vector3<f64>)>,
    field: Option<Vector3<f64>>,
    runs: [Option<SameReading>; 3],
    /// The least by which each axis has lately changed from one sample to the next, milligauss.
    steps_mgauss: [f64; 3],
    /// The numbers that each axis reads while it is saturated; the newest first.
    ends: [[Option<SaturatedValue>; 2]; 3],
}

/// A number that an axis read while it was saturated.
#[derive(Clone, Copy, Debug)]
struct SaturatedValue {
    value: f64,
    /// Whether the axis has read smaller and larger numbers since. With both, the axis was stuck for a while, and this is no end of its
    /// range.
    smaller: bool,
    larger: bool,
}

impl SaturatedValue {
    /// Takes what the axis reads next; `None` once this is no end.
    fn after(self, value: f64) -> Option<Self> {
        let end = Self {
            smaller: self.smaller || value < self.value,
            larger: self.larger || value > self.value,
            ..self
        };
        Some(end).filter(|end| !(end.smaller && end.larger))
    }
}

/// A run of samples in which an axis reads the same number.
#[derive(Clone, Copy, Debug)]
struct SameReading {
    since_s: f64,
    /// The field at its first sample.
    first: Vector3<f64>,
    samples: usize,
    /// How far the board has turned, magnetometer chip axes, radians.
    turned_rad: Vector3<f64>,
}

impl SameReading {
    /// Least change of a working axis over the run, milligauss; `None` while that is not known.
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
            steps_mgauss: [COARSEST_STEP_MGAUSS; 3],
            ..Self::default()
        }
    }

    /// Starts a new stretch: its times are unrelated to those before.
    pub(super) fn begin_stretch(&mut self) {
        self.rate = None;
        self.runs = [None; 3];
    }

    /// Returns the reading with its saturated axes empty, and the state of each axis.
    pub(super) fn filter(&mut self, reading: &Reading) -> (Reading, [RunState; 3]) {
        let mut saturated = [false; 3];
        if let Some(rate) = reading.rate_rad_s {
            self.turn(reading.t_s, &rate);
        }
        let mut kept = *reading;
        if let Some(field) = reading.whole_field_mgauss() {
            let last = self.field.replace(field).unwrap_or(field);
            // Rows may repeat the last sample until there is a new one.
            if last != field {
                for axis in 0..3 {
                    self.measure_step(axis, (field[axis] - last[axis]).abs());
                    saturated[axis] = self.compare(axis, reading.t_s, &field);
                }
            }
        }
        if let Some(field) = &mut kept.field_mgauss {
            for (axis, ends) in field.iter_mut().zip(&self.ends) {
                *axis = axis.filter(|value| !is_end(ends, *value));
            }
        }
        let states = std::array::from_fn(|axis| match self.runs[axis] {
            _ if saturated[axis] => RunState::Saturated,
            Some(run) if run.samples > 2 => RunState::Running,
            Some(run) if run.samples == 2 => RunState::Begun,
            _ => RunState::NoRun,
        });
        (kept, states)
    }

    /// Takes the change of an axis since the previous sample.
    fn measure_step(&mut self, axis: usize, change_mgauss: f64) {
        let step = &mut self.steps_mgauss[axis];
        *step = (*step * STEP_GROWS).min(COARSEST_STEP_MGAUSS);
        if change_mgauss > 0.0 {
            *step = step.min(change_mgauss);
        }
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

    /// Forgets all runs and saturated numbers: the gyro is wrong, and the angles that it gave are no evidence.
    pub(super) fn forget(&mut self) {
        self.runs = [None; 3];
        self.ends = [[None; 2]; 3];
    }

    /// Compares an axis with the sample before. Returns whether it has turned out to be saturated.
    fn compare(&mut self, axis: usize, t_s: f64, field: &Vector3<f64>) -> bool {
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
        let least_mgauss = LEAST_STEPS * self.steps_mgauss[axis];
        let saturated = run.samples >= SAME_SAMPLES
            && !is_end(ends, value)
            && (run.least_change_mgauss(axis, field)).is_some_and(|change| change > least_mgauss);
        if saturated {
            let end = SaturatedValue {
                value,
                smaller: false,
                larger: false,
            };
            *ends = [Some(end), ends[0].or(ends[1])];
        }
        saturated
    }
}

fn is_end(ends: &[Option<SaturatedValue>; 2], value: f64) -> bool {
    ends.iter().flatten().any(|end| end.value == value)
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
                field_mgauss: Some(field.map(Some).into()),
                rate_rad_s: Some(rate),
                specific_force_m_s2: None,
            };
            let (kept, _) = saturation.filter(&reading);
            kept.field_mgauss.unwrap()
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

    #[test]
    fn a_sound_axis_is_not_empty_after_a_change_of_range() {
        for motion in [level, tumbling] {
            let (mut fine, mut coarse) = (noisy_by(0.5, 0.77), noisy_by(0.5, 3.57));
            let mut count = 0;
            let read = |field| {
                count += 1;
                if count < 100 {
                    fine(field)
                } else {
                    coarse(field)
                }
            };
            assert_eq!(missing(motion, read, 1), 0);
        }
    }
}
