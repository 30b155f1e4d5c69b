//! Jumps of the gyro's rate. A board changes its rate smoothly, but for a knock; a gyro that fails changes its reading at once.
//!
//! The field shows only later which of the two it was: by the lag of the magnetometer, and once the board has turned by a few degrees.

use super::follow;
use crate::frame::hypot;

/// A step from one reading to the next is a jump if it is so many times the usual one: steps of a swinging hand are 1.4 times their
/// mean at most, and noise is 4 times.
const JUMP_FACTOR: f64 = 8.0;
/// The usual step is a mean over this time, seconds: knocks follow each other within it.
const USUAL_S: f64 = 3.0;
/// Least usual step, rad/s: twice the noise of an ITG-3200.
const LEAST_STEP_RAD_S: f64 = 0.01;
/// A hand starts a turn with this acceleration, rad/s²: 60°/s within a tenth of a second.
const START_RAD_S2: f64 = 10.0;
/// After a longer hole in the gyro's readings, their difference is no step, seconds.
const GAP_S: f64 = 0.2;
/// The doubt grows for this long, seconds: by then the field has shown the fault, or the board counts as still. Then it fades by 1/e
/// over `FADES_S`.
const GROWS_S: f64 = 0.5;
const FADES_S: f64 = 0.2;

/// Watches for jumps of the rate.
#[derive(Clone, Debug, Default)]
pub(super) struct RateJumps {
    /// Mean square of the steps, (rad/s)², their mean length in time, and for how long they were watched, seconds.
    usual2: f64,
    usual_s: f64,
    watched_s: f64,
    newest: Option<RateJump>,
}

#[derive(Clone, Copy, Debug)]
struct RateJump {
    since_s: f64,
    by_rad_s: f64,
    /// What was in doubt before it, radians.
    before_rad: f64,
}

impl RateJumps {
    /// Takes a step from one reading to the next one that differs, rad/s.
    pub(super) fn take(&mut self, last_s: f64, t_s: f64, by_rad_s: f64) {
        let period_s = t_s - last_s;
        if !(0.0..GAP_S).contains(&period_s) {
            return;
        }
        // A step over readings that were lost is longer.
        let longer = (period_s / self.usual_s.max(1e-3)).max(1.0);
        let usual_rad_s = self.usual2.sqrt().max(LEAST_STEP_RAD_S);
        let most_rad_s = (JUMP_FACTOR * usual_rad_s * longer).max(START_RAD_S2 * period_s);
        let larger = |jump: RateJump| last_s - jump.since_s > GROWS_S || by_rad_s > jump.by_rad_s;
        if self.watched_s > USUAL_S && by_rad_s > most_rad_s && self.newest.is_none_or(larger) {
            self.newest = Some(RateJump {
                since_s: last_s,
                by_rad_s,
                before_rad: self.missed_turn_rad(last_s),
            });
        }
        let step2 = by_rad_s.min(most_rad_s).powi(2);
        follow(&mut self.usual2, step2, period_s, (USUAL_S, USUAL_S));
        follow(&mut self.usual_s, period_s, period_s, (USUAL_S, USUAL_S));
        self.watched_s += period_s;
    }

    /// Rotation that the gyro may have missed by `t_s` since its rate jumped, radians.
    pub(super) fn missed_turn_rad(&self, t_s: f64) -> f64 {
        self.newest.map_or(0.0, |jump| {
            let age_s = (t_s - jump.since_s).max(0.0);
            let fading_s = (age_s - GROWS_S).max(0.0);
            let grown = hypot(jump.before_rad, jump.by_rad_s * age_s.min(GROWS_S));
            grown * (-fading_s / FADES_S).exp()
        })
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
        let mut jumps = RateJumps::default();
        let mut last: Option<(f64, f64)> = None;
        let missed = |count: u32| {
            let t_s = f64::from(count) * period_s;
            let rate = rate_rad_s(t_s) + rng.random_range(-0.0017..0.0017);
            if let Some((last_s, before)) = last.replace((t_s, rate)) {
                jumps.take(last_s, t_s, (rate - before).abs());
            }
            (t_s, jumps.missed_turn_rad(t_s))
        };
        (0..(10.0 / period_s) as u32).map(missed).collect()
    }

    fn swinging(t_s: f64) -> f64 {
        4.0 * (3.0 * t_s).cos()
    }

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
        for after_s in [0.05, 0.1, 0.2] {
            // The true rate hardly changes meanwhile. The first wrong reading comes up to a period earlier.
            let truth = 2.0 * swinging(flips_s).abs() * after_s;
            let apart = at(&missed, flips_s + after_s) / truth - 1.0;
            assert!(apart.abs() < 0.45, "{after_s} s: {apart}");
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
        let mut jumps = RateJumps::default();
        let mut last = None;
        for count in (0..1000).filter(|count| !(600..612).contains(count)) {
            let t_s = f64::from(count) * 0.01;
            if let Some((last_s, before)) = last.replace((t_s, swinging(t_s))) {
                let step: f64 = swinging(t_s) - before;
                jumps.take(last_s, t_s, step.abs());
            }
            assert_eq!(jumps.missed_turn_rad(t_s), 0.0, "{t_s}");
        }
    }
}
