//! What the estimate costs for a magnetometer sample, held against VQF's update: `cargo bench --bench estimate`.
//!
//! Both take the same simulated board, tumbling for a minute and a half with gyro and accelerometer at 100 Hz and the
//! magnetometer at 50 Hz, and both times are of one run.

use std::hint::black_box;
use std::time::{Duration, Instant};

use criterion::Criterion;
use headingd::attitude::{self, Attitude};
use headingd::estimate::{Estimate, Sample};
use headingd::sensor::simulator::{Scenario, Settings, Simulator};
use vqf_rs::VQF;

/// The estimate may cost so many times what VQF does.
const AT_MOST: f64 = 10.0;

/// A board that has moved.
struct Board {
    /// Gyro and accelerometer, one of each for an update of VQF.
    ticks: Vec<([f64; 3], [f64; 3])>,
    /// What the estimate is told.
    samples: Vec<Sample>,
    attitude: Attitude,
}

impl Board {
    fn tumbling() -> Self {
        let settings = Settings {
            scenario: Scenario::Free,
            turn_deg_s: 36.0,
            mag_rate_hz: 50.0,
            ..Settings::default()
        };
        let simulator = Simulator::new(settings);
        let mountings = simulator.header().mountings;
        let mut board = Self {
            ticks: Vec::new(),
            samples: Vec::new(),
            attitude: Attitude::new(&attitude::Settings::default(), &mountings),
        };
        for entry in simulator {
            let reading = entry.reading;
            board.attitude.take(&reading, |_| {});
            if let (Some(rate), Some(force)) = (reading.rate_rad_s, reading.specific_force_m_s2) {
                board.ticks.push((rate.into(), force.into()));
            }
            let motion = board.attitude.motion_at(reading.t_s);
            let (Some(field_mgauss), Some(motion)) = (reading.whole_field_mgauss(), motion) else {
                continue;
            };
            if !motion.pose.vertical_known {
                continue;
            }
            board.samples.push(Sample {
                t_s: reading.t_s,
                field_mgauss,
                lag_s: 0.0,
                motion,
                board: board.attitude.state(reading.t_s),
            });
        }
        board
    }

    /// A minute and a half of the estimate: each sample taken, and the heading that it leads to.
    fn estimate(&self) -> Estimate {
        let mut estimate = Estimate::new(Default::default(), None);
        for sample in black_box(&self.samples) {
            estimate.take(sample);
            black_box(estimate.fix(&sample.motion.pose, 0.0));
        }
        estimate
    }

    fn vqf(&self) -> VQF {
        let mut vqf = VQF::new(0.01, None, None, None);
        for &(rate, force) in black_box(&self.ticks) {
            vqf.update(rate, force, None);
            black_box(vqf.quat_6d());
        }
        vqf
    }
}

/// The least time of one of `count` equal parts of the work, seconds: other work on the machine only ever adds time.
fn least(criterion: &mut Criterion, name: &str, count: usize, mut work: impl FnMut()) -> f64 {
    let mut least = f64::INFINITY;
    criterion.bench_function(name, |bencher| {
        bencher.iter_custom(|times| {
            let start = Instant::now();
            (0..times).for_each(|_| work());
            let elapsed = start.elapsed().div_f64(count as f64);
            least = least.min(elapsed.as_secs_f64() / times as f64);
            elapsed
        });
    });
    least
}

fn main() {
    let mut criterion = Criterion::default()
        .sample_size(20)
        .measurement_time(Duration::from_secs(3))
        .without_plots()
        .configure_from_args();
    let board = Board::tumbling();
    let sd_deg = board.estimate().north_sd_deg();
    assert!(sd_deg < 5.0, "nothing was learnt: {sd_deg} degrees");

    let samples = board.samples.len();
    let estimate = least(&mut criterion, "estimate, one sample", samples, || {
        black_box(board.estimate());
    });
    let vqf = least(&mut criterion, "VQF, one update", board.ticks.len(), || {
        black_box(board.vqf());
    });
    criterion.final_summary();
    // cargo test runs every benchmark once, which says nothing.
    if std::env::args().any(|argument| argument == "--bench") {
        let (estimate_us, vqf_us) = (1e6 * estimate, 1e6 * vqf);
        println!(
            "{:.1} times VQF (at most {AT_MOST:.0}): one sample of the estimate {estimate_us:.3} us, one update of VQF {vqf_us:.3} us",
            estimate / vqf
        );
    }
}
