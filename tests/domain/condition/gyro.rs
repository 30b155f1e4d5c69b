//! A gyro that is away or wrong for a while, and what tilt and field say without it.

use super::board::{Board, spatial};
use crate::common::{apart_deg, carried};
use headingd::pipeline::{Event, Settings};
use nalgebra::{Rotation3, Vector3};

/// How a board lies that turns on and rolls and pitches meanwhile.
pub fn swinging(t_s: f64) -> Rotation3<f64> {
    Rotation3::from_euler_angles(0.6 * (1.3 * t_s).sin(), 0.5 * (0.9 * t_s).sin(), 0.6 * t_s)
}

/// A published heading of a board that swings is off by less than this many degrees, or than this many of its deviations.
fn assert_honest(board: &Board, t_s: f64, most_deg: f64, most_sds: f64) {
    let heading = board.heading.as_ref().unwrap();
    if let (Some(found), Some(sd_deg)) = (heading.magnetic_deg(), heading.sd_deg) {
        let error_deg = apart_deg(found, (0.6 * t_s).to_degrees()).abs();
        assert!(
            error_deg < most_deg || error_deg < most_sds * sd_deg,
            "{t_s}: {error_deg} ± {sd_deg}"
        );
    }
}

#[test]
fn a_gyro_that_was_dead_leaves_no_wrong_tilt_behind() {
    let mut board = Board::new(None);
    let mut dead = false;
    let gyro = |t_s: f64, rate| match (60.0..75.0).contains(&t_s) {
        true => Vector3::zeros(),
        false => rate,
    };
    for reading in carried(120.0, swinging, gyro) {
        let t_s = reading.t_s;
        board.tell(Event::Reading(reading));
        dead |= board
            .reports
            .last()
            .is_some_and(|report| report.reason == "gyro_dead");
        if t_s > 80.0 {
            assert_honest(&board, t_s, 5.0, 3.0);
        }
    }
    assert!(dead);
    assert_eq!(board.state(), ("good", "good"));
}

#[test]
fn a_gyro_whose_radians_are_taken_for_degrees_is_named_on_a_level_board() {
    let lies = |t_s: f64| Rotation3::from_euler_angles(0.0, 0.0, 0.6 * t_s);
    let mut board = Board::new(None);
    for reading in carried(60.0, lies, |_, rate| rate.map(f64::to_radians)) {
        board.tell(Event::Reading(reading));
    }
    assert_eq!(board.state(), ("uncalibrated", "gyro_dead"));
}

/// On the wrist of somebody who walks: an arm of 0.6 m that swings by 7° to either side, 1.1 times a second. The accelerations of its
/// circle are three times gravity's share, so that what is felt tilts against the arm.
#[test]
fn a_gyro_on_a_swinging_arm_has_no_wrong_sign() {
    let lies = |t_s: f64| Rotation3::from_euler_angles(0.0, 0.13 * (7.0 * t_s).sin(), 0.2 * t_s);
    let hand = |t_s: f64| lies(t_s) * Vector3::z() * 0.6;
    let mut board = Board::new(None);
    for mut reading in carried(90.0, lies, |_, rate| rate) {
        let (t_s, step_s) = (reading.t_s, 0.001);
        let accelerated = hand(t_s - step_s) + hand(t_s + step_s) - hand(t_s) * 2.0;
        let felt = lies(t_s).inverse() * accelerated / (step_s * step_s);
        reading.specific_force_m_s2 = reading.specific_force_m_s2.map(|force| force + felt);
        board.tell(Event::Reading(reading));
        let reason = board.state().1;
        assert!(!["gyro_sign", "accel_axes"].contains(&reason), "{t_s}");
    }
    assert_eq!(board.state(), ("good", "good"));
}

/// A hand pushes it to and fro and hardly turns it: the specific force tilts, and a filter that has just begun does not know the field's
/// strength, of which a change is a share.
#[test]
fn a_gyro_on_a_board_that_is_pushed_is_not_dead() {
    let lies = |t_s: f64| {
        let swayed = 0.02 * (3.0 * t_s).sin();
        Rotation3::from_euler_angles(swayed, 0.02 * (2.3 * t_s).cos(), swayed)
    };
    let mut board = Board::new(None);
    for mut reading in carried(60.0, lies, |_, rate| rate) {
        let pushed = 2.5 * (4.0 * reading.t_s).sin();
        reading.specific_force_m_s2 =
            (reading.specific_force_m_s2).map(|force| force + Vector3::x() * pushed);
        board.tell(Event::Reading(reading));
        assert_ne!(board.state().1, "gyro_dead");
    }
}

