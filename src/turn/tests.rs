use super::*;
use crate::attitude::test_board::TestBoard;
use crate::attitude::{Attitude, Settings as AttitudeSettings};
use crate::frame::Mountings;

fn turns_with(board: &TestBoard, settings: &Settings) -> Vec<Turn> {
    let mut attitude = Attitude::new(&AttitudeSettings::default(), &Mountings::default());
    let mut detector = TurnDetector::new(settings);
    let mut turns = Vec::new();
    for reading in &board.readings {
        attitude.take(reading, |tick| turns.extend(detector.tick(tick)));
        assert!((0.0..=1.0).contains(&detector.progress()));
    }
    turns
}

fn turns(board: &TestBoard) -> Vec<Turn> {
    turns_with(board, &Settings::default())
}

/// A board that has rested, its bias learnt.
fn rested() -> TestBoard {
    let mut board = TestBoard::default();
    board.rest(5.0);
    board
}

fn blind() -> TestBoard {
    let mut board = TestBoard {
        accel: false,
        ..TestBoard::default()
    };
    board.rest(5.0);
    board
}

fn degrees_off(turn: &Turn, axis: Vector3<f64>) -> f64 {
    turn.axis_body.angle(&axis.normalize()).to_degrees()
}

#[test]
fn once_round_is_one_turn_and_a_little_less_is_none() {
    for board in [rested, blind] {
        for sign in [1.0, -1.0] {
            let mut full = board();
            full.turn(Vector3::z(), sign * 360.0, 45.0);
            full.rest(3.0);
            let found = turns(&full);
            assert_eq!(found.len(), 1);
            let turn = found[0];
            assert!(degrees_off(&turn, Vector3::z() * sign) < 2.0);
            assert!((turn.start_s - 5.0).abs() < 0.3, "{turn:?}");
            assert!((turn.end_s - 12.7).abs() < 0.3, "{turn:?}");
            assert!(turn.from_vertical_deg.is_none_or(|deg| deg < 2.0));

            let mut short = board();
            short.turn(Vector3::z(), sign * 340.0, 45.0);
            short.rest(3.0);
            assert!(turns(&short).is_empty());
        }
    }
}

#[test]
fn two_turns_are_two() {
    for mut board in [rested(), blind()] {
        board.turn(Vector3::z(), 720.0, 60.0);
        let found = turns(&board);
        assert_eq!(found.len(), 2);
        assert!(found[1].start_s >= found[0].end_s - 1e-9);
    }
}

#[test]
fn what_is_left_of_one_turn_does_not_cost_the_next() {
    for pause_s in [0.0, 2.0, 8.0] {
        for left_deg in [5.0, 10.0, 12.0, 15.0, 19.0, 25.0, 30.0] {
            for mut board in [rested(), blind()] {
                board.turn(Vector3::z(), 345.0 + left_deg, 45.0);
                board.rest(pause_s);
                board.turn(Vector3::x(), 360.0, 45.0);
                let found = turns(&board);
                assert_eq!(found.len(), 2, "{left_deg} after {pause_s} s: {found:?}");
                assert!(degrees_off(&found[1], Vector3::x()) < 5.0, "{found:?}");
            }
        }
    }
}

#[test]
fn going_back_takes_away() {
    for board in [rested, blind] {
        let mut back = board();
        back.turn(Vector3::z(), 200.0, 60.0);
        back.turn(Vector3::z(), -150.0, 60.0);
        back.turn(Vector3::z(), 280.0, 60.0);
        assert!(turns(&back).is_empty());
        back.turn(Vector3::z(), 40.0, 60.0);
        back.rest(2.0);
        assert_eq!(turns(&back).len(), 1);
    }
}

#[test]
fn a_turn_begins_after_the_fidgeting_before_it() {
    let mut board = rested();
    board.turn(Vector3::x(), 20.0, 40.0);
    board.turn(Vector3::z(), -50.0, 40.0);
    board.turn(Vector3::z(), 80.0, 40.0);
    board.turn(Vector3::x(), -20.0, 40.0);
    board.rest(2.0);
    let begins_s = board.t_s;
    board.turn(Vector3::z(), 352.0, 45.0);
    board.rest(2.0);
    let found = turns(&board);
    assert_eq!(found.len(), 1, "{found:?}");
    assert!((found[0].start_s - begins_s).abs() < 0.3, "{found:?}");
}

#[test]
fn where_the_board_stops_short_the_fidgeting_before_a_turn_is_part_of_it() {
    for board in [rested, blind] {
        let mut board = board();
        board.turn(Vector3::z(), -50.0, 40.0);
        board.turn(Vector3::z(), 80.0, 40.0);
        board.rest(2.0);
        board.turn(Vector3::z(), 300.0, 45.0);
        board.rest(2.0);
        let found = turns(&board);
        assert_eq!(found.len(), 1, "{found:?}");
    }
}

#[test]
fn stops_on_the_way_do_not_matter() {
    for mut board in [rested(), blind()] {
        for _ in 0..6 {
            board.turn(Vector3::z(), -60.0, 40.0);
            board.rest(4.0);
        }
        let found = turns(&board);
        assert_eq!(found.len(), 1);
        assert!((found[0].start_s - 5.0).abs() < 0.3);
    }
}

#[test]
fn uneven_events_make_no_difference() {
    let mut board = TestBoard {
        steps_s: vec![0.002, 0.003, 0.002, 0.06, 0.004, 0.001, 0.25],
        ..TestBoard::default()
    };
    board.rest(6.0);
    board.turn(Vector3::z(), 365.0, 45.0);
    board.rest(2.0);
    assert_eq!(turns(&board).len(), 1);
}

