//! The table of transitions in src/condition.rs, row by row.

use headingd::calibration::outcome::Outcome;
use headingd::calibration::policy::Policy;
use headingd::condition::SourceFault;
use headingd::heading::MagStatus;
use headingd::pipeline::{Event, Settings};
use headingd::reading::{Field, Reading};
use headingd::true_north::{EarthField, ValueWithSd};
use nalgebra::{Rotation3, Vector3};

use super::board::{Board, planar};
use super::gyro::swinging;
use crate::common::{EARTH, carried};

/// What leads to a row's first state, and what happens then.
type Scenario = (&'static str, fn() -> Board, fn(&mut Board));

fn trouble() -> Event {
    Event::Fault(Some(SourceFault {
        code: "unplugged",
        message: "the port is gone".to_owned(),
    }))
}

fn degraded() -> Board {
    Board::rested(Some(planar(0.0)))
}

/// It knows its iron, and rests.
fn good() -> Board {
    let mut board = Board::taught(2);
    board.rest(2.0);
    board
}

fn turning() -> Board {
    let mut board = Board::rested(None);
    board.turn(60.0);
    board
}

/// One that wants to be so certain of its heading that only a full turn will do.
fn exacting() -> Board {
    let settings = Settings {
        publish_sd_deg: 2.5,
        good_sd_deg: 2.5,
        ..Settings::default()
    };
    let mut board = Board::with(settings, None);
    board.late = true;
    board.rest(4.0);
    board.turn(90.0);
    board
}

fn calibrating() -> Board {
    let mut board = exacting();
    board.turn(262.0);
    board
}

fn disturbed() -> Board {
    let mut board = good();
    board.earth_mgauss *= 1.4;
    board.rest(2.0);
    board
}

/// Iron has just come onto the board.
fn laden() -> Board {
    let mut board = good();
    board.turn(90.0);
    board.bias_mgauss.x += 100.0;
    board.turn(30.0);
    board
}

#[rustfmt::skip]
const SCENARIOS: &[Scenario] = &[
    ("readings come, and no calibration is kept", || Board::new(None), |b| b.rest(1.0)),
    ("readings come, and one is kept", || Board::new(Some(planar(0.0))), |b| {
        b.rest(3.0);
        assert!(b.error_deg().unwrap().abs() < 5.0);
    }),
    ("readings come, but none of the magnetometer", || Board::new(None), |b| {
        b.with_field = false;
        b.rest(1.0);
    }),
    ("readings come, but none of the gyro", || Board::new(None), |b| {
        b.with_gyro = false;
        b.rest(1.0);
    }),
    ("readings come, but none of the accelerometer", || Board::new(None), |b| {
        b.with_accel = false;
        b.rest(1.0);
    }),
    ("a tenth of a turn", || Board::rested(None), |b| b.turn(60.0)),
    ("`turn.time_limit_s` passes", turning, |b| b.rest(125.0)),
    ("the heading is worth something", turning, |b| {
        assert_eq!(b.error_deg(), None);
        b.turn(220.0);
        assert!(b.error_deg().unwrap().abs() < 15.0);
    }),
    ("a full turn before that", exacting, |b| b.turn(262.0)),
    ("mode off", turning, |b| b.tell(Event::Policy(Policy::Off))),
    ("the candidate is accepted", calibrating, Board::finish),
    ("the candidate is rejected", || {
        // A magnet came in mid-turn.
        let mut board = exacting();
        board.turn(90.0);
        board.bias_mgauss += Vector3::new(-150.0, 80.0, 0.0);
        board.turn(172.0);
        board
    }, Board::finish),
    ("rollback or import", || Board::rested(None), |b| {
        b.tell(Event::Activate(Some(Box::new(planar(0.0)))));
        b.rest(1.0);
    }),
    ("the gyro's range was misread", || {
        let mut board = Board::new(None);
        board.gyro = |rate| 2.0 * rate;
        board.rest(4.0);
        board
    }, |b| {
        b.tumble();
        // Nothing that such a gyro taught is worth a heading.
        assert_eq!(b.shown(), (false, false));
    }),
    ("the board is moved about", degraded, |b| {
        b.tumble();
        b.tumble();
        assert!(b.error_deg().unwrap().abs() < 5.0);
    }),
    ("forget", good, |b| b.tell(Event::Activate(None))),
    ("the field is too weak or too strong", good, |b| {
        for (share, status) in [(0.6, MagStatus::LowField), (1.4, MagStatus::HighField)] {
            b.earth_mgauss = share * EARTH;
            b.rest(2.0);
            assert_eq!(b.mag_status(), status);
        }
    }),
    ("the field has another direction", good, |b| {
        let before = b.error_deg().unwrap();
        b.earth_mgauss = Rotation3::from_axis_angle(&Vector3::z_axis(), 1.0) * b.earth_mgauss;
        b.rest(5.0);
        // The gyro carries the heading.
        let after = b.error_deg().unwrap_or(90.0);
        assert!((after - before).abs() < 2.0, "{after}, {before}");
    }),
    ("the field is as before", disturbed, |b| {
        b.earth_mgauss /= 1.4;
        b.rest(5.0);
        assert!(b.error_deg().unwrap().abs() < 5.0);
    }),
    ("iron comes onto the moving board", || {
        let mut board = good();
        board.turn(90.0);
        board
    }, |b| {
        b.bias_mgauss.x += 60.0;
        b.turn(30.0);
    }),
    ("the board moves on with it", laden, |b| {
        b.tumble();
        b.tumble();
        b.rest(2.0);
        assert!(b.error_deg().unwrap().abs() < 6.0, "{:?}", b.error_deg());
    }),
    ("the nose points straight up", good, |b| {
        b.pitch_to(88.0);
        assert_eq!(b.shown(), (false, false));
    }),
    ("the accelerometer falls silent", good, |b| {
        b.with_accel = false;
        b.rest(5.0);
    }),
    ("the gyro falls silent", good, |b| {
        b.with_gyro = false;
        b.rest(2.0);
    }),
    ("the gyro reads a constant in a turn", good, |b| {
        b.gyro = |_| Vector3::zeros();
        b.turn(200.0);
        // Each heading comes from one sample alone.
        assert_eq!(b.shown(), (false, true));
    }),
    ("an axis of the gyro reads a constant", || Board::new(None), |b| {
        swing(b, |reading| reading.rate_rad_s = reading.rate_rad_s.map(|rate| Vector3::new(0.01, rate.y, rate.z)));
    }),
    ("an axis of the accelerometer reads a constant", || Board::new(None), |b| {
        swing(b, |reading| {
            reading.specific_force_m_s2 = reading.specific_force_m_s2.map(|force| Vector3::new(force.x, 0.0, force.z));
        });
    }),
    ("the gyro has another sign", good, |b| {
        b.gyro = |rate| -rate;
        b.tumble();
        assert_eq!(b.shown(), (false, true));
    }),
    ("the magnetometer's axes are exchanged", || Board::new(None), |b| {
        swing(b, |reading| {
            let exchanged = |[x, y, z]: Field| [y, x, z.map(|z| -z)];
            reading.field_mgauss = reading.field_mgauss.map(exchanged);
        });
        assert_eq!(b.shown(), (false, false));
    }),
    ("the accelerometer's axes are exchanged", || Board::new(None), |b| {
        swing(b, |reading| {
            let exchanged = |force: Vector3<f64>| Vector3::new(force.y, force.x, -force.z);
            reading.specific_force_m_s2 = reading.specific_force_m_s2.map(exchanged);
        });
        assert_eq!(b.shown(), (false, false));
    }),
    ("the accelerometer reads another unit", good, |b| {
        b.gravity_m_s2 = 1.0;
        b.rest(30.0);
    }),
    ("the gyro has another scale", good, |b| {
        b.gyro = |rate| 1.2 * rate;
        for angle_deg in [300.0, -300.0, 300.0, -300.0, 300.0, -300.0, 300.0] {
            b.turn(angle_deg);
        }
        assert_eq!(b.shown(), (false, true));
    }),
    ("the board turns faster than the gyro can tell", good, |b| {
        b.gyro = |rate| rate.map(|value| value.clamp(-250f64.to_radians(), 250f64.to_radians()));
        b.turn_at(400.0, 0.3);
    }),
    ("up and down are exchanged, by the position", good, |b| {
        let known = |value: f64| ValueWithSd { value, sd: 0.5 };
        b.tell(Event::Place(Some(EarthField {
            declination_deg: known(0.0),
            dip_deg: known(-EARTH.z.atan2(EARTH.x).to_degrees()),
            strength_mgauss: known(EARTH.norm()),
            horizontal_mgauss: known(EARTH.x),
            zone: None,
        })));
        b.tumble();
    }),
    ("the magnetometer's unit is wrong", || Board::rested(None), |b| {
        b.earth_mgauss *= 10.0;
        b.tumble();
        b.tumble();
    }),
    ("the magnetometer falls silent", good, |b| {
        b.with_field = false;
        b.rest(1.0);
    }),
    ("an axis overflows", good, |b| {
        b.overflow = true;
        b.rest(1.0);
        assert_eq!(b.mag_status(), MagStatus::HighField);
    }),
    ("an axis reads the same number while the board turns", good, |b| {
        b.stuck_mgauss = Some(200.0);
        b.turn(90.0);
    }),
    ("readings resume", || {
        let mut board = good();
        board.with_field = false;
        board.rest(1.0);
        board
    }, |b| {
        b.with_field = true;
        b.rest(5.0);
    }),
    ("the source fails", good, |b| b.tell(trouble())),
    ("the fault ends", || {
        let mut board = good();
        board.tell(trouble());
        board
    }, |b| b.tell(Event::Fault(None))),
];

/// Swings a board about for a minute, after a rest, with readings that a wrong mounting changes.
fn swing(board: &mut Board, mount: fn(&mut Reading)) {
    let lies = |t_s: f64| swinging((t_s - 5.0).max(0.0));
    for mut reading in carried(60.0, lies, |_, rate| rate) {
        mount(&mut reading);
        board.tell(Event::Reading(reading));
    }
}

/// From, event, to, reason.
fn table() -> Vec<[&'static str; 4]> {
    let source = include_str!("../../../src/condition.rs");
    let rows = source
        .lines()
        .filter_map(|line| line.strip_prefix("//! |")?.strip_suffix('|'));
    rows.skip(2)
        .map(|row| {
            let cells: Vec<&str> = row.split('|').map(str::trim).collect();
            cells.try_into().expect("four cells")
        })
        .collect()
}

#[test]
fn every_row_of_the_table_is_so_and_none_is_missing() {
    let table = table();
    let events: Vec<&str> = table.iter().map(|row| row[1]).collect();
    let played: Vec<&str> = SCENARIOS.iter().map(|scenario| scenario.0).collect();
    assert_eq!(events, played, "the table, and what is tried here");
    let mut wrong = Vec::new();
    for ([from, event, to, reason], (_, begin, happen)) in table.into_iter().zip(SCENARIOS) {
        let mut board = begin();
        let found = match board.reports.last() {
            Some(report) => report.condition.word(),
            None => "(start)",
        };
        if found != from {
            wrong.push(format!(
                "before {event}: {found}, {:?}",
                board.reports.last()
            ));
        }
        happen(&mut board);
        let (word, code) = board.state();
        let code_right = match reason {
            "the refusal's" => board.verdict().1,
            "the fault's code" => "unplugged",
            reason => reason.trim_matches('`'),
        };
        if (word, code) != (to, code_right) {
            let sd_deg = board.heading.as_ref().and_then(|heading| heading.sd_deg);
            wrong.push(format!(
                "after {event}: {word} {code} instead of {to} {code_right}, {sd_deg:?} {:?}",
                board.error_deg()
            ));
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn a_refused_turn_does_not_spoil_the_next() {
    let mut board = Board::rested(None);
    board.turn(180.0);
    board.bias_mgauss += Vector3::new(60.0, 40.0, 0.0);
    board.turn(185.0);
    assert_eq!(board.verdict().0, "rejected");
    board.turn(365.0);
    assert_eq!(board.verdict().0, "accepted", "{:?}", board.verdict());
}

#[test]
fn what_motion_teaches_is_kept_after_a_start_from_a_turns_calibration() {
    let mut board = Board::rested(Some(planar(0.0)));
    for _ in 0..4 {
        board.tumble();
    }
    let by_motion = |outcome: &&Outcome| outcome.method == "motion";
    let kept = board
        .outcomes
        .iter()
        .find(by_motion)
        .expect("none was kept");
    assert!(kept.calibration.is_some_and(|one| one.covariance.is_some()));
}

/// The vertical field of a board that turns level may be anything, and its horizontal field alone is too strong.
#[test]
fn a_horizontal_field_that_is_far_too_strong_is_a_fault_on_a_level_board_too() {
    let mut board = Board::new(None);
    board.earth_mgauss *= 15.0;
    board.bias_mgauss *= 15.0;
    board.rest(4.0);
    board.turn(400.0);
    assert_eq!(board.state(), ("fault", "field_unit"));
}

/// Microtesla taken for milligauss: the vertical field of a board that turns level is not known.
#[test]
fn a_turn_in_a_horizontal_field_that_no_compass_works_in_is_refused() {
    let mut board = Board::new(None);
    board.earth_mgauss *= 0.1;
    board.bias_mgauss *= 0.1;
    board.rest(4.0);
    board.turn(400.0);
    assert_eq!(board.verdict(), ("rejected", "field_unit"));
}

/// The field's vertical part is not measured on a board that turns level, and its horizontal part alone is a field of the earth.
#[test]
fn a_raw_field_that_no_compass_works_in_is_a_fault_on_a_level_board_too() {
    let mut board = Board::rested(Some(planar(0.0)));
    board.turn(400.0);
    board.bias_mgauss += Vector3::new(0.0, 0.0, 20_000.0);
    board.rest(1.0);
    assert_eq!(board.state(), ("fault", "field_unit"));
}
