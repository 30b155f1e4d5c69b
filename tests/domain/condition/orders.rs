//! Mode, start, cancel, and iron that comes after the calibration.

use headingd::calibration::model::{Calibration, Parameters};
use headingd::calibration::outcome::Verdict;
use headingd::calibration::policy::{CalibrationOrigin, Policy};
use headingd::condition::SourceFault;
use headingd::pipeline::Event;
use nalgebra::Vector3;

use super::board::{Board, planar, spatial};
use crate::common::{BIAS, EARTH, apart_deg};

/// More than a full turn, less than two.
const A_TURN_DEG: f64 = 365.0;

#[test]
fn mode_off_never_calibrates_by_itself_and_start_makes_it_once() {
    let mut board = Board::rested(Some(planar(30.0)));
    board.tell(Event::Policy(Policy::Off));
    board.turn(A_TURN_DEG);
    assert_eq!(board.asked, 0);
    assert_eq!(board.pipeline.wanted(), None);

    board.tell(Event::Start);
    assert_eq!(board.pipeline.progress(), Some(0.0));
    assert_eq!(board.pipeline.wanted(), Some(CalibrationOrigin::Start));
    board.turn(A_TURN_DEG);
    assert_eq!(board.origin, Some(CalibrationOrigin::Start));
    assert_ne!(board.verdict().0, "rejected");
    assert_eq!(board.pipeline.wanted(), None);
    let (asked, outcomes) = (board.asked, board.outcomes.len());
    board.turn(2.0 * A_TURN_DEG);
    assert_eq!((board.asked, board.outcomes.len()), (asked, outcomes));
}

#[test]
fn how_far_a_turn_is_is_not_known_while_nothing_comes() {
    let mut board = Board::rested(None);
    board.turn(100.0);
    assert!(board.pipeline.progress().unwrap() > 0.2);
    board.tell(Event::Fault(Some(SourceFault {
        code: "unplugged",
        message: "the port is gone".to_owned(),
    })));
    assert_eq!(board.pipeline.progress(), None);
    board.tell(Event::Fault(None));
    board.turn(100.0);
    assert!(board.pipeline.progress().unwrap() > 0.2);
    board.tell(Event::Silence(60.0));
    assert_eq!(board.state(), ("stale", "no_samples"));
    assert_eq!(board.pipeline.progress(), None);
}

#[test]
fn progress_is_the_way_to_a_heading_and_then_to_a_good_one() {
    let mut board = Board::new(None);
    for _ in 0..20 {
        board.pitch_to(40.0);
        board.turn(30.0);
        board.pitch_to(-40.0);
        board.turn(-30.0);
    }
    assert_eq!(board.state(), ("good", "good"));
    for reason in ["no_calibration", "learning"] {
        let reports = board
            .reports
            .iter()
            .filter(|report| report.reason == reason);
        let progress: Vec<f64> = reports.map(|report| report.progress.unwrap()).collect();
        // On the way to a good one it comes and goes with the board's pose.
        let (first, last) = (progress[0], progress[progress.len() - 1]);
        assert!(progress.iter().all(|one| (0.0..=1.0).contains(one)));
        assert!(first < 0.5 && last > 0.8, "{reason}: {progress:?}");
    }
    assert_eq!(board.reports.last().unwrap().progress, None);
}

#[test]
fn what_was_turned_before_the_start_does_not_count() {
    let mut board = Board::rested(None);
    board.turn(300.0);
    board.tell(Event::Start);
    board.turn(300.0);
    assert_eq!(board.asked, 0);
    board.turn(65.0);
    assert_eq!(board.asked, 1);
}

#[test]
fn a_start_whose_turn_was_refused_waits_for_the_next_turn() {
    let mut board = Board::rested(None);
    board.tell(Event::Policy(Policy::Off));
    assert_eq!(board.state(), ("uncalibrated", "mode_off"));
    board.tell(Event::Start);
    assert_eq!(board.state(), ("uncalibrated", "no_calibration"));
    board.turn(180.0);
    let clean = board.bias_mgauss;
    board.bias_mgauss.x -= 150.0;
    board.turn(172.0);
    assert_eq!(board.verdict().0, "rejected");
    assert_eq!(board.pipeline.wanted(), Some(CalibrationOrigin::Start));
    board.bias_mgauss = clean;
    board.turn_anew();
    assert_ne!(board.verdict().0, "rejected");
    assert_eq!(board.pipeline.wanted(), None);
}

