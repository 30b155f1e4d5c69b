//! Watches how the gyro's reading changes: smoothly, in a jump, or not at all. A board changes its rate smoothly, except when knocked; a
//! failing gyro jumps.
//!
//! The field tells the two apart only later: the magnetometer lags behind the gyro, and the board must have turned by a few degrees.

use nalgebra::Vector3;

use super::follow;
use crate::frame::hypot;
use crate::reading::HELD_S;

/// `usual_hold_s` grows with one reading and shrinks over ten: one reading of ten may be the same by chance.
const HOLD_READINGS: (f64, f64) = (1.0, 10.0);

/// A step from one reading to the next is a jump if it exceeds the usual step, a root mean square, by this factor. The largest steps of a
/// swinging hand are 1.4 times their root mean square, and those of noise 4 times: this is twice as much.
const JUMP_FACTOR: f64 = 8.0;
/// The usual step is averaged over this time, seconds: long enough to contain several knocks of a hand that handles the board.
const USUAL_S: f64 = 3.0;
/// Least usual step, rad/s: twice the noise of an ITG-3200.
const LEAST_STEP_RAD_S: f64 = 0.01;
/// A hand starts a turn with this acceleration, rad/s²: 60°/s within a tenth of a second.
const START_RAD_S2: f64 = 10.0;
/// Readings further apart than this are not compared, seconds.
const GAP_S: f64 = 0.2;
/// The doubt grows for this long, seconds: by then the field has shown the fault, or the board counts as still.
const GROWS_S: f64 = 0.5;
/// After `GROWS_S` the doubt fades with this time constant, seconds.
const FADES_S: f64 = 0.2;

/// Follows the gyro's readings, chip axes.
#[derive(Default)]
pub(super) struct RateChanges {
    /// The newest reading, and since when it has been repeated.
    newest: Option<(Vector3<f64>, f64)>,
    newest_s: f64,
    /// How long the source usually repeats a reading before the next one, seconds.
    usual_hold_s: f64,
    /// Mean square of the steps, (rad/s)².
    usual2: f64,
    /// Mean squares of the rate, (rad/s)², and of its slope, (rad/s²)².
    rate2: f64,
    slope2: f64,
    /// Mean time between readings that differ, seconds.
    usual_s: f64,
    /// For how long steps have been taken, seconds.
    watched_s: f64,
    jump: Option<RateJump>,
}

#[derive(Clone, Copy)]
struct RateJump {
    since_s: f64,
    by_rad_s: f64,
    /// Rotation in doubt just before the jump, radians.
    before_rad: f64,
}

impl RateChanges {
    /// Takes a reading. Deviation of the rotation since the one before, on each axis, radians.
    pub(super) fn take(&mut self, t_s: f64, rate_rad_s: Vector3<f64>) -> f64 {
        let missed_rad = self.between_rad(t_s - self.newest_s);
        match self.newest {
            Some((last, _)) if last == rate_rad_s => {}
            Some((last, since_s)) => {
                let held_s = self.newest_s - since_s;
                if held_s <= HELD_S {
                    follow(&mut self.usual_hold_s, held_s, 1.0, HOLD_READINGS);
                }
                self.step(since_s, t_s, (rate_rad_s - last).norm());
                self.newest = Some((rate_rad_s, t_s));
            }
            None => self.newest = Some((rate_rad_s, t_s)),
        }
        let period_s = (t_s - self.newest_s).clamp(0.0, GAP_S);
        let rate2 = rate_rad_s.norm_squared();
        follow(&mut self.rate2, rate2, period_s, (USUAL_S, USUAL_S));
        self.newest_s = t_s;
        missed_rad
    }

    /// How long the newest reading has been repeated, beyond what is usual, seconds.
    pub(super) fn constant_s(&self) -> f64 {
        let repeated_s = |(_, since_s)| self.newest_s - since_s - self.usual_hold_s;
        self.newest.map_or(0.0, repeated_s).max(0.0)
    }

    /// Takes the step, rad/s, from the reading at `last_s` to the next one that differs.
    fn step(&mut self, last_s: f64, t_s: f64, by_rad_s: f64) {
        let period_s = t_s - last_s;
        if !(0.0..GAP_S).contains(&period_s) {
            return;
        }
        // Where readings were lost, a step covers more time.
        let longer = (period_s / self.usual_s.max(1e-3)).max(1.0);
        let usual_rad_s = self.usual2.sqrt().max(LEAST_STEP_RAD_S);
        let most_rad_s = (JUMP_FACTOR * usual_rad_s * longer).max(START_RAD_S2 * period_s);
        let larger = |jump: RateJump| last_s - jump.since_s > GROWS_S || by_rad_s > jump.by_rad_s;
        if self.watched_s > USUAL_S && by_rad_s > most_rad_s && self.jump.is_none_or(larger) {
            self.jump = Some(RateJump {
                since_s: last_s,
                by_rad_s,
                before_rad: self.missed_turn_rad(last_s),
            });
        }
        let step2 = by_rad_s.min(most_rad_s).powi(2);
        follow(&mut self.usual2, step2, period_s, (USUAL_S, USUAL_S));
        follow(&mut self.usual_s, period_s, period_s, (USUAL_S, USUAL_S));
        // Readings of a burst come faster than the chip measures.
        if 2.0 * period_s > self.usual_s {
            let slope2 = step2 / period_s.powi(2).max(1e-6);
            follow(&mut self.slope2, slope2, period_s, (USUAL_S, USUAL_S));
        }
        self.watched_s += period_s;
    }

