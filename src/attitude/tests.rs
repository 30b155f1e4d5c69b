use super::test_board::TestBoard;
use super::*;
use crate::frame::pitch_and_roll_deg;

fn run(board: &TestBoard) -> (Attitude, Vec<BoardMotion>) {
    run_with(board, &Settings::default())
}

fn run_with(board: &TestBoard, settings: &Settings) -> (Attitude, Vec<BoardMotion>) {
    let mut attitude = Attitude::new(settings, &Mountings::default());
    let mut ticks = Vec::new();
    for reading in &board.readings {
        attitude.take(reading, |tick| ticks.push(*tick));
    }
    (attitude, ticks)
}

fn new() -> Attitude {
    Attitude::new(&Settings::default(), &Mountings::default())
}

/// Takes what the board has read since the last time. Returns its pose now.
fn play(attitude: &mut Attitude, board: &mut TestBoard) -> Pose {
    for reading in board.readings.drain(..) {
        attitude.take(&reading, |_| {});
    }
    attitude.pose_at(board.t_s).unwrap()
}

/// By how much the bias learnt is off, degrees per second.
fn bias_error(state: &BoardState, board: &TestBoard) -> f64 {
    let learnt = state.gyro_bias.rad_s.map(f64::to_degrees);
    (learnt - board.gyro_bias_deg_s).norm()
}

/// How far up in this pose is from the board's, radians.
fn tilt_error_rad(pose: &Pose, board: &TestBoard) -> f64 {
    let up = board.attitude.inverse() * Vector3::z();
    (pose.orientation.inverse() * Vector3::z()).angle(&up)
}

/// Pitch and roll, degrees.
fn tilt(attitude: &Attitude, t_s: f64) -> Option<(f64, f64)> {
    attitude.down(t_s).as_ref().map(pitch_and_roll_deg)
}

fn frames_lost(ticks: &[BoardMotion]) -> u32 {
    ticks.last().unwrap().pose.frame_id - ticks[0].pose.frame_id
}

#[test]
fn a_bias_of_5_deg_s_is_learnt_at_rest_within_seconds() {
    for accel in [true, false] {
        let mut board = TestBoard {
            gyro_bias_deg_s: Vector3::new(5.0, -4.5, 5.0),
            accel,
            ..TestBoard::default()
        };
        board.rest(6.0);
        let (attitude, _) = run(&board);
        let state = attitude.state(board.t_s);
        assert!(state.at_rest);
        let error = bias_error(&state, &board);
        assert!(error < 0.15, "accel {accel}: {error}");
    }
}

#[test]
fn a_slow_steady_turn_is_motion_not_bias() {
    for (accel, deg_s) in [(true, 3.0), (false, 3.0), (true, 6.0)] {
        // From rest with a bias already learnt, with a sudden and with a gentle start, and from power-on.
        for start in ["sudden", "gentle", "power-on"] {
            let mut board = TestBoard {
                accel,
                ..TestBoard::default()
            };
            if start != "power-on" {
                board.rest(12.0);
            }
            if start == "gentle" {
                let last = f64::to_radians(deg_s);
                board.go(3.0, |_, t| -Vector3::z() * last * t / 3.0);
            }
            board.turn(-Vector3::z(), 60.0, deg_s);
            let (attitude, _) = run(&board);
            let state = attitude.state(board.t_s);
            assert!(!state.at_rest);
            let error = bias_error(&state, &board);
            // At power-on nothing has told the bias yet; it must only not become the turn's rate.
            let limit = if start == "power-on" { 0.6 } else { 0.2 };
            assert!(error < limit, "{accel} {deg_s} {start}: {error}");
        }
    }
}

#[test]
fn pose_and_tilt_follow_the_truth() {
    let (mut board, mut attitude) = (TestBoard::default(), new());
    board.rest(5.0);
    board.turn(Vector3::x(), 20.0, 30.0);
    board.turn(Vector3::y(), -15.0, 30.0);
    board.rest(8.0);
    play(&mut attitude, &mut board);
    let (pitch, roll) = tilt(&attitude, board.t_s).unwrap();
    assert!((roll - 20.7).abs() < 1.0, "{roll}");
    assert!((pitch + 14.1).abs() < 1.0, "{pitch}");
    board.turn_up(-200.0, 45.0);
    let pose = play(&mut attitude, &mut board);
    assert!(pose.vertical_known);
    assert!(tilt_error_rad(&pose, &board).to_degrees() < 0.7);
    // Carried on with the current rate, and not further than a gap.
    let later = attitude.pose_at(board.t_s + 0.1).unwrap();
    let moved = pose.orientation.angle_to(&later.orientation).to_degrees();
    assert!((moved - 4.5).abs() < 0.4, "{moved}");
    assert_eq!(attitude.pose_at(board.t_s + 0.6), None);
}