#[test]
fn without_a_gyro_the_accelerometers_low_pass_does_not_lag_behind_a_board_that_tilts() {
    let settings = Settings {
        publish_sd_deg: 60.0,
        ..Settings::default()
    };
    let mut board = Board::with(settings, Some(spatial(0.0)));
    board.turn(90.0);
    board.with_gyro = false;
    board.rest(5.0);
    let mut squares = Vec::new();
    for step in 0..40 {
        for part in 1..=4 {
            let pitch_deg = f64::from(part) * 10.0 - 20.0;
            board.pitch_to(if step % 2 == 0 { pitch_deg } else { -pitch_deg });
            let heading = board.heading.as_ref().unwrap();
            if let (Some(found), Some(sd_deg)) = (heading.instantaneous_deg, heading.sd_deg) {
                squares.push((apart_deg(found, 90.0) / sd_deg).powi(2));
            }
        }
    }
    assert!(squares.len() > 40, "{}", squares.len());
    let nerr = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
    let worst = squares.iter().copied().fold(0.0, f64::max).sqrt();
    assert!(nerr < 1.5 && worst < 4.0, "{nerr}, {worst}");
}

#[test]
fn a_late_gyro_does_not_make_headings_late() {
    const LATE_S: f64 = 0.04;
    let mut board = Board::new(None);
    let late = |t_s: f64, _| {
        let (before, now) = (swinging(t_s - LATE_S - 0.02), swinging(t_s - LATE_S));
        (before.inverse() * now).scaled_axis() / 0.02
    };
    let (mut behind_deg, mut count) = (0.0, 0.0);
    for reading in carried(120.0, swinging, late) {
        let t_s = reading.t_s;
        board.tell(Event::Reading(reading));
        let heading = board.heading.as_ref().unwrap();
        if let (true, Some(found)) = (t_s > 60.0, heading.magnetic_deg()) {
            behind_deg += apart_deg((0.6 * t_s).to_degrees(), found);
            count += 1.0;
        }
    }
    // It turns at 0.6 rad/s, and would be behind by as much as the gyro is late.
    let late_s = behind_deg.to_radians() / count / 0.6;
    assert!(
        count > 1000.0 && late_s.abs() < 0.5 * LATE_S,
        "{count}: {late_s}"
    );
}

#[test]
fn after_a_gap_of_the_gyro_no_heading_is_from_the_frame_before() {
    let mut board = Board::taught(3);
    // A source that reads faster than the chip measures.
    board.repeats = 5;
    board.turn(60.0);
    board.with_gyro = false;
    board.turn(90.0);
    board.with_gyro = true;
    for _ in 0..100 {
        board.rest(0.02);
        if let Some(error_deg) = board.error_deg() {
            let sd_deg = board.heading.as_ref().unwrap().sd_deg.unwrap();
            assert!(
                error_deg.abs() < 3.0 * sd_deg.max(1.0),
                "{error_deg} ± {sd_deg}"
            );
        }
    }
    assert!(board.error_deg().is_some());
}

#[test]
fn spikes_that_are_rejected_disturb_no_board_that_comes_to_rest() {
    let mut board = Board::taught(3);
    board.repeats = 5;
    board.turn(60.0);
    for _ in 0..5 {
        board.turn_at(60.0, 0.1);
        board.bias_mgauss += Vector3::x() * 300.0;
        board.turn_at(60.0, 0.1);
        board.bias_mgauss -= Vector3::x() * 300.0;
    }
    board.rest(10.0);
    assert_eq!(board.state(), ("good", "good"));
    assert!(board.error_deg().unwrap().abs() < 2.0);
}