#[test]
fn a_short_drop_out_is_bridged_and_a_long_one_voids() {
    for (gap_s, expected) in [(0.4, 1), (0.8, 0)] {
        let mut board = rested();
        board.turn(Vector3::z(), 180.0, 45.0);
        board.gyro = false;
        board.turn(Vector3::z(), 45.0 * gap_s, 45.0);
        board.gyro = true;
        board.turn(Vector3::z(), 180.0 - 45.0 * gap_s, 45.0);
        assert_eq!(turns(&board).len(), expected, "{gap_s}");
    }
}

#[test]
fn clipped_rotation_counts_for_what_it_shows() {
    let mut board = rested();
    board.turn(Vector3::z(), 300.0, 300.0);
    board.turn(Vector3::z(), 120.0, 100.0);
    for reading in &mut board.readings {
        let limit = 250f64.to_radians();
        reading.rate_rad_s = reading
            .rate_rad_s
            .map(|r| r.map(|v| v.clamp(-limit, limit)));
    }
    let found = turns(&board);
    assert_eq!(found.len(), 1);
    // The true 345° came 0.1 s earlier.
    assert!(found[0].end_s > 6.9, "{found:?}");
}

#[test]
fn a_large_gyro_bias_makes_no_turn_and_costs_none() {
    let bias = Vector3::new(5.0, -4.0, 5.0);
    for accel in [true, false] {
        let mut board = TestBoard {
            gyro_bias_deg_s: bias,
            accel,
            ..TestBoard::default()
        };
        board.rest(150.0);
        assert!(turns(&board).is_empty());
        board.turn(Vector3::z(), 360.0, 40.0);
        assert_eq!(turns(&board).len(), 1);
    }
}

#[test]
fn a_tilted_turn_says_its_axis_and_its_tilt() {
    let mut board = rested();
    board.turn(Vector3::x(), 12.0, 20.0);
    // About the body's own Z, now 12° from the vertical.
    board.turn(Vector3::z(), 362.0, 45.0);
    let found = turns(&board);
    assert_eq!(found.len(), 1);
    assert!(degrees_off(&found[0], Vector3::z()) < 3.0, "{found:?}");
    assert!((found[0].from_vertical_deg.unwrap() - 12.0).abs() < 2.0);
    // About the vertical with the board held at a tilt: the axis is not body Z.
    let mut board = rested();
    board.turn(Vector3::x(), 30.0, 20.0);
    board.turn_up(-350.0, 45.0);
    let found = turns(&board);
    let down = board.attitude.inverse() * -Vector3::z();
    assert!(degrees_off(&found[0], down) < 2.0, "{found:?}");
    assert!(found[0].from_vertical_deg.unwrap() < 2.0);
}

#[test]
fn a_roll_about_body_x_is_a_turn_across_the_vertical() {
    let mut board = rested();
    board.turn(Vector3::x(), 360.0, 60.0);
    let found = turns(&board);
    assert_eq!(found.len(), 1);
    assert!(degrees_off(&found[0], Vector3::x()) < 3.0);
    assert!((found[0].from_vertical_deg.unwrap() - 90.0).abs() < 3.0);
}

#[test]
fn a_slow_turn_counts() {
    for accel in [true, false] {
        let mut board = TestBoard {
            accel,
            ..TestBoard::default()
        };
        board.rest(12.0);
        board.turn(Vector3::z(), 358.0, 3.1);
        let found = turns(&board);
        assert_eq!(found.len(), 1, "{accel}");
        assert!((found[0].start_s - 12.0).abs() < 2.0, "{found:?}");
    }
}

#[test]
fn creeping_before_the_start_is_trimmed() {
    let mut board = rested();
    board.turn(Vector3::z(), 15.0, 1.0);
    board.turn(Vector3::z(), 360.0, 45.0);
    let found = turns(&board);
    assert_eq!(found.len(), 1);
    assert!((found[0].start_s - 20.0).abs() < 0.6, "{found:?}");
}

#[test]
fn shaking_and_swinging_in_circles_is_no_turn() {
    use std::f64::consts::TAU;
    let amplitude = 30f64.to_radians();
    for board in [rested, blind] {
        // To and fro about three axes at once, at unlike frequencies.
        let mut shaken = board();
        shaken.go(120.0, |_, t| {
            let part = |hz: f64| amplitude * TAU * hz * (TAU * hz * t).cos();
            Vector3::new(part(0.5), part(0.83), part(1.1))
        });
        assert!(turns(&shaken).is_empty());
        // The nose-up end goes round in circles while the heading stays.
        let mut swung = board();
        swung.turn(Vector3::x(), 25.0, 30.0);
        let spin = Vector3::z() * TAU * 0.5;
        swung.go(120.0, |b, _| b.attitude.inverse() * spin + spin);
        assert!(turns(&swung).is_empty());
    }
}

#[test]
fn what_turns_faster_than_a_board_is_no_turn() {
    for board in [rested, blind] {
        for (deg_s, expected) in [(300.0, 1), (400.0, 0), (2900.0, 0)] {
            let mut board = board();
            board.turn(Vector3::z(), 400.0, deg_s);
            assert_eq!(turns(&board).len(), expected, "{deg_s}");
        }
    }
}

#[test]
fn a_turn_past_the_time_limit_is_none() {
    let settings = Settings {
        time_limit_s: 10.0,
        ..Settings::default()
    };
    for board in [rested, blind] {
        for (deg_s, expected) in [(30.0, 0), (40.0, 1)] {
            let mut board = board();
            board.turn(Vector3::z(), 400.0, deg_s);
            assert_eq!(turns_with(&board, &settings).len(), expected, "{deg_s}");
        }
    }
}