#[test]
fn tilt_by_an_unknown_bias_is_small_and_part_of_its_deviation() {
    // The gyro's own frame is the board's at power-on, which is not level.
    for start_deg in [
        Vector3::zeros(),
        Vector3::x() * 70.0,
        Vector3::x() * 180.0,
        Vector3::y() * -60.0,
    ] {
        let mut board = TestBoard {
            gyro_bias_deg_s: Vector3::new(4.5, -4.5, 4.5),
            ..TestBoard::default()
        };
        board.attitude *= UnitQuaternion::from_scaled_axis(start_deg.map(f64::to_radians));
        let (mut attitude, mut compared) = (new(), 0);
        for _ in 0..20 {
            // From power-on, without a rest that would tell the bias.
            board.turn_up(10.0, 45.0);
            let pose = play(&mut attitude, &mut board);
            if !pose.vertical_known {
                continue;
            }
            compared += 1;
            let off_rad = tilt_error_rad(&pose, &board);
            assert!(off_rad.to_degrees() < 3.5, "{start_deg} {off_rad}");
            let share = off_rad / (attitude.state(board.t_s).tilt_error.whole_sd_rad * 2f64.sqrt());
            assert!((0.65..1.3).contains(&share), "{start_deg} {share}");
        }
        assert!(compared > 10);
    }
}

#[test]
fn the_bias_tilts_the_frame_of_a_board_that_does_not_stay_upright() {
    let turned = |rate: fn(f64) -> Vector3<f64>| {
        let mut board = TestBoard::default();
        board.go(60.0, |_, t_s| rate(t_s));
        run(&board).0.state(board.t_s).tilt_error
    };
    let upright = turned(|_| Vector3::z() * 0.5);
    assert_eq!(upright.by_bias, 0.0);
    let tumbling = turned(|t_s| Vector3::new((0.9 * t_s).sin(), (1.3 * t_s).sin(), 0.5));
    assert_eq!(tumbling.by_bias, 1.0);
    // The accelerometer's part alone is left: a hundredth of g.
    assert!(
        (0.01..0.02).contains(&tumbling.sd_rad),
        "{}",
        tumbling.sd_rad
    );
}

#[test]
fn the_accelerometer_may_come_late_and_go() {
    let mut board = TestBoard {
        accel: false,
        ..TestBoard::default()
    };
    board.turn(Vector3::x(), 50.0, 25.0);
    let mut attitude = new();
    let without = play(&mut attitude, &mut board);
    assert!(!without.vertical_known);
    assert_eq!(tilt(&attitude, board.t_s), None);

    board.accel = true;
    board.rest(0.5);
    let early = play(&mut attitude, &mut board);
    assert!(!early.vertical_known);
    assert_ne!(early.frame_id, without.frame_id, "levelling turns it");
    assert!(
        tilt(&attitude, board.t_s).is_some(),
        "the accelerometer alone"
    );
    board.rest(2.0);
    let levelled = play(&mut attitude, &mut board);
    assert!(levelled.vertical_known);
    assert_eq!(levelled.frame_id, early.frame_id);
    assert!(tilt_error_rad(&levelled, &board) < 0.02);

    board.accel = false;
    board.turn(Vector3::x(), -50.0, 25.0);
    let gone = play(&mut attitude, &mut board);
    assert!(!gone.vertical_known);
    assert_eq!(tilt(&attitude, board.t_s), None);
    assert_eq!(gone.frame_id, levelled.frame_id);
    assert!(tilt_error_rad(&gone, &board) < 0.05);
}

#[test]
fn without_a_gyro_there_is_tilt_but_neither_pose_nor_tick() {
    let mut board = TestBoard {
        gyro: false,
        ..TestBoard::default()
    };
    board.turn(Vector3::x(), 30.0, 30.0);
    board.rest(1.0);
    let (attitude, ticks) = run(&board);
    assert!(ticks.is_empty());
    assert_eq!(attitude.pose_at(board.t_s), None);
    let (_, roll) = tilt(&attitude, board.t_s).unwrap();
    assert!((roll - 30.0).abs() < 1.0, "{roll}");
}

#[test]
fn a_short_drop_out_is_bridged_and_a_long_one_begins_a_new_stretch() {
    for (gap_s, gaps) in [(0.4, 0), (0.8, 1)] {
        let mut board = TestBoard::default();
        board.rest(3.0);
        board.gyro = false;
        board.turn(Vector3::z(), 30.0 * gap_s, 30.0);
        board.gyro = true;
        board.rest(3.0);
        let (attitude, ticks) = run(&board);
        assert_eq!(frames_lost(&ticks), gaps);
        let hops = ticks
            .windows(2)
            .filter(|pair| pair[1].t_s - pair[0].t_s > 1.5 * TICK_S)
            .count();
        assert_eq!(hops, gaps as usize);
        assert!(attitude.pose_at(board.t_s).unwrap().vertical_known);
    }
}

