//! Mode, start, cancel, and a calibration that has stopped fitting.

use headingd::calibration::model::Mode;
use headingd::calibration::outcome::Verdict;
use headingd::calibration::policy::{Policy, Reason};
use headingd::condition::Trouble;
use headingd::heading::MagStatus;
use headingd::pipeline::Event;

use super::board::{Board, planar, spatial};

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
    assert_eq!(board.pipeline.wanted(), Some(Reason::Start));
    board.turn(A_TURN_DEG);
    assert_eq!((board.asked, board.pipeline.reason()), (1, Reason::Start));
    assert_eq!(board.verdict(), ("accepted".to_owned(), "good"));
    board.turn(A_TURN_DEG);
    assert_eq!(board.asked, 1);
}

#[test]
fn how_far_a_turn_is_is_not_known_while_nothing_comes() {
    let mut board = Board::rested(None);
    board.turn(100.0);
    assert!(board.pipeline.progress().unwrap() > 0.2);
    board.tell(Event::Fault(Some(Trouble {
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
    assert_eq!(board.pipeline.wanted(), Some(Reason::Start));
    board.bias_mgauss = clean;
    board.turn_anew();
    assert_eq!(board.verdict().0, "accepted");
    assert_eq!(board.pipeline.wanted(), None);
}

#[test]
fn a_calibration_that_nobody_wants_any_more_changes_nothing() {
    let orders = [
        Event::Cancel,
        Event::Start,
        Event::Policy(Policy::Locked),
        Event::Policy(Policy::Off),
        Event::InForce(Some(planar(20.0))),
    ];
    for order in orders {
        let mut board = Board::rested(Some(planar(30.0)));
        board.late = true;
        board.turn(A_TURN_DEG);
        let what = format!("{order:?}");
        assert!(board.under_way.is_some(), "{what}");
        board.tell(order.clone());
        board.finish();
        assert_eq!(board.verdict(), ("kept".to_owned(), "cancelled"), "{what}");
        let stays = match order {
            Event::InForce(other) => other.unwrap(),
            _ => planar(30.0),
        };
        assert_eq!(board.pipeline.calibration(), Some(&stays), "{what}");
    }
    // And none is in force where none was.
    let mut board = Board::rested(None);
    board.late = true;
    board.turn(A_TURN_DEG);
    board.tell(Event::Cancel);
    assert_eq!(board.state(), ("uncalibrated", "no_calibration"));
    board.finish();
    assert_eq!(board.verdict(), ("rejected".to_owned(), "cancelled"));
    assert_eq!(board.state(), ("uncalibrated", "no_calibration"));
    // The next turn is calibrated on, as ever.
    board.late = false;
    board.turn(A_TURN_DEG);
    assert_eq!(board.verdict().0, "accepted");
}

#[test]
fn a_locked_calibration_is_never_replaced() {
    let worn = planar(50.0);
    let mut board = Board::rested(Some(worn));
    board.tell(Event::Policy(Policy::Locked));
    board.turn(A_TURN_DEG);
    board.tell(Event::Start);
    board.turn(A_TURN_DEG);
    assert_eq!(board.asked, 0);
    // It says that it does not fit, and what helps.
    board.wander_until(200.0, |board| board.state().1 == "calibration_stale");
    let message = &board.reports.last().unwrap().message;
    assert!(message.contains("calibration unlock"), "{message}");
    board.turn(2.0 * A_TURN_DEG);
    assert_eq!(board.asked, 0);
    assert_eq!(board.pipeline.calibration(), Some(&worn));
    // A start that was refused is not left over.
    board.tell(Event::Cancel);
    board.tell(Event::Policy(Policy::On));
    board.turn(A_TURN_DEG);
    assert_eq!(board.verdict().0, "accepted");
}

#[test]
fn a_calibration_that_has_stopped_fitting_is_replaced_by_the_next_turn_and_not_before() {
    // Calibrated on a very still day: a turn of today gives less certain headings.
    let mut still = planar(0.0);
    (still.residual_mgauss, still.heading_sd_deg) = (0.4, 0.01);
    let mut board = Board::rested(Some(still));
    board.wander(20.0);
    board.bias_mgauss.x += 55.0;
    let after_s = board.wander_until(200.0, |board| board.state().1 == "calibration_stale");
    assert!(after_s > 30.0, "{after_s}");
    assert_eq!(board.asked, 0);
    assert_eq!(board.pipeline.calibration(), Some(&still));
    assert_eq!(board.pipeline.wanted(), Some(Reason::Stale));
    let heading = board.heading.as_ref().unwrap();
    assert_eq!(heading.mag_status, MagStatus::Calibration);
    assert!(heading.instantaneous_deg.is_some());

    board.turn_anew();
    assert_eq!(board.pipeline.reason(), Reason::Stale);
    assert_eq!(board.verdict(), ("accepted".to_owned(), "good"));
    board.rest(5.0);
    assert_eq!(board.state(), ("good", "good"));
}

#[test]
fn one_of_all_axes_that_has_stopped_fitting_is_replaced_by_one_of_the_plane() {
    let mut board = Board::rested(Some(spatial(0.0)));
    board.bias_mgauss.x += 90.0;
    board.wander_until(200.0, |board| board.state().1 == "calibration_stale");
    assert_eq!(board.asked, 0);
    board.turn_anew();
    assert_eq!(board.outcomes[0].verdict, Verdict::Accepted);
    let calibration = board.pipeline.calibration().unwrap();
    assert_eq!(calibration.parameters.mode(), Mode::Planar);
}

#[test]
fn one_that_is_doubted_without_reason_is_kept_and_trusted_again() {
    let mut board = Board::rested(Some(planar(50.0)));
    board.wander_until(200.0, |board| board.state().1 == "calibration_stale");
    // The magnet that was carried about is gone, just before the turn.
    board.bias_mgauss.x += 50.0;
    board.turn_anew();
    assert_eq!(board.verdict(), ("kept".to_owned(), "not_better"));
    board.rest(5.0);
    assert_eq!(board.state(), ("good", "good"));
}

#[test]
fn iron_in_one_place_makes_no_calibration_stale() {
    let mut board = Board::rested(Some(planar(0.0)));
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
    assert!(
        !board
            .reports
            .iter()
            .any(|r| r.reason == "calibration_stale")
    );
}
