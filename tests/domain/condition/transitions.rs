//! The table of transitions in src/condition.rs, row by row.

use headingd::calibration::outcome::Verdict;
use headingd::calibration::policy::Policy;
use headingd::condition::Trouble;
use headingd::pipeline::Event;
use nalgebra::{Rotation3, Vector3};

use super::board::{Board, planar, spatial};

/// What leads to a row's first state, and what happens then.
type Scenario = (&'static str, fn() -> Board, fn(&mut Board));

fn trouble() -> Event {
    Event::Fault(Some(Trouble {
        code: "unplugged",
        message: "the port is gone".to_owned(),
    }))
}

fn good() -> Board {
    Board::rested(Some(planar(0.0)))
}

fn turning() -> Board {
    let mut board = Board::rested(None);
    board.turn(90.0);
    board
}

fn calibrating() -> Board {
    let mut board = Board::rested(None);
    board.late = true;
    board.turn(352.0);
    board
}

/// Its calibration is off by 0.3 of the horizontal field.
fn misfit() -> Board {
    let mut board = Board::rested(Some(planar(50.0)));
    board.wander_until(200.0, |board| board.state().1 == "calibration_stale");
    board
}

fn disturbed() -> Board {
    let mut board = good();
    board.earth_mgauss *= 1.4;
    board.rest(2.0);
    board
}

/// All axes are calibrated, and the filter has come to know the field.
fn known_field() -> Board {
    let mut board = Board::rested(Some(spatial(0.0)));
    for way in [1.0, -1.0, 1.0, -1.0, 1.0, -1.0] {
        board.turn(330.0 * way);
    }
    board
}

#[rustfmt::skip]
const SCENARIOS: &[Scenario] = &[
    ("readings come, and no calibration is kept", || Board::new(None), |b| b.rest(1.0)),
    ("readings come, and one is kept", || Board::new(Some(planar(0.0))), |b| b.rest(1.0)),
    ("readings come, but none of the magnetometer", || Board::new(None), |b| {
        b.with_field = false;
        b.rest(1.0);
    }),
    ("a tenth of a turn", || Board::rested(None), |b| b.turn(60.0)),
    ("`turn.time_limit_s` passes", turning, |b| b.rest(125.0)),
    ("a full turn", turning, |b| {
        b.late = true;
        b.turn(265.0);
    }),
    ("mode off", turning, |b| b.tell(Event::Policy(Policy::Off))),
    ("the candidate is accepted", calibrating, Board::finish),
    ("the candidate is rejected", || {
        // A magnet came in mid-turn.
        let mut board = Board::rested(None);
        board.late = true;
        board.turn(180.0);
        board.bias_mgauss += Vector3::new(-150.0, 80.0, 0.0);
        board.turn(172.0);
        board
    }, Board::finish),
    ("rollback or import", || Board::rested(None), |b| b.tell(Event::InForce(Some(planar(0.0))))),
    ("forget", good, |b| b.tell(Event::InForce(None))),
    ("the field is too weak or too strong", good, |b| {
        b.earth_mgauss *= 1.4;
        b.rest(2.0);
    }),
    ("the field has another dip", known_field, |b| {
        b.earth_mgauss = Rotation3::from_axis_angle(&Vector3::y_axis(), 0.35) * b.earth_mgauss;
        b.turn(330.0);
    }),
    ("the field is as before", disturbed, |b| {
        b.earth_mgauss /= 1.4;
        b.rest(5.0);
    }),
    ("the board is tilted out of its plane", good, |b| {
        b.pitch_to(55.0);
        b.rest(1.0);
    }),
    ("the board is level again", || {
        let mut board = good();
        board.pitch_to(55.0);
        board.rest(1.0);
        board
    }, |b| {
        b.pitch_to(0.0);
        b.rest(5.0);
    }),
    ("the accelerometer falls silent", good, |b| {
        b.with_accel = false;
        b.rest(5.0);
    }),
    ("the gyro falls silent", good, |b| {
        b.with_gyro = false;
        b.rest(2.0);
    }),
    ("field or gyro disagree for `heading.misfit_s`", || Board::rested(Some(planar(40.0))), |b| {
        b.wander_until(200.0, |b| b.state().1 == "calibration_stale");
    }),
    ("they agree again for as long", misfit, |b| {
        b.bias_mgauss.x += 50.0;
        b.wander_until(200.0, |b| b.state().1 != "calibration_stale");
        b.rest(5.0);
    }),
    ("a new candidate is accepted", misfit, |b| {
        b.turn_anew();
        assert_eq!(b.outcomes[0].verdict, Verdict::Accepted);
        b.rest(5.0);
    }),
    ("the magnetometer falls silent", good, |b| {
        b.with_field = false;
        b.rest(1.0);
    }),
    ("an axis overflows", good, |b| {
        b.overflow = true;
        b.rest(1.0);
    }),
    ("it speaks again", || {
        let mut board = good();
        board.with_field = false;
        board.rest(1.0);
        board
    }, |b| {
        b.with_field = true;
        b.rest(5.0);
    }),
    ("the source is in trouble", good, |b| b.tell(trouble())),
    ("the trouble is over", || {
        let mut board = good();
        board.tell(trouble());
        board
    }, |b| b.tell(Event::Fault(None))),
];

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
    for ([from, event, to, reason], (_, begin, happen)) in table.into_iter().zip(SCENARIOS) {
        let mut board = begin();
        let found = match board.reports.last() {
            Some(report) => report.condition.word(),
            None => "(start)",
        };
        assert_eq!(found, from, "before: {event}");
        happen(&mut board);
        let (word, code) = board.state();
        assert_eq!(word, to, "after: {event}");
        if reason == "the refusal's" {
            assert_eq!(code, board.verdict().1);
        } else if reason == "the trouble's" {
            assert_eq!(code, "unplugged");
        } else {
            assert_eq!(code, reason.trim_matches('`'), "after: {event}");
        }
    }
}
