//! Faults that last, after a good calibration.

use crate::changes::in_motion;
use crate::chips::{Board, GyroFault};
use crate::daemon::Shown;
use crate::random::Rng;
use crate::score::Score;

/// Moved for two minutes with the fault. Any state but `good` will do.
fn lasting(rng: &mut Rng, score: &mut Score, fault: impl FnMut(&mut Board) + 'static) {
    let rate = rng.uniform(0.3, 1.2);
    let told = |shown: &Shown| !shown.good();
    in_motion(rng, score, 120.0, rate, told, fault);
}

pub fn gyro_zero(rng: &mut Rng, score: &mut Score) {
    lasting(rng, score, |board| board.gyro.fault = GyroFault::Zero);
}

pub fn gyro_bias(rng: &mut Rng, score: &mut Score) {
    lasting(rng, score, |board| board.gyro.fault = GyroFault::Bias);
}

pub fn gyro_constant(rng: &mut Rng, score: &mut Score) {
    // Frozen at what it read in motion.
    let rate = rng.vector(0.5);
    lasting(rng, score, move |board| {
        board.gyro.fault = GyroFault::Constant(rate);
    });
}

pub fn gyro_flipped(rng: &mut Rng, score: &mut Score) {
    lasting(rng, score, |board| {
        board.gyro.fault = GyroFault::Scaled(-1.0)
    });
}

pub fn mag_frozen(rng: &mut Rng, score: &mut Score) {
    lasting(rng, score, |board| board.mag.frozen = true);
}

pub fn mag_axis_stuck(rng: &mut Rng, score: &mut Score) {
    let axis = rng.uniform(0.0, 3.0) as usize;
    lasting(rng, score, move |board| board.mag.stuck = Some(axis));
}

pub fn weak_magnet(rng: &mut Rng, score: &mut Score) {
    let field = rng.direction() * rng.uniform(15.0, 45.0);
    lasting(rng, score, move |board| board.mag.attached = field);
}

pub fn strong_magnet(rng: &mut Rng, score: &mut Score) {
    let field = rng.direction() * rng.log_uniform(45.0, 300.0);
    lasting(rng, score, move |board| board.mag.attached = field);
}
