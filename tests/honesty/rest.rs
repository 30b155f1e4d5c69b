//! Eight hours at rest after a good calibration.

use crate::drive::{Now, run};
use crate::handled::{FAIR, in_room, teaching};
use crate::motion::length_s;
use crate::random::Rng;
use crate::score::{From, Score};

const HOURS: f64 = 8.0;

/// Gyro at 25 Hz, magnetometer at 10 Hz, which is what such a board would be set to.
pub fn eight_hours(rng: &mut Rng, score: &mut Score) {
    let parts = teaching(rng);
    // A minute to settle after the motion.
    let rests_s = length_s(&parts) + 60.0;
    score.starts_s = 4.0;
    score.learnt_by_s = 60.0;
    score.excluded = vec![(0.0, rests_s)];
    score.errors_from = From::Time(rests_s);
    let mut scene = in_room(rng, &FAIR, parts, rests_s + HOURS * 3600.0);
    scene.dt_s = 0.04;
    scene.board.mag.period_s = 0.1;
    // A share of 1 % in any direction, as slow as a day or as fast as a lift.
    let swell = rng.direction() * (0.01 * scene.world.strength());
    let period_s = rng.log_uniform(30.0, 6.0 * 3600.0);
    // The last third of a kelvin that an ITG-3200 gets warmer, besides the random walk of its bias.
    scene.board.gyro.warming = rng.vector(0.1f64.to_radians());
    scene.board.gyro.warms_in_s = 900.0;
    let scene = scene.with(move |now: &Now, world, _, _| {
        world.added = swell * (std::f64::consts::TAU * now.t_s / period_s).sin();
    });
    run(scene, rng, score);
    score.other = vec![score.drift_deg];
}