#[test]
fn a_calibration_that_nobody_wants_any_more_changes_nothing() {
    let orders = [
        Event::Cancel,
        Event::Start,
        Event::Policy(Policy::Locked),
        Event::Policy(Policy::Off),
        Event::Activate(Some(Box::new(planar(20.0)))),
    ];
    for order in orders {
        let mut board = Board::rested(Some(planar(30.0)));
        board.late = true;
        board.turn(A_TURN_DEG);
        let what = format!("{order:?}");
        assert!(board.under_way.is_some(), "{what}");
        board.tell(order);
        let before = board.pipeline.calibration().map(|one| one.parameters);
        board.finish();
        assert_eq!(board.verdict(), ("kept", "cancelled"), "{what}");
        let after = board.pipeline.calibration().map(|one| one.parameters);
        assert_eq!(before, after, "{what}");
    }
    // The next turn is calibrated on, as ever.
    let mut board = Board::rested(None);
    board.late = true;
    board.turn(A_TURN_DEG);
    board.tell(Event::Cancel);
    board.finish();
    assert_eq!(board.verdict().1, "cancelled");
    board.late = false;
    let asked = board.asked;
    board.turn(A_TURN_DEG);
    assert_eq!(board.asked, asked + 1);
    assert_ne!(board.verdict().0, "rejected");
}

#[test]
fn a_locked_calibration_is_never_replaced() {
    let mut board = Board::rested(Some(planar(50.0)));
    board.tell(Event::Policy(Policy::Locked));
    board.rest(1.0);
    let locked = board.pipeline.calibration().unwrap().parameters;
    board.turn(A_TURN_DEG);
    board.tell(Event::Start);
    board.turn(A_TURN_DEG);
    board.tumble();
    assert_eq!((board.asked, board.outcomes.len()), (0, 0));
    assert_eq!(board.pipeline.calibration().unwrap().parameters, locked);
    // It says that it does not fit.
    assert_ne!(board.state().0, "good");
    // A start that was refused is not left over, and what is wrong is learnt as soon as it may be.
    board.tell(Event::Cancel);
    board.tell(Event::Policy(Policy::On));
    board.tumble();
    board.tumble();
    assert_ne!(board.pipeline.calibration().unwrap().parameters, locked);
    let error = board.error_deg().unwrap();
    assert!(error.abs() < 5.0, "{error}");
}

/// Only what was asked for would be calibrated on where the mode is off.
#[test]
fn a_lock_gives_up_what_was_asked_for() {
    let mut board = Board::rested(Some(planar(0.0)));
    board.tell(Event::Start);
    board.tell(Event::Policy(Policy::Locked));
    board.tell(Event::Policy(Policy::Off));
    board.turn(A_TURN_DEG);
    assert_eq!(board.asked, 0);
}

#[test]
fn iron_that_has_come_is_learnt_in_motion_and_kept() {
    let mut board = Board::taught(2);
    board.bias_mgauss.x += 55.0;
    for _ in 0..4 {
        board.tumble();
    }
    assert_eq!(board.state(), ("good", "good"));
    let error = board.error_deg().unwrap();
    assert!(error.abs() < 4.0, "{error}");
    let mut kept = board
        .outcomes
        .iter()
        .filter(|one| one.verdict == Verdict::Accepted);
    let Some(Parameters::Spatial(found)) = kept
        .next_back()
        .filter(|outcome| outcome.method == "motion")
        .and_then(|outcome| outcome.calibration)
        .map(|calibration| calibration.parameters)
    else {
        panic!("{:?}", board.outcomes.last());
    };
    let off = (found.bias_mgauss - board.bias_mgauss).norm();
    assert!(off < 20.0, "{off}");
}

