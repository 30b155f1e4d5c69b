//! What the estimate costs for a magnetometer sample, held against VQF's update: `cargo bench --bench estimate`.
//!
//! Both take the same simulated board, tumbling for a minute and a half with gyro and accelerometer at 100 Hz and the
//! magnetometer at 50 Hz, and both times are of one run.

use std::hint::black_box;

use headingd::attitude::{self, Attitude};
use headingd::estimate::{Estimate, Sample};
use headingd::sensor::simulator::{Scenario, Settings, Simulator};
use vqf_rs::VQF;

mod least;

use least::{criterion, is_measured, least};

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
            estimate.take(sample, false);
            black_box(estimate.heading(&sample.motion.pose, 0.0));
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

fn main() {
    let mut criterion = criterion();
    let board = Board::tumbling();
    let sd_deg = board.estimate().north_sd_deg();
    assert!(sd_deg < 5.0, "nothing was learnt: {sd_deg} degrees");

    let estimate_s = least(&mut criterion, "estimate, a minute and a half", || {
        black_box(board.estimate());
    });
    let vqf_s = least(&mut criterion, "VQF, a minute and a half", || {
        black_box(board.vqf());
    });
    criterion.final_summary();
    if is_measured() {
        let estimate_us = 1e6 * estimate_s / board.samples.len() as f64;
        let vqf_us = 1e6 * vqf_s / board.ticks.len() as f64;
        println!(
            "{:.1} times VQF (at most {AT_MOST:.0}): one sample of the estimate {estimate_us:.3} us, one update of VQF {vqf_us:.3} us",
            estimate_us / vqf_us
        );
    }
}
