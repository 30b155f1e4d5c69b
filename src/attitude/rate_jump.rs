//! Jumps of the gyro's rate. A board changes its rate smoothly, but for a knock; a gyro that fails changes its reading at once.
//!
//! The field shows only later which of both it was: by the lag of the magnetometer, and once the board has turned by a few degrees.

use nalgebra::Vector3;

use super::follow;

/// A step from one reading to the next is a jump if it is so many times the usual one: motion that starts or stops as hands, wheels
/// and rudders do it stays below, and noise far below.
const MANY: f64 = 8.0;
/// The usual step is a mean over this time, seconds: knocks follow each other within it.
const USUAL_S: f64 = 3.0;
/// Least usual step, rad/s: twice the noise of an ITG-3200.
const LEAST_STEP_RAD_S: f64 = 0.01;
/// The board may have turned otherwise for this long, seconds: then the field has shown it, or the board passes for still. After that
/// the doubt fades by 1/e over `FADES_S`.
const LASTS_S: f64 = 0.5;
const FADES_S: f64 = 0.2;

/// Watches for jumps of the rate.
#[derive(Clone, Debug, Default)]
pub(super) struct RateJumps {
    last: Option<(f64, Vector3<f64>)>,
    /// Mean square of the steps, (rad/s)², and over how long it was taken, seconds.
    usual2: f64,
    watched_s: f64,
    newest: Option<RateJump>,
}

#[derive(Clone, Copy, Debug)]
struct RateJump {
    since_s: f64,
    by_rad_s: f64,
}

impl RateJumps {
    /// Takes a reading, chip axes, rad/s.
    pub(super) fn take(&mut self, t_s: f64, rate_rad_s: &Vector3<f64>) {
        // Rows may repeat the last reading until there is a new one.
        if self.last.is_some_and(|(_, last)| last == *rate_rad_s) {
            return;
        }
        let Some((last_s, last)) = self.last.replace((t_s, *rate_rad_s)) else {
            return;
        };
        let period_s = t_s - last_s;
        if !(0.0..LASTS_S).contains(&period_s) {
            return;
        }
        let by_rad_s = (rate_rad_s - last).norm();
        let most_rad_s = MANY * self.usual2.sqrt().max(LEAST_STEP_RAD_S);
        let larger = |jump: RateJump| last_s - jump.since_s > LASTS_S || by_rad_s > jump.by_rad_s;
        if self.watched_s > USUAL_S && by_rad_s > most_rad_s && self.newest.is_none_or(larger) {
            self.newest = Some(RateJump {
                since_s: last_s,
                by_rad_s,
            });
        }
        let step2 = by_rad_s.min(most_rad_s).powi(2);
        follow(&mut self.usual2, step2, period_s, (USUAL_S, USUAL_S));
        self.watched_s += period_s;
    }

    /// How far the board may have turned otherwise than the gyro reads at `t_s`, because its rate has jumped, radians.
    pub(super) fn otherwise_rad(&self, t_s: f64) -> f64 {
        self.newest.map_or(0.0, |jump| {
            let age_s = (t_s - jump.since_s).max(0.0);
            let fading_s = (age_s - LASTS_S).max(0.0);
            jump.by_rad_s * age_s.min(LASTS_S) * (-fading_s / FADES_S).exp()
        })
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_xoshiro::Xoshiro256PlusPlus;

    use super::*;

    const PERIOD_S: f64 = 0.01;

    /// What is doubted at each reading of 10 s of a rate about Z, with noise of 0.1°/s to either side.
    fn otherwise_rad(rate_rad_s: impl Fn(f64) -> f64) -> Vec<f64> {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(1);
        let mut jumps = RateJumps::default();
        let doubted = |count: u32| {
            let t_s = f64::from(count) * PERIOD_S;
            let noise = Vector3::from_fn(|_, _| rng.random_range(-0.0017..0.0017));
            jumps.take(t_s, &(Vector3::z() * rate_rad_s(t_s) + noise));
            jumps.otherwise_rad(t_s)
        };
        (0..1000).map(doubted).collect()
    }

    fn swinging(t_s: f64) -> f64 {
        4.0 * (3.0 * t_s).cos()
    }

    #[test]
    fn a_hand_that_swings_the_board_is_not_doubted() {
        assert_eq!(otherwise_rad(swinging), vec![0.0; 1000]);
    }

    #[test]
    fn a_gyro_that_flips_is_doubted_by_what_it_misses_and_no_longer_than_needed() {
        let flips_s = 6.0;
        let read = |t_s| swinging(t_s) * if t_s < flips_s { 1.0 } else { -1.0 };
        let doubted = otherwise_rad(read);
        let (before, after) = doubted.split_at(600);
        assert!(before.iter().all(|rad| *rad == 0.0));
        for (count, doubted) in after.iter().enumerate().take(20) {
            // The true rate hardly changes within a fifth of a second.
            let missed_rad = 2.0 * swinging(flips_s).abs() * (count + 1) as f64 * PERIOD_S;
            assert!((doubted / missed_rad - 1.0).abs() < 0.05, "{count}");
        }
        assert!(after[399] < 1e-3, "{}", after[399]);
    }

    #[test]
    fn rows_that_repeat_readings_change_nothing() {
        let read = |t_s: f64| swinging((t_s / 0.05).floor() * 0.05);
        let mut jumps = RateJumps::default();
        for count in 0..1000 {
            let t_s = f64::from(count) * PERIOD_S;
            jumps.take(t_s, &(Vector3::z() * read(t_s)));
            assert_eq!(jumps.otherwise_rad(t_s), 0.0, "{t_s}");
        }
    }
}