#[test]
fn what_is_learnt_after_a_time_that_jumps_back_is_kept() {
    let mut board = Board::rested(None);
    board.rest(100.0);
    let kept = |board: &Board| {
        let outcomes = board.outcomes.iter();
        let accepted = outcomes.filter(|one| one.verdict == Verdict::Accepted);
        accepted.count()
    };
    board.tumble();
    assert_eq!(kept(&board), 1);
    board.restart_clock();
    board.bias_mgauss.x += 55.0;
    for _ in 0..4 {
        board.tumble();
    }
    assert!(kept(&board) > 1);
}

#[test]
fn the_gyros_bias_stays_known_where_the_clock_begins_anew() {
    let mut board = Board::new(Some(spatial(0.0)));
    // 3°/s about each axis.
    board.gyro = |rate| rate.add_scalar(0.052);
    board.rest(30.0);
    board.tumble();
    board.restart_clock();
    let mut worst_deg = 0.0;
    for step in 0..40 {
        board.turn(if step % 8 < 4 { 50.0 } else { -50.0 });
        worst_deg = board
            .error_deg()
            .map_or(worst_deg, |error_deg| error_deg.abs().max(worst_deg));
    }
    assert!(board.error_deg().is_some());
    assert!((0.0..3.0).contains(&worst_deg), "{worst_deg}");
}

/// Each sample alone is as the one before, and no place is as uneven as a magnet of 6 % of the field.
#[test]
fn a_magnet_that_no_sample_shows_is_told_by_the_iron_that_moves() {
    let mut board = Board::taught(2);
    for _ in 0..30 {
        board.bias_mgauss.x += 1.2;
        // One reading.
        board.turn(1.2);
    }
    board.pitch_to(40.0);
    board.turn(180.0);
    let told = |board: &Board| board.reports.iter().any(|r| r.reason == "field_changed");
    assert!(told(&board), "{:?}", board.reports.last());
    board.tumble();
    assert_eq!(board.state(), ("good", "good"));
}

#[test]
fn iron_in_one_place_is_not_taken_for_the_boards_own() {
    let mut board = Board::taught(2);
    let earth = board.earth_mgauss;
    for _ in 0..10 {
        // Past a steel door, and on.
        board.earth_mgauss = 1.4 * earth;
        board.turn(100.0);
        board.earth_mgauss = earth;
        board.turn(-300.0);
        board.turn(200.0);
    }
    assert!(board.reports.iter().any(|r| r.reason == "field_strength"));
    board.tumble();
    assert_eq!(board.state().0, "good");
    let error = board.error_deg().unwrap();
    assert!(error.abs() < 4.0, "{error}");
}

#[test]
fn a_motor_that_runs_only_in_the_turn_is_betrayed_by_the_rest_before_it() {
    let mut board = Board::rested(None);
    board.bias_mgauss += Vector3::new(50.0, 50.0, 0.0);
    board.turn(A_TURN_DEG);
    assert_eq!(board.verdict(), ("rejected", "rest"));
    // With the motor still running there is no such contradiction.
    board.rest(5.0);
    board.turn_anew();
    assert_ne!(board.verdict().0, "rejected");
}

#[test]
fn an_hour_of_rest_teaches_nothing_and_costs_nothing() {
    let mut board = Board::taught(2);
    board.rest(60.0);
    let before = board.heading.clone().unwrap();
    board.rest(3600.0);
    let after = board.heading.clone().unwrap();
    assert_eq!(board.state(), ("good", "good"));
    let moved = apart_deg(before.fused_deg.unwrap(), after.fused_deg.unwrap());
    assert!(moved.abs() < 1.0, "the heading has moved by {moved}");
    let (before, after) = (before.sd_deg.unwrap(), after.sd_deg.unwrap());
    assert!(after < 1.1 * before, "{before} has become {after}");
}

/// Where the field points straight down, its noise has an azimuth, and no board has a heading.
#[test]
fn at_the_magnetic_pole_there_is_no_heading() {
    let mut board = Board::new(Some(spatial(0.0)));
    board.earth_mgauss = Vector3::new(0.0, 0.0, 600.0);
    for _ in 0..6 {
        board.tumble();
        for _ in 0..1500 {
            board.rest(0.02);
            let published = board.heading.as_ref().expect("each sample is published");
            assert_eq!(published.fused_deg, None);
        }
    }
}