    /// Rotation that the gyro may have missed by `t_s` since its rate jumped, radians.
    pub(super) fn missed_turn_rad(&self, t_s: f64) -> f64 {
        self.jump.map_or(0.0, |jump| {
            let age_s = (t_s - jump.since_s).max(0.0);
            let fading_s = (age_s - GROWS_S).max(0.0);
            let grown = hypot(jump.before_rad, jump.by_rad_s * age_s.min(GROWS_S));
            grown * (-fading_s / FADES_S).exp()
        })
    }

    /// RMS error, radians, on each axis, of the rotation between two readings by the trapezoidal rule, which takes the rate to change
    /// evenly. If the rate swings at ω rad/s, the error is change × step / 6 × (ω step / 2); over long steps it is about change × step / 6.
    fn between_rad(&self, step_s: f64) -> f64 {
        let step_s = step_s.max(0.0);
        let change_rad_s = self.slope2.sqrt() * step_s;
        let half_swing = 0.5 * change_rad_s / self.rate2.sqrt().max(1e-3);
        change_rad_s * step_s / 6.0 * half_swing.min(1.0) / 3f64.sqrt()
    }

    /// RMS error of the rotation, radians, if the rate is held for this long while the true rate changes as usual.
    pub(super) fn held_turn_rad(&self, held_s: f64) -> f64 {
        0.5 * self.slope2.sqrt() * held_s.powi(2)
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_xoshiro::Xoshiro256PlusPlus;

    use super::*;

    /// What is in doubt after each reading of 10 s at this period, with noise of 0.1°/s to either side.
    fn missed_rad(period_s: f64, rate_rad_s: impl Fn(f64) -> f64) -> Vec<(f64, f64)> {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(1);
        let mut changes = RateChanges::default();
        let missed = |count: u32| {
            let t_s = f64::from(count) * period_s;
            let rate = rate_rad_s(t_s) + rng.random_range(-0.0017..0.0017);
            changes.take(t_s, Vector3::z() * rate);
            (t_s, changes.missed_turn_rad(t_s))
        };
        (0..(10.0 / period_s) as u32).map(missed).collect()
    }

    fn swinging(t_s: f64) -> f64 {
        4.0 * (3.0 * t_s).cos()
    }

    /// What is in doubt at the first reading after this time.
    fn at(missed: &[(f64, f64)], t_s: f64) -> f64 {
        missed.iter().find(|(now_s, _)| *now_s > t_s).unwrap().1
    }

    #[test]
    fn a_hand_that_swings_or_starts_to_turn_the_board_is_not_doubted() {
        let starting = |t_s: f64| ((t_s - 6.0) / 0.3).clamp(0.0, 1.0);
        for period_s in [0.01, 0.02, 0.05, 0.1] {
            for rate in [swinging, starting] {
                let missed = missed_rad(period_s, rate);
                assert!(missed.iter().all(|(_, rad)| *rad == 0.0), "{period_s}");
            }
        }
    }

    #[test]
    fn a_gyro_that_flips_is_doubted_by_what_it_misses_and_no_longer_than_needed() {
        let flips_s = 6.0;
        let missed = missed_rad(0.01, |t_s| {
            swinging(t_s) * if t_s < flips_s { 1.0 } else { -1.0 }
        });
        assert_eq!(at(&missed, 5.975), 0.0);
        for after_s in [0.055, 0.105, 0.205] {
            // Up to the reading that is compared. The doubt takes the rate at the flip to last; the true one grows by half in .2 s.
            let steps = f64::round((after_s + 0.005) * 1000.0) as u32;
            let missed_in = |step: u32| swinging(flips_s + f64::from(step) * 0.001).abs() * 0.001;
            let truth = 2.0 * (0..steps).map(missed_in).sum::<f64>();
            let apart = at(&missed, flips_s + after_s) / truth - 1.0;
            assert!((-0.25..0.1).contains(&apart), "{after_s} s: {apart}");
        }
        assert!(at(&missed, 7.5) < 0.1, "{}", at(&missed, 7.5));
    }

    #[test]
    fn a_gyro_that_flips_back_stays_in_doubt() {
        let missed = missed_rad(0.01, |t_s| {
            let flipped = (6.0..6.3).contains(&t_s);
            swinging(t_s) * if flipped { -1.0 } else { 1.0 }
        });
        assert!(at(&missed, 6.335) > at(&missed, 6.275));
    }

    #[test]
    fn lost_readings_are_no_jump() {
        let mut changes = RateChanges::default();
        for count in (0..1000).filter(|count| !(600..612).contains(count)) {
            let t_s = f64::from(count) * 0.01;
            changes.take(t_s, Vector3::z() * swinging(t_s));
            assert_eq!(changes.missed_turn_rad(t_s), 0.0, "{t_s}");
        }
    }
}
