//! Many logs of every case, each fitted as the product fits it: worked once, looked at by several tests.

use std::sync::OnceLock;
use std::sync::atomic::AtomicBool;

use headingd::calibration::curve::ParameterVector;
use headingd::calibration::fit;
use headingd::calibration::model::Mode;
use headingd::calibration::refine::Refined;
use headingd::calibration::swarm::Bounds;
use headingd::frame::wrap_pi;

use super::bound::{Errors, HEADINGS, bound, level_turn, raw};
use super::cases::{Case, Log};
use super::on_two_threads;
use crate::effort::times;

/// Logs a case. The RMS over n of them of m independent errors is uncertain by 1/√(2nm): 1.6 % with the
/// two of a planar bias, so that a ratio of 1.05 is 3 standard deviations from 1.
const MANY: usize = 1000;

/// Logs a case with every `cargo test`.
const FEW: usize = 60;

/// How much farther from 1 a ratio may be than with many logs.
pub fn slack() -> f64 {
    (MANY as f64 / logs() as f64).sqrt()
}

fn logs() -> usize {
    times(FEW, MANY)
}

/// The clean cases, and those with spikes.
pub const CASES: [Case; 15] = [
    Case::planar(0.5),
    Case::planar(2.0),
    Case::planar(5.0),
    Case::planar(0.5).arcs(270.0),
    Case::planar(2.0).arcs(270.0),
    Case::planar(5.0).arcs(270.0),
    Case::planar(2.0).spikes(),
    Case::spatial(0.5),
    Case::spatial(2.0),
    Case::spatial(5.0),
    Case::spatial(0.5).arcs(270.0),
    Case::spatial(2.0).arcs(270.0),
    Case::spatial(5.0).arcs(270.0),
    Case::spatial(2.0).two_circles(),
    Case::spatial(2.0).spikes(),
];

/// What the logs of one case came to.
pub struct Tally {
    pub case: Case,
    pub logs: usize,
    /// RMS errors.
    pub rms: Errors,
    /// The same of the bound.
    pub bound: Errors,
    /// Logs whose search box does not hold the truth.
    pub outside: usize,
    /// Logs on which swarm and refinement do not end where a refinement started at the truth does.
    pub trapped: usize,
}

impl Tally {
    /// RMS errors over the bound: bias, scale, heading.
    pub fn ratios(&self) -> Errors {
        self.rms.component_div(&self.bound)
    }
}

/// Every case.
pub fn tallies() -> &'static [Tally] {
    static TALLIES: OnceLock<Vec<Tally>> = OnceLock::new();
    TALLIES.get_or_init(|| on_two_threads(&CASES, tally))
}

fn tally(case: &Case) -> Tally {
    let mut tally = Tally {
        case: *case,
        logs: logs(),
        rms: Errors::default(),
        bound: Errors::default(),
        outside: 0,
        trapped: 0,
    };
    for seed in 0..tally.logs {
        let log = case.log_without_gyro(seed as u64);
        let trial = match case.mode {
            Mode::Planar => trial::<2, 4, 5>(case, &log),
            Mode::Spatial => trial::<3, 6, 7>(case, &log),
        };
        tally.rms += trial.squares;
        tally.bound += bound(case, &log);
        tally.outside += usize::from(!trial.inside);
        tally.trapped += usize::from(trial.trapped);
    }
    let root_of_mean = |sum: f64| (sum / tally.logs as f64).sqrt();
    (tally.rms, tally.bound) = (tally.rms.map(root_of_mean), tally.bound.map(root_of_mean));
    tally
}

/// What became of one log.
struct Trial {
    /// Squared errors.
    squares: Errors,
    inside: bool,
    trapped: bool,
}

fn trial<const D: usize, const P: usize, const F: usize>(case: &Case, log: &Log) -> Trial {
    let truth: ParameterVector<P> = true_position(log);
    let points = points(log);
    let reference = case.reference_mgauss();
    let seen = fit::without_spikes(&points);
    let bounds = fit::bounds(&seen, Some(reference)).unwrap();
    let settings = &log.request.settings;
    let swarm = fit::swarm::<D, P, F>(&seen, &bounds, settings, &AtomicBool::new(false)).unwrap();
    let refine = |start| fit::refine_and_normalize(&points, start, reference, true).unwrap();
    let refined = refine(&swarm.position);
    Trial {
        squares: squares::<D, P>(case, log, &refined.position),
        inside: holds(&bounds, &truth),
        trapped: differ::<D, P>(&refined, &refine(&truth)),
    }
}

/// Whether a position lies in the box.
fn holds<const D: usize, const P: usize>(
    bounds: &Bounds<D>,
    position: &ParameterVector<P>,
) -> bool {
    (0..D).all(|axis| {
        let (scale, bias) = (position[D + axis], position[axis]);
        let (least, most) = bounds.bias_range(axis, scale);
        (bounds.scale_min[axis]..=bounds.scale_max[axis]).contains(&scale)
            && (least..=most).contains(&bias)
    })
}

/// The samples along the axes that are calibrated.
fn points<const D: usize>(log: &Log) -> Vec<[f64; D]> {
    let samples = log.request.samples.iter();
    samples
        .map(|sample| std::array::from_fn(|axis| sample.field_mgauss[axis]))
        .collect()
}

/// The truth as a particle's position.
fn true_position<const P: usize>(log: &Log) -> ParameterVector<P> {
    std::array::from_fn(|k| match k.checked_sub(P / 2) {
        None => log.truth.bias[k],
        Some(axis) => log.truth.scale[axis],
    })
}

/// Whether two fits differ by more than their arithmetic: 0.001 milligauss, 0.00001 of scale, or 1 % of
/// their standard deviation.
fn differ<const D: usize, const P: usize>(one: &Refined<P>, other: &Refined<P>) -> bool {
    (0..P).any(|k| {
        let unit: f64 = if k < D { 1e-3 } else { 1e-5 };
        let apart = (one.position[k] - other.position[k]).abs();
        apart > unit.max(0.01 * one.covariance[(k, k)].sqrt())
    })
}

fn squares<const D: usize, const P: usize>(
    case: &Case,
    log: &Log,
    position: &ParameterVector<P>,
) -> Errors {
    let (mut bias_squares, mut scale_squares, mut heading_squares) = (0.0, 0.0, 0.0);
    for axis in 0..D {
        let (bias, scale) = (position[axis], position[D + axis]);
        bias_squares += (bias - log.truth.bias[axis]).powi(2) / D as f64;
        scale_squares += (scale / log.truth.scale[axis] - 1.0).powi(2) / D as f64;
    }
    for (field, heading) in level_turn(case) {
        let raw = raw(&log.truth, &field);
        let h = |axis: usize| (raw[axis] - position[axis]) / position[D + axis];
        let error = wrap_pi((-h(1)).atan2(h(0)) - heading).to_degrees();
        heading_squares += error * error / HEADINGS as f64;
    }
    Errors::new(bias_squares, scale_squares, heading_squares)
}