/// The gyro carries the heading of a board at rest, whatever the field does.
#[test]
fn iron_that_is_carried_about_a_board_at_rest_moves_its_heading_no_further_than_it_admits() {
    let mut board = Board::new(Some(spatial(0.0)));
    // A bias that it has learnt in motion alone.
    board.gyro = |rate| rate + Vector3::new(0.009, -0.007, 0.010);
    board.tumble();
    board.tumble();
    board.rest(25.0);
    let before = board.heading.clone().unwrap().fused_deg.unwrap();
    let across = Vector3::new(0.4, -0.8, 0.4);
    for step in 0..1500 {
        // There within 3 s, and carried to and fro at a distance of 0.3 to 0.5 m.
        let t_s = 0.02 * f64::from(step);
        let far_m = 0.4 + 1.2 * (1.0 - t_s / 3.0).max(0.0) + 0.1 * t_s.sin();
        board.bias_mgauss = BIAS + across * (8.0 / far_m.powi(3));
        board.rest(0.02);
    }
    let after = board.heading.clone().unwrap();
    let (moved, sd) = (
        apart_deg(before, after.fused_deg.unwrap()),
        after.sd_deg.unwrap(),
    );
    assert!(
        moved.abs() < 3.0 * sd,
        "the heading has moved by {moved}, with a deviation of {sd}"
    );
}

#[test]
fn headings_are_good_again_once_a_magnet_has_left_a_board_at_rest() {
    let mut board = Board::taught(2);
    board.rest(20.0);
    let magnet = Vector3::new(-40.0, 150.0, 60.0);
    board.bias_mgauss += magnet;
    board.rest(16.0);
    assert_eq!(board.state(), ("disturbed", "field_changed"));
    board.bias_mgauss -= magnet;
    board.rest(10.0);
    assert_eq!(board.state(), ("good", "good"));
    // One that stays is not forgotten.
    board.bias_mgauss += magnet;
    board.rest(60.0);
    assert_eq!(board.state(), ("disturbed", "field_changed"));
}

#[test]
fn a_restart_begins_with_the_gyros_bias_of_before() {
    let biased = |calibration: Option<Calibration>| {
        let mut board = Board::new(calibration);
        board.gyro = |rate| rate + Vector3::new(0.08, -0.02, 0.03);
        board
    };
    let mut before = biased(Some(spatial(0.0)));
    for _ in 0..4 {
        before.tumble();
    }
    let kept = before.pipeline.calibration().unwrap();
    let known = kept.gyro_bias_deg_s.unwrap().map(f64::to_radians);
    let off = (known - Vector3::new(0.08, -0.02, 0.03))
        .norm()
        .to_degrees();
    assert!(off < 0.5, "{off} degrees a second");

    let unknown = Calibration {
        gyro_bias_deg_s: None,
        ..kept
    };
    let [with, without] = [kept, unknown].map(|calibration| {
        let mut board = biased(Some(calibration));
        let mut worst = 0.0f64;
        for _ in 0..20 {
            board.turn(6.0);
            worst = worst.max(board.error_deg().map_or(0.0, f64::abs));
        }
        worst
    });
    assert!(with < 3.0 && with < 0.5 * without, "{with} and {without}");
}

#[test]
fn a_restart_begins_with_the_accelerometers_bias_of_before() {
    let biased = |calibration| {
        let mut board = Board::new(calibration);
        board.accel_bias_m_s2 = Vector3::new(0.3, -0.3, 0.0);
        board
    };
    let mut before = biased(Some(spatial(0.0)));
    for _ in 0..6 {
        before.tumble();
    }
    let kept = before.pipeline.calibration().unwrap();

    let unknown = Calibration {
        accel_bias_m_s2: None,
        ..kept
    };
    let [with, without] = [kept, unknown].map(|calibration| {
        let mut board = biased(Some(calibration));
        board.rest(10.0);
        board.error_deg().unwrap().abs()
    });
    assert!(with < 1.5 && with < 0.5 * without, "{with} and {without}");
}

