//! What a calibration costs, held against what it could cost: `cargo bench --bench calibration`.
//!
//! Each ratio is of two times from the same run on the same samples: the paper's planar Test1 made again, 1240
//! samples with the gyro's poses. The ratios stand in a table at the end.

use std::hint::black_box;
use std::time::{Duration, Instant};

use argmin::core::{CostFunction, Error, Executor};
use argmin::solver::particleswarm::ParticleSwarm;
use criterion::Criterion;

use headingd::calibration::fit::{bounds, swarm};
use headingd::calibration::model::Mode;
use headingd::calibration::objective::{Factored, Normalizer, direct};
use headingd::calibration::outcome::Verdict;
use headingd::calibration::settings::{Profile, Settings, StopChoice};
use headingd::calibration::{Request, calibrate};

#[path = "../examples/paper/log.rs"]
mod log;
#[path = "../examples/paper/published.rs"]
#[allow(dead_code, reason = "one of its tests is enough here")]
mod published;

use log::request;
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

/// Times by name, one for each of criterion's samples.
#[derive(Default)]
struct Times(Vec<(&'static str, Vec<f64>)>);

impl Times {
    fn measure(&mut self, criterion: &mut Criterion, name: &'static str, mut work: impl FnMut()) {
        let mut seconds = Vec::new();
        criterion.bench_function(name, |bencher| {
            bencher.iter_custom(|count| {
                let start = Instant::now();
                (0..count).for_each(|_| work());
                let elapsed = start.elapsed();
                seconds.push(elapsed.as_secs_f64() / count as f64);
                elapsed
            });
        });
        self.0.push((name, seconds));
    }

    /// The least, if the benchmark was asked for: other work on the machine only ever adds time.
    fn least(&self, name: &str) -> Option<f64> {
        let (_, seconds) = self.0.iter().find(|(n, _)| *n == name)?;
        seconds.iter().copied().reduce(f64::min)
    }
}

const STANDARD: &str = "calibrate, profile standard";
const BASIC: &str = "basic PSO, direct sum, 30 x 1000";
const ARGMIN: &str = "argmin ParticleSwarm, direct sum, 40 x 400";
const SUM: &str = "one particle, direct sum";
const FACTOR: &str = "one particle, factor";

/// What is to be how many times faster than what, and how many times at least.
const RATIOS: [(&str, &str, f64); 3] = [
    (STANDARD, BASIC, 300.0),
    (STANDARD, ARGMIN, 100.0),
    (FACTOR, SUM, 80.0),
];

fn planar(settings: &Settings) -> Request {
    request(Mode::Planar, &PLANAR[0].all, 1, settings)
}

fn main() {
    let mut criterion = Criterion::default()
        .sample_size(20)
        .measurement_time(Duration::from_secs(3))
        .without_plots()
        .configure_from_args();
    let mut times = Times::default();

    let standard = planar(&Settings::default());
    let outcome = calibrate(&standard, &|| None);
    assert_eq!(outcome.verdict, Verdict::Accepted, "{}", outcome.message);
    times.measure(&mut criterion, STANDARD, || {
        black_box(calibrate(black_box(&standard), &|| None));
    });

    let points: Vec<[f64; 2]> = standard
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
    times.measure(&mut criterion, BASIC, || {
        black_box(swarm::<2, 4, 5>(black_box(&points), &ranges, &paper));
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
    times.measure(&mut criterion, ARGMIN, || {
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
    times.measure(&mut criterion, SUM, || {
        black_box(direct(
            black_box(&points),
            black_box(&position),
            HORIZONTAL_MGAUSS,
        ));
    });
    times.measure(&mut criterion, FACTOR, || {
        black_box(black_box(&factored).fit_value(black_box(&position)));
    });

    criterion.final_summary();
    // cargo test runs every benchmark once, which says nothing.
    if std::env::args().any(|argument| argument == "--bench") {
        table(&times);
    }
}

fn table(times: &Times) {
    println!("{:>8} {:>8}", "ratio", "at least");
    for (fast, slow, target) in RATIOS {
        let (Some(f), Some(s)) = (times.least(fast), times.least(slow)) else {
            continue;
        };
        let (f_us, s_us) = (1e6 * f, 1e6 * s);
        let ratio = s / f;
        println!("{ratio:8.0} {target:8.0}  {fast} ({f_us:.3} us) against {slow} ({s_us:.3} us)");
    }
}