/// A hand swings the board about all axes.
fn swing(board: &mut TestBoard, seconds: f64) {
    let begun_s = board.t_s;
    board.go(seconds, |_, t_s| {
        let t_s = begun_s + t_s;
        Vector3::new(3.0 * (2.9 * t_s).sin(), 2.0 * (4.1 * t_s).sin(), 0.5)
    });
}

/// A swung board, and a line that is silent eight times for so long: the angle, RMS, that the pose is off by
/// after each silence; the deviation that is claimed for it; and how often the frame was lost.
fn swung(silent_s: f64) -> (f64, f64, u32) {
    let mut board = TestBoard::default();
    let mut attitude = new();
    let (mut off2, mut claimed2, mut lost) = (0.0, 0.0, 0);
    swing(&mut board, 5.0);
    for _ in 0..8 {
        let before = play(&mut attitude, &mut board);
        let (true_before, claimed_before) = (board.attitude, missed_rad2(&attitude, &board));
        swing(&mut board, silent_s);
        board.readings.clear();
        swing(&mut board, 0.05);
        let after = play(&mut attitude, &mut board);
        lost += after.frame_id - before.frame_id;
        let turned = before.orientation.inverse() * after.orientation;
        off2 += turned
            .angle_to(&(true_before.inverse() * board.attitude))
            .powi(2);
        claimed2 += 3.0 * (missed_rad2(&attitude, &board) - claimed_before);
        swing(&mut board, 1.3);
    }
    (f64::sqrt(off2 / 8.0), f64::sqrt(claimed2 / 8.0), lost)
}

fn missed_rad2(attitude: &Attitude, board: &TestBoard) -> f64 {
    attitude.motion_at(board.t_s).unwrap().missed_rad2
}

#[test]
fn what_the_gyro_misses_in_a_short_silence_is_claimed_and_in_a_longer_one_loses_the_frame() {
    let (_, claimed, lost) = swung(0.004);
    assert!(claimed < 1e-4 && lost == 0, "{claimed} {lost}");
    for silent_s in [0.15, 0.2, 0.25] {
        let (off, claimed, lost) = swung(silent_s);
        assert_eq!(lost, 0, "{silent_s}");
        assert!(
            (0.5..2.0).contains(&(claimed / off)),
            "{silent_s}: {off} {claimed}"
        );
    }
    assert_eq!(swung(0.45).2, 8);
}

/// A hand shakes the board by 2 m/s², to and fro in a bit more than two seconds.
#[test]
fn a_frame_that_is_levelled_anew_in_motion_admits_its_tilt() {
    let (mut off2, mut claimed2) = (0.0, 0.0);
    for phase in 0..8 {
        let mut board = TestBoard::default();
        let mut attitude = new();
        let mut shake = |board: &mut TestBoard, seconds: f64| {
            board.rest(seconds);
            for reading in &mut board.readings {
                let push = 2.0 * (2.8 * reading.t_s + f64::from(phase) * 0.785).sin();
                let felt = reading.specific_force_m_s2.as_mut().unwrap();
                *felt += Vector3::new(push, 0.7 * push, 0.0);
            }
            play(&mut attitude, board)
        };
        shake(&mut board, 30.0);
        board.t_s += 0.6;
        let pose = shake(&mut board, 1.2);
        assert!(pose.vertical_known);
        off2 += tilt_error_rad(&pose, &board).powi(2);
        claimed2 += 2.0 * attitude.state(board.t_s).tilt_error.whole_sd_rad.powi(2);
    }
    let nerr = f64::sqrt(off2 / claimed2);
    assert!((0.4..1.3).contains(&nerr), "{nerr}");
}

/// A recording that goes on as another one of the same board.
#[test]
fn a_board_that_lies_otherwise_at_once_begins_a_new_stretch() {
    let mut board = TestBoard::default();
    swing(&mut board, 5.0);
    let before = frames_lost(&run(&board).1);
    board.attitude *= UnitQuaternion::from_euler_angles(1.0, 0.5, 2.0);
    swing(&mut board, 3.0);
    let (attitude, ticks) = run(&board);
    assert_eq!(frames_lost(&ticks) - before, 1);
    let pose = attitude.pose_at(board.t_s).unwrap();
    assert!(tilt_error_rad(&pose, &board) < 0.03);
}