#[test]
fn a_board_that_is_mounted_otherwise_keeps_its_gyros_bias() {
    let mut board = Board::new(Some(spatial(0.0)));
    board.gyro = |rate| rate + Vector3::new(0.08, -0.02, 0.03);
    for _ in 0..4 {
        board.tumble();
    }
    board.tell(Event::Mounted(Box::default()));
    for _ in 0..20 {
        board.turn(6.0);
        if let Some(error_deg) = board.error_deg() {
            assert!(error_deg.abs() < 3.0, "{error_deg}");
        }
    }
    assert!(board.error_deg().is_some());
}

/// While an axis overflows, the frame drifts with the gyro's bias. The heading comes from the iron again.
#[test]
fn after_minutes_without_a_field_the_gyros_drift_does_not_count() {
    let mut board = Board::new(Some(spatial(0.0)));
    for _ in 0..4 {
        board.tumble();
    }
    board.overflow = true;
    // 0.3°/s: 36° in this time.
    board.gyro = |rate| rate + Vector3::z() * 0.0052;
    for _ in 0..20 {
        board.turn(180.0);
        board.turn(-180.0);
    }
    board.overflow = false;
    board.turn(90.0);
    let heading = board.heading.as_ref().unwrap();
    let (error_deg, sd_deg) = (board.error_deg().unwrap(), heading.sd_deg.unwrap());
    assert!(
        error_deg.abs() < 3.0 && sd_deg < 6.0,
        "{error_deg} ± {sd_deg}"
    );
}

#[test]
fn without_a_gyro_a_kept_calibration_gives_the_headings_of_single_samples() {
    for calibration in [planar(0.0), spatial(0.0)] {
        let mut board = Board::new(Some(calibration));
        board.with_gyro = false;
        for _ in 0..8 {
            board.turn(45.0);
            let heading = board.heading.as_ref().unwrap();
            assert_eq!(board.state(), ("degraded", "no_gyro"));
            assert_eq!(heading.fused_deg, None);
            let (found, sd) = (heading.instantaneous_deg.unwrap(), heading.sd_deg.unwrap());
            let truth = heading.seq as f64 * 0.02 * 60.0;
            let error = apart_deg(found, truth);
            assert!(error.abs() < 3.0 && sd < 10.0, "{error} {sd}");
        }
        // It has no gyro to carry the heading where the field is not the earth's.
        board.earth_mgauss *= 1.4;
        board.rest(5.0);
        assert_eq!(board.state(), ("disturbed", "field_strength"));
    }
    // One that knows only the plane of its turn says nothing out of it.
    let mut board = Board::new(Some(planar(0.0)));
    board.with_gyro = false;
    board.pitch_to(45.0);
    assert_eq!(board.heading.as_ref().unwrap().instantaneous_deg, None);
}

#[test]
fn a_board_that_is_mounted_otherwise_keeps_its_accelerometer() {
    let mut board = Board::rested(Some(spatial(0.0)));
    board.tell(Event::Mounted(Box::default()));
    board.with_accel = false;
    board.rest(0.1);
    assert_ne!(board.state().1, "no_accelerometer");
    board.rest(2.0);
    assert_eq!(board.state(), ("degraded", "no_accelerometer"));
}

#[test]
fn a_kept_calibration_is_in_doubt_where_the_field_has_another_strength_until_the_board_moves() {
    let at_rest = |share: f64, iron_came: Vector3<f64>| {
        let Parameters::Spatial(made) = spatial(0.0).parameters else {
            unreachable!()
        };
        let made = Calibration::of(Parameters::Spatial(made), share * EARTH.norm(), 1.2, 0.05);
        let mut board = Board::new(Some(made));
        board.earth_mgauss *= share;
        board.bias_mgauss += iron_came;
        board.rest(5.0);
        board
    };
    for share in [0.7, 1.0, 1.2] {
        let off_deg = at_rest(share, Vector3::zeros()).error_deg();
        assert!(off_deg.is_some_and(|deg| deg.abs() < 3.0), "{share}");
    }
    let mut board = at_rest(1.0, Vector3::new(100.0, -100.0, 100.0));
    assert_eq!(board.error_deg(), None);
    assert_eq!(board.state(), ("degraded", "learning"));
    board.tumble();
    board.tumble();
    assert!(board.error_deg().unwrap().abs() < 3.0);
}
