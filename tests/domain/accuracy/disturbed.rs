//! What can go wrong while a log is made.

use headingd::frame::Mounting;
use nalgebra::Vector3;
use rand::{Rng, RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

use super::cases::{Case, Log, RATE_HZ, gauss};

/// One thing that goes wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Trouble {
    None,
    /// A magnet is attached: the bias jumps by 50 to 300 mG, anywhere from 3 % to 97 % of the log.
    Magnet,
    /// A car passes: a smooth bump of 20 to 200 mG for 2 to 4 s.
    Car,
    /// An axis tells the same number from some moment in the first half on.
    StuckAxis,
    /// An axis overflows beyond 70 % of its swing: the samples are missing.
    Overflow,
    /// The gyro's full scale is 60 % of the rate of the turns.
    ClippedGyro,
    /// The gyro counts the other way round.
    WrongSign,
    /// The gyro counts double, so that half a turn was taken for a whole one.
    HalfTurn,
    /// The magnetometer is not mounted as is said.
    Mounting(&'static str),
}

impl Trouble {
    /// The log of this seed with the trouble in it, or only its first turn. The truth is what holds at its end.
    pub fn log(self, case: &Case, single: bool, seed: u64) -> Log {
        let case = match self {
            Self::HalfTurn => case.arcs(180.0),
            _ => *case,
        };
        let mut log = case.log(seed);
        if single {
            one_turn(&mut log);
        }
        // As in the product: no plane and no reference are given.
        log.request.plane = None;
        log.request.settings.horizontal_mgauss = None;
        log.request.settings.total_mgauss = None;
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed ^ 0x5eed);
        let rng = &mut rng;
        match self {
            Self::None => {}
            Self::Magnet => magnet(&mut log, case.dimensions(), rng),
            Self::Car => car(&mut log, case.dimensions(), rng),
            Self::StuckAxis => stuck(&mut log, case.dimensions(), rng),
            Self::Overflow => overflow(&mut log, case.dimensions(), rng),
            Self::ClippedGyro => {
                let limit = 0.6 * 24f64.to_radians() / RATE_HZ;
                log.put_poses(|step| step.map(|angle| angle.clamp(-limit, limit)), rng);
            }
            Self::WrongSign => log.put_poses(|step| -step, rng),
            Self::HalfTurn => log.put_poses(|step| 2.0 * step, rng),
            Self::Mounting(said) => {
                log.request.mounting = said.parse::<Mounting>().unwrap();
            }
        }
        log
    }
}

/// Leaves only the first turn, as a live planar calibration sees it.
fn one_turn(log: &mut Log) {
    let end = log.request.turns[0].samples.end;
    log.request.turns.truncate(1);
    log.request.samples.truncate(end);
    log.request.moving = 0..end;
}

/// A vector of this length in any direction, in the plane of a planar case.
fn any_way(dimensions: usize, length: f64, rng: &mut impl Rng) -> Vector3<f64> {
    let mut vector = gauss(rng);
    if dimensions == 2 {
        vector.z = 0.0;
    }
    vector.normalize() * length
}

fn between(low: f64, high: f64, rng: &mut impl Rng) -> f64 {
    low + (high - low) * rng.random::<f64>()
}

fn magnet(log: &mut Log, dimensions: usize, rng: &mut impl Rng) {
    let length = between(50.0, 300.0, rng);
    let jump = any_way(dimensions, length, rng);
    let count = log.request.samples.len();
    let from = (between(0.03, 0.97, rng) * count as f64) as usize;
    for sample in &mut log.request.samples[from..] {
        sample.field_mgauss += jump;
    }
    log.truth.bias += jump;
}

fn car(log: &mut Log, dimensions: usize, rng: &mut impl Rng) {
    let height = between(20.0, 200.0, rng);
    let bump = any_way(dimensions, height, rng);
    let seconds = between(2.0, 4.0, rng);
    let whole = log.request.samples.len() as f64 / RATE_HZ;
    let from_s = between(0.0, whole - seconds, rng);
    for sample in &mut log.request.samples {
        let share = (sample.t_s - from_s) / seconds;
        if (0.0..1.0).contains(&share) {
            sample.field_mgauss += bump * (std::f64::consts::PI * share).sin().powi(2);
        }
    }
}

fn stuck(log: &mut Log, dimensions: usize, rng: &mut impl Rng) {
    let axis = between(0.0, dimensions as f64, rng) as usize;
    let from = (between(0.0, 0.5, rng) * log.request.samples.len() as f64) as usize;
    let value = log.request.samples[from].field_mgauss[axis];
    for sample in &mut log.request.samples[from..] {
        sample.field_mgauss[axis] = value;
    }
}

fn overflow(log: &mut Log, dimensions: usize, rng: &mut impl Rng) {
    let axis = between(0.0, dimensions as f64, rng) as usize;
    let strength = log.fields.iter().map(|h| h[axis].abs()).fold(0.0, f64::max);
    let limit = log.truth.bias[axis] + 0.7 * strength * log.truth.scale[axis];
    let samples = std::mem::take(&mut log.request.samples);
    let kept = |sample: &headingd::calibration::FieldSample| sample.field_mgauss[axis] < limit;
    let index = |at: usize| samples[..at].iter().filter(|s| kept(s)).count();
    for turn in &mut log.request.turns {
        turn.samples = index(turn.samples.start)..index(turn.samples.end);
    }
    log.request.samples = samples.into_iter().filter(kept).collect();
    log.request.moving = 0..log.request.samples.len();
}