/// A board rests and is swung, goes on as `follows` says, and is swung again. How well its gyro's bias is known before and after that,
/// degrees per second, RMS on an axis.
fn bias_known_deg_s(follows: impl Fn(&mut TestBoard)) -> (f64, f64) {
    let (mut board, mut attitude) = (TestBoard::default(), new());
    let mut known = |board: &mut TestBoard| {
        play(&mut attitude, board);
        let covariance = attitude.state(board.t_s).gyro_bias.covariance;
        (covariance.trace() / 3.0).sqrt().to_degrees()
    };
    board.rest(20.0);
    swing(&mut board, 5.0);
    let before = known(&mut board);
    follows(&mut board);
    swing(&mut board, 0.6);
    (before, known(&mut board))
}

#[test]
fn after_a_silence_or_a_seam_the_gyros_bias_may_be_another() {
    let silent = |silent_s: f64| {
        bias_known_deg_s(|board| {
            swing(board, silent_s);
            assert!(!board.readings.is_empty());
            board.readings.clear();
        })
    };
    let (before, after) = silent(0.4);
    assert!(after < 0.15 && after - before < 0.02, "{before} {after}");
    let (before, after) = silent(0.8);
    assert!(
        before < 0.15 && (0.2..0.4).contains(&after),
        "{before} {after}"
    );
    let (before, after) = bias_known_deg_s(|board| {
        board.attitude *= UnitQuaternion::from_euler_angles(1.0, 0.5, 2.0);
    });
    assert!(
        before < 0.15 && (0.6..1.1).contains(&after),
        "{before} {after}"
    );
}

#[test]
fn a_magnet_that_snaps_onto_the_board_does_not() {
    let mut board = TestBoard::default();
    swing(&mut board, 5.0);
    let knocked = board.readings.len();
    swing(&mut board, 3.0);
    let readings = board.readings.iter_mut().skip(knocked);
    for (count, reading) in readings.enumerate() {
        reading.field_mgauss = reading
            .field_mgauss
            .map(|field| field.map(|b| Some(b? + 300.0)));
        if count < 3 {
            let felt = reading.specific_force_m_s2.as_mut().unwrap();
            *felt += Vector3::new(20.0, -15.0, 10.0);
        }
    }
    let (mut attitude, mut may_have_jumped) = (new(), 0);
    for reading in &board.readings {
        attitude.take(reading, |_| {});
        may_have_jumped += u32::from(attitude.may_have_jumped());
    }
    assert_eq!(frames_lost(&run(&board).1), 0);
    assert!((90..=110).contains(&may_have_jumped), "{may_have_jumped}");
}

/// As two recordings of a board at rest, joined.
#[test]
fn a_bias_that_jumps_at_rest_is_learnt_anew() {
    let mut board = TestBoard::default();
    board.rest(60.0);
    board.gyro_bias_deg_s.z += 0.6;
    board.rest(8.0);
    let (attitude, ticks) = run(&board);
    let error = bias_error(&attitude.state(board.t_s), &board);
    let missed_rad2 = ticks.last().unwrap().missed_rad2;
    assert!(error < 0.15, "{error}");
    let missed_deg = missed_rad2.sqrt().to_degrees();
    assert!((1.5..3.0).contains(&missed_deg), "{missed_deg}");
}

#[test]
fn the_motion_before_a_gap_is_not_carried_over_it() {
    let (mut board, mut attitude) = (TestBoard::default(), new());
    board.turn(Vector3::z(), 60.0, 30.0);
    play(&mut attitude, &mut board);
    assert!(attitude.motion_at(board.t_s - 0.05).is_some());
    board.gyro = false;
    board.turn(Vector3::z(), 24.0, 30.0);
    board.gyro = true;
    // One reading, in the first tick after the gap.
    board.turn(Vector3::z(), 0.15, 30.0);
    play(&mut attitude, &mut board);
    assert!(attitude.motion_at(board.t_s).is_none());
}

#[test]
fn clipped_rates_begin_a_new_stretch_when_they_end() {
    let mut board = TestBoard::default();
    board.rest(2.0);
    board.turn(Vector3::z(), 300.0, 300.0);
    board.rest(1.0);
    for reading in &mut board.readings {
        let limit = 250f64.to_radians();
        reading.rate_rad_s = reading
            .rate_rad_s
            .map(|r| r.map(|v| v.clamp(-limit, limit)));
    }
    assert_eq!(frames_lost(&run(&board).1), 1);
    let settings = Settings {
        gyro_range_deg_s: Some(500.0),
        ..Settings::default()
    };
    assert_eq!(frames_lost(&run_with(&board, &settings).1), 0);
}