/// A hand's acceleration has the strength of gravity together with it, and tilts what is felt by 40°.
#[test]
fn without_a_gyro_a_wrong_tilt_shows_in_the_dip() {
    let settings = Settings {
        publish_sd_deg: 180.0,
        ..Settings::default()
    };
    let mut board = Board::with(settings, None);
    let lies = |t_s: f64| swinging(t_s.min(60.0));
    let (mut steady_deg, mut tilted_deg) = (None, None);
    for mut reading in carried(64.0, lies, |_, rate| rate) {
        if reading.t_s > 60.0 {
            reading.rate_rad_s = None;
        }
        if reading.t_s > 62.0 {
            let tilted = Rotation3::new(Vector3::new(0.5, 0.5, 0.0));
            reading.specific_force_m_s2 = reading.specific_force_m_s2.map(|force| tilted * force);
        }
        board.tell(Event::Reading(reading));
        let sd_deg = board.heading.as_ref().and_then(|heading| heading.sd_deg);
        if reading.t_s < 62.0 {
            steady_deg = sd_deg;
        } else {
            tilted_deg = sd_deg;
        }
    }
    let (steady_deg, tilted_deg) = (steady_deg.unwrap(), tilted_deg.unwrap());
    assert!(
        steady_deg < 15.0 && tilted_deg > 45.0,
        "{steady_deg} {tilted_deg}"
    );
}

/// What it claims meanwhile, the field contradicts once its reading changes again.
#[test]
fn a_gyro_that_hangs_for_a_moment_leaves_no_wrong_north() {
    let turning: fn(Vector3<f64>) -> Vector3<f64> = |_| Vector3::z() * 60f64.to_radians();
    let resting: fn(Vector3<f64>) -> Vector3<f64> = |_| Vector3::zeros();
    // After a turn of the first angle, it hangs at this rate for so many seconds, in which the board turns by the second one, degrees.
    for (before_deg, rate, hangs_s, turned_deg) in [
        (60.0, turning, 0.4, 0.0),
        (60.0, turning, 1.0, 0.0),
        (60.0, turning, 5.0, 0.0),
        (60.0, turning, 20.0, 30.0),
        (0.0, resting, 1.0, 60.0),
        (0.0, resting, 2.0, -90.0),
    ] {
        let mut board = Board::taught(1);
        board.turn(before_deg);
        board.gyro = rate;
        board.turn(turned_deg);
        board.rest(hangs_s - turned_deg.abs() / 60.0);
        board.gyro = |rate| rate;
        for _ in 0..10 {
            board.rest(0.5);
            let off_deg = board.error_deg().map_or(0.0, f64::abs);
            assert!(off_deg < 5.0, "{hangs_s} s: {off_deg}");
        }
        assert!(board.error_deg().is_some(), "{hangs_s} s");
        board.tumble();
        assert!(board.error_deg().unwrap().abs() < 3.0, "{hangs_s} s");
    }
}

/// A turntable, and a gyro without noise: the field agrees with what it claims.
#[test]
fn a_gyro_that_repeats_its_reading_in_an_even_turn_is_believed() {
    let mut board = Board::taught(1);
    board.gyro = |_| Vector3::z() * 60f64.to_radians();
    board.turn(200.0);
    board.gyro = |rate| rate;
    board.rest(0.5);
    assert!(board.error_deg().unwrap().abs() < 3.0);
    assert!(board.shown().0);
}

#[test]
fn a_gyro_that_was_dead_on_a_level_board_leaves_no_wrong_bias_behind() {
    let mut board = Board::taught(1);
    board.gyro = |_| Vector3::zeros();
    for _ in 0..3 {
        board.turn_at(18.0, 20.0);
        board.rest(20.0);
    }
    assert_eq!(board.state().1, "gyro_dead");
    board.gyro = |rate| rate;
    board.turn(720.0);
    board.rest(30.0);
    board.tumble();
    assert!(board.error_deg().unwrap().abs() < 3.0);
}

/// Its last value levels the frame as if the board lay as it did.
#[test]
fn an_accelerometer_that_hangs_while_the_board_is_moved_is_a_fault_that_leaves_no_wrong_heading() {
    let mut board = Board::new(None);
    let (mut held, mut named) = (None, false);
    for mut reading in carried(120.0, swinging, |_, rate| rate) {
        let t_s = reading.t_s;
        if (60.0..75.0).contains(&t_s) {
            reading.specific_force_m_s2 = *held.get_or_insert(reading.specific_force_m_s2);
        }
        board.tell(Event::Reading(reading));
        named |= board.state() == ("fault", "frozen_accelerometer");
        if t_s > 60.0 {
            assert_honest(&board, t_s, 10.0, 4.0);
        }
    }
    assert!(named);
    assert_eq!(board.state(), ("good", "good"));
}
