//! What a calibration costs, held against what it could cost: `cargo bench --bench calibration`.
//!
//! Each ratio is of two times from the same run on the same samples: the paper's planar Test1 made again, 1240
//! samples with the gyro's poses. The ratios stand in a table at the end.

use std::hint::black_box;
use std::sync::atomic::AtomicBool;

use argmin::core::{CostFunction, Error, Executor};
use argmin::solver::particleswarm::ParticleSwarm;

use headingd::calibration::fit::{bounds, swarm};
use headingd::calibration::model::Mode;
use headingd::calibration::objective::{Factored, Normalizer, direct};
use headingd::calibration::outcome::Verdict;
use headingd::calibration::settings::{Profile, Settings, StopChoice};
use headingd::calibration::{Request, calibrate};

mod least;
#[path = "../examples/paper/log.rs"]
mod log;
#[path = "../examples/paper/published.rs"]
#[allow(dead_code, reason = "one of its tests is enough here")]
mod published;

use least::{criterion, is_measured, least};
use published::{HORIZONTAL_MGAUSS, PLANAR};

/// The direct sum as argmin wants it.
struct Sum<'a>(&'a [[f64; 2]]);

impl CostFunction for Sum<'_> {
    type Param = Vec<f64>;
    type Output = f64;

    fn cost(&self, p: &Vec<f64>) -> Result<f64, Error> {
        Ok(direct(self.0, &[p[0], p[1], p[2], p[3]], HORIZONTAL_MGAUSS))
    }
}

const STANDARD: &str = "calibrate, profile standard";
const BASIC: &str = "basic PSO, direct sum, 30 x 1000";
const ARGMIN: &str = "argmin ParticleSwarm, direct sum, 40 x 400";
const SUM: &str = "one particle, direct sum";
const FACTOR: &str = "one particle, factor";

fn planar(settings: &Settings) -> Request {
    log::request(Mode::Planar, &PLANAR[0].all, 1, settings)
}

fn main() {
    let mut criterion = criterion();

    let request = planar(&Settings::default());
    let outcome = calibrate(&request);
    assert_eq!(outcome.verdict, Verdict::Accepted, "{}", outcome.message);
    let standard_s = least(&mut criterion, STANDARD, || {
        black_box(calibrate(black_box(&request)));
    });

    let points: Vec<[f64; 2]> = request
        .samples
        .iter()
        .map(|s| [s.field_mgauss.x, s.field_mgauss.y])
        .collect();
    let ranges = bounds(&points, Some(HORIZONTAL_MGAUSS)).expect("a turn spans a box");
    let paper = Settings {
        profile: Profile::Paper,
        stop: StopChoice::Basic,
        ..Settings::default()
    };
    let basic_s = least(&mut criterion, BASIC, || {
        let never = AtomicBool::new(false);
        black_box(swarm::<2, 4, 5>(
            black_box(&points),
            &ranges,
            &paper,
            &never,
        ));
    });

    let bias = |axis: usize| ranges.bias_range(axis, ranges.scale_max[axis]);
    let low = vec![
        bias(0).0,
        bias(1).0,
        ranges.scale_min[0],
        ranges.scale_min[1],
    ];
    let high = vec![
        bias(0).1,
        bias(1).1,
        ranges.scale_max[0],
        ranges.scale_max[1],
    ];
    let argmin_s = least(&mut criterion, ARGMIN, || {
        let solver = ParticleSwarm::new((low.clone(), high.clone()), 40);
        let executor = Executor::new(Sum(black_box(&points)), solver);
        let result = executor.configure(|state| state.max_iters(400)).run();
        black_box(result.expect("the cost is always a number"));
    });

    let factored = Factored::<2, 5>::new(
        Normalizer::new(&ranges.low, &ranges.high),
        &points,
        HORIZONTAL_MGAUSS,
    );
    let position = [87.0, 54.0, 0.87, 1.0];
    let sum_s = least(&mut criterion, SUM, || {
        black_box(direct(
            black_box(&points),
            black_box(&position),
            HORIZONTAL_MGAUSS,
        ));
    });
    let factor_s = least(&mut criterion, FACTOR, || {
        black_box(black_box(&factored).fit_value(black_box(&position)));
    });

    criterion.final_summary();
    if !is_measured() {
        return;
    }
    println!("{:>8} {:>8}", "ratio", "at least");
    for (fast, fast_s, slow, slow_s, target) in [
        (STANDARD, standard_s, BASIC, basic_s, 300.0),
        (STANDARD, standard_s, ARGMIN, argmin_s, 100.0),
        (FACTOR, factor_s, SUM, sum_s, 80.0),
    ] {
        if fast_s.is_infinite() || slow_s.is_infinite() {
            continue;
        }
        let (fast_us, slow_us, ratio) = (1e6 * fast_s, 1e6 * slow_s, slow_s / fast_s);
        println!(
            "{ratio:8.0} {target:8.0}  {fast} ({fast_us:.3} us) against {slow} ({slow_us:.3} us)"
        );
    }
}
