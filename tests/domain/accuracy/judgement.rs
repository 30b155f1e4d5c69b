//! What is accepted and what is refused: no accepted calibration turns wrongly, and clean logs are accepted.

use std::collections::BTreeMap;

use headingd::calibration::model::{Calibration, Mode};
use headingd::calibration::outcome::Verdict;
use headingd::calibration::verdict::Limits;
use headingd::calibration::{CompletedTurn, FieldSample, calibrate};
use headingd::frame::{heading_deg, wrap_pi};
use nalgebra::Vector3;
use rand::SeedableRng;
use rand_xoshiro::Xoshiro256PlusPlus;

use super::bound::{level_turn, raw};
use super::cases::{Case, Log, RATE_HZ};
use super::disturbed::Trouble;
use super::on_two_threads;
use super::survey::CASES;
use crate::effort::times;

/// An accepted calibration's largest heading error, with the mean offset off, degrees.
const LARGEST_DEG: f64 = 2.0;

/// The row of one case.
#[derive(Debug, Default)]
struct Row {
    logs: usize,
    accepted: usize,
    /// Accepted, and wrong.
    wrong: usize,
    /// Largest error of an accepted calibration, degrees.
    worst_deg: f64,
    /// How often each reason was given.
    reasons: BTreeMap<&'static str, usize>,
}

fn row(case: &Case, trouble: Trouble, single: bool, limits: &Limits) -> Row {
    let mut row = Row::default();
    for seed in 0..logs() {
        let mut log = trouble.log(case, single, seed);
        log.request.limits = limits.clone();
        let outcome = calibrate(&log.request);
        row.logs += 1;
        *row.reasons.entry(outcome.reason).or_default() += 1;
        if let Some(calibration) = outcome.calibration {
            let error = largest_error_deg(case, &log, &calibration);
            row.accepted += 1;
            row.wrong += usize::from(error > LARGEST_DEG);
            row.worst_deg = row.worst_deg.max(error);
        }
    }
    row
}

/// The largest heading error over a noise-free level turn, once the mean offset is taken off, degrees.
fn largest_error_deg(case: &Case, log: &Log, calibration: &Calibration) -> f64 {
    let errors: Vec<f64> = level_turn(case)
        .map(|(field, heading)| {
            let corrected = calibration
                .parameters
                .correct(&raw(&log.truth, &field))
                .unwrap();
            let found = heading_deg(&log.request.mounting.to_body(corrected), &Vector3::z());
            found.unwrap().to_radians() - heading
        })
        .collect();
    let (sin, cos) = errors
        .iter()
        .map(|error| error.sin_cos())
        .fold((0.0, 0.0), |sum, e| (sum.0 + e.0, sum.1 + e.1));
    let mean = f64::atan2(sin, cos);
    errors
        .iter()
        .map(|error| wrap_pi(error - mean).abs().to_degrees())
        .fold(0.0, f64::max)
}

/// Every trouble, with whether it is looked for in two turns, in one, and in space.
const TROUBLES: [(Trouble, [bool; 3]); 12] = [
    (Trouble::Magnet, [true, true, true]),
    (Trouble::Car, [true, true, true]),
    (Trouble::StuckAxis, [true, true, true]),
    (Trouble::Overflow, [true, true, true]),
    (Trouble::ClippedGyro, [true, true, true]),
    (Trouble::WrongSign, [true, true, true]),
    (Trouble::HalfTurn, [false, true, false]),
    (Trouble::Mounting("-x +y +z"), [true, true, true]),
    (Trouble::Mounting("+y +x +z"), [true, true, true]),
    (Trouble::Mounting("+x -y -z"), [true, true, true]),
    (Trouble::Mounting("+y -x +z"), [false, false, true]),
    (Trouble::Mounting("+z +x +y"), [false, false, true]),
];

/// Logs a case.
fn logs() -> u64 {
    times(8, 60) as u64
}

/// A name, the case, what goes wrong, and whether only the first turn is looked at.
type Job = (String, Case, Trouble, bool);

/// The table of these cases, printed with `--nocapture`.
fn table(jobs: &[Job]) -> Vec<(String, Row)> {
    let table = rows(jobs, &Limits::default());
    for (name, row) in &table {
        println!(
            "{name:34} {:3} of {} accepted, at most {:.2}° off, {:?}",
            row.accepted, row.logs, row.worst_deg, row.reasons
        );
    }
    table
}

/// What comes of these cases, by name.
fn rows(jobs: &[Job], limits: &Limits) -> Vec<(String, Row)> {
    let mut table = on_two_threads(jobs, |(name, case, trouble, single)| {
        (name.clone(), row(case, *trouble, *single, limits))
    });
    table.sort_by(|a, b| a.0.cmp(&b.0));
    table
}

#[test]
fn clean_logs_are_accepted() {
    let mut jobs: Vec<Job> = Vec::new();
    for case in CASES {
        jobs.push((case.name(), case, Trouble::None, false));
        if case.mode == Mode::Planar {
            jobs.push((
                format!("{}, one turn", case.name()),
                case,
                Trouble::None,
                true,
            ));
        }
    }
    let table = table(&jobs);
    for (name, row) in table {
        assert!(row.accepted * 100 >= row.logs * 99, "{name}: {row:?}");
        assert!(row.worst_deg <= LARGEST_DEG, "{name}: {row:?}");
    }
}

