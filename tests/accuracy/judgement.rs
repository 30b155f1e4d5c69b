//! What is accepted and what is refused: no accepted calibration turns wrongly, and clean logs are accepted.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};

use headingd::calibration::calibrate;
use headingd::calibration::model::Mode;
use headingd::frame::wrap_pi;
use headingd::heading::Compass;
use nalgebra::Vector3;

use super::bound::{HEADINGS, level_turn, raw};
use super::cases::{Case, Log};
use super::disturbed::Trouble;
use super::survey::CASES;

/// An accepted calibration's largest heading error, with the mean offset off, degrees.
const LARGEST_DEG: f64 = 2.0;

/// The row of one case.
#[derive(Debug, Default)]
struct Row {
    logs: usize,
    accepted: usize,
    /// Largest error of an accepted calibration, degrees.
    worst_deg: f64,
    /// How often each reason was given.
    reasons: BTreeMap<&'static str, usize>,
}

fn row(case: &Case, trouble: Trouble, single: bool) -> Row {
    let mut row = Row::default();
    for seed in 0..LOGS {
        let log = trouble.log(case, single, seed);
        let outcome = calibrate(&log.request, &|| None);
        row.logs += 1;
        *row.reasons.entry(outcome.reason).or_default() += 1;
        if let Some(calibration) = outcome.calibration {
            let compass = Compass::new(calibration, log.request.mounting);
            let error = largest_error_deg(case, &log, &compass);
            row.accepted += 1;
            row.worst_deg = row.worst_deg.max(error);
        }
    }
    row
}

/// The largest heading error over a noise-free level turn, once the mean offset is taken off, degrees.
fn largest_error_deg(case: &Case, log: &Log, compass: &Compass) -> f64 {
    let errors: Vec<f64> = level_turn(case)
        .map(|(field, heading)| {
            let corrected = compass.correct(&raw(&log.truth, &field), None);
            let found = compass.heading_deg(&corrected, Some(&Vector3::z()));
            found.unwrap().to_radians() - heading
        })
        .collect();
    let (sin, cos) = errors
        .iter()
        .map(|error| error.sin_cos())
        .fold((0.0, 0.0), |sum, e| (sum.0 + e.0, sum.1 + e.1));
    let mean = f64::atan2(sin, cos);
    assert_eq!(errors.len(), HEADINGS);
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
const LOGS: u64 = 60;

/// A name, the case, what goes wrong, and whether only the first turn is looked at.
type Job = (String, Case, Trouble, bool);

/// The table of these cases, printed with `--nocapture`; on two threads.
fn table(jobs: &[Job]) -> Vec<(String, Row)> {
    let next = AtomicUsize::new(0);
    let work = || {
        let take = || jobs.get(next.fetch_add(1, Ordering::Relaxed));
        std::iter::from_fn(take)
            .map(|(name, case, trouble, single)| (name.clone(), row(case, *trouble, *single)))
            .collect::<Vec<_>>()
    };
    let mut table = std::thread::scope(|scope| {
        let other = scope.spawn(work);
        let mut all = work();
        all.extend(other.join().unwrap());
        all
    });
    table.sort_by(|a, b| a.0.cmp(&b.0));
    for (name, row) in &table {
        println!(
            "{name:34} {:3} of {} accepted, at most {:.2}° off, {:?}",
            row.accepted, row.logs, row.worst_deg, row.reasons
        );
    }
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
    let logs: usize = table.iter().map(|(_, row)| row.logs).sum();
    let accepted: usize = table.iter().map(|(_, row)| row.accepted).sum();
    assert!(accepted * 100 >= logs * 99, "{accepted} of {logs}");
    for (name, row) in table {
        assert!(row.accepted * 100 >= row.logs * 99, "{name}: {row:?}");
        assert!(row.worst_deg <= LARGEST_DEG, "{name}: {row:?}");
    }
}

#[test]
fn no_accepted_calibration_of_a_disturbed_log_turns_wrongly() {
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
    for (name, row) in table(&jobs) {
        assert!(row.worst_deg <= LARGEST_DEG, "{name}: {row:?}");
    }
}