/// The disturbed cases.
fn disturbed() -> Vec<Job> {
    let mut jobs: Vec<Job> = Vec::new();
    for (trouble, [two, one, space]) in TROUBLES {
        let planar = Case::planar(2.0);
        if two {
            jobs.push((format!("{trouble:?}, two turns"), planar, trouble, false));
        }
        if one {
            jobs.push((format!("{trouble:?}, one turn"), planar, trouble, true));
        }
        if space {
            jobs.push((
                format!("{trouble:?}, 3-D"),
                Case::spatial(2.0),
                trouble,
                false,
            ));
        }
    }
    jobs
}

#[test]
fn no_accepted_calibration_of_a_disturbed_log_turns_wrongly() {
    for (name, row) in table(&disturbed()) {
        assert!(row.worst_deg <= LARGEST_DEG, "{name}: {row:?}");
    }
}

/// No limit at all, as far as the configuration goes.
fn wide_open() -> Limits {
    Limits {
        coverage_deg: 90.0,
        direction_spread: 0.0,
        outlier_share: 0.5,
        residual_share: 0.5,
        axis_ratio: 10.0,
        scale_min: 0.01,
        scale_max: 100.0,
        heading_sd_deg: 20.0,
        gyro_rms_deg: 45.0,
        gyro_angle_share: 0.5,
        jump_planar: 1000.0,
        jump_spatial: 1000.0,
        dip_spread_deg: 45.0,
    }
}

/// The table of what each limit refuses by itself, all others open, printed with `--nocapture`. Most wrong calibrations
/// have several witnesses against them. The limits on how much was seen (`direction_spread`)
/// and on scale factors under a given reference have their own tests.
#[test]
fn each_limit_alone_refuses_wrong_calibrations() {
    type Close = fn(&mut Limits, Limits);
    let alone: [(&str, Close); 10] = [
        ("coverage_deg", |l, d| l.coverage_deg = d.coverage_deg),
        ("outlier_share", |l, d| l.outlier_share = d.outlier_share),
        ("residual_share", |l, d| l.residual_share = d.residual_share),
        ("axis_ratio", |l, d| l.axis_ratio = d.axis_ratio),
        ("heading_sd_deg", |l, d| l.heading_sd_deg = d.heading_sd_deg),
        ("gyro_rms_deg", |l, d| l.gyro_rms_deg = d.gyro_rms_deg),
        ("gyro_angle_share", |l, d| {
            l.gyro_angle_share = d.gyro_angle_share;
        }),
        ("jump_planar", |l, d| l.jump_planar = d.jump_planar),
        ("jump_spatial", |l, d| l.jump_spatial = d.jump_spatial),
        ("dip_spread_deg", |l, d| l.dip_spread_deg = d.dip_spread_deg),
    ];
    let mut jobs = disturbed();
    jobs.retain(|(name, _, trouble, _)| {
        *trouble == Trouble::Magnet || name == "Car, one turn" || name == "StuckAxis, 3-D"
    });
    let all = rows(&jobs, &wide_open());
    let mut idle = Vec::new();
    for (limit, close) in alone {
        let mut limits = wide_open();
        close(&mut limits, Limits::default());
        let mut refused = 0;
        for ((name, row), (_, open)) in rows(&jobs, &limits).iter().zip(&all) {
            println!(
                "{limit:17} {name:18} {} of {} wrong ones left",
                row.wrong, open.wrong
            );
            refused += open.wrong - row.wrong.min(open.wrong);
        }
        if refused == 0 {
            idle.push(limit);
        }
    }
    assert!(idle.is_empty(), "{idle:?} refuse nothing wrong");
}

#[test]
fn a_pause_between_two_turns_costs_nothing() {
    // A level turn and a roll: if a part of the cross-validation held the whole of one, the other parts would not determine a fit.
    let case = Case::spatial(3.0);
    for seed in 1..=logs() {
        let mut log = case.log(seed);
        let samples = &log.request.samples;
        let turns = &log.request.turns;
        let (level, roll) = (turns[0].clone(), turns[2].clone());
        let last = level.samples.end - 1;
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
        let pause = (0..1800).map(|_| FieldSample {
            field_mgauss: case.measured(&log.fields[last], &log.truth, &mut rng),
            ..samples[last]
        });
        let turned = samples[level.samples.clone()].iter().copied().chain(pause);
        let mut samples: Vec<FieldSample> = turned
            .chain(samples[roll.samples.clone()].iter().copied())
            .collect();
        for (index, sample) in samples.iter_mut().enumerate() {
            sample.t_s = index as f64 / RATE_HZ;
        }
        let second = samples.len() - roll.samples.len()..samples.len();
        log.request.moving = 0..samples.len();
        log.request.samples = samples;
        log.request.turns = vec![
            level,
            CompletedTurn {
                samples: second,
                ..roll
            },
        ];
        let outcome = calibrate(&log.request);
        assert_eq!(outcome.verdict, Verdict::Accepted, "{}", outcome.message);
        let gyro_rms_deg = outcome.gyro_rms_deg.unwrap();
        assert!(gyro_rms_deg < 5.0, "{seed}: {gyro_rms_deg}");
    }
}
