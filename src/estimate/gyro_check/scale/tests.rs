//! A board turns in the earth's field, with gyros that are right and wrong.

use std::collections::VecDeque;

use nalgebra::Rotation3;

use super::*;
use crate::estimate::prior::Prior;

/// A board that turns in the earth's field, and the check of its gyro.
struct TurnedBoard {
    regression: GyroScale,
    filter: Filter,
    /// The attitudes of the newest samples, the newest first. The magnetometer shows the last.
    attitudes: VecDeque<Rotation3<f64>>,
    iron_mgauss: Vector3<f64>,
    soft: Matrix3<f64>,
    /// The scale error that gravity has shown, and that is taken out of the rates.
    taken: f64,
    step: u16,
}

impl TurnedBoard {
    /// A board with this soft iron, and a filter that has learnt it and is sure of it, or has learnt another and is not. The magnetometer
    /// does not lag, and the filter knows that.
    fn new(soft: Matrix3<f64>, learnt: Matrix3<f64>) -> Self {
        let mut board = Self::of_unknown_lag(soft, learnt);
        board.filter = board.filter.without_lag();
        board
    }

    /// The same, and the filter does not know the lag.
    fn of_unknown_lag(soft: Matrix3<f64>, learnt: Matrix3<f64>) -> Self {
        let unknown = Prior::unknown();
        let doubt = if soft == learnt { 0.0 } else { 1.0 };
        let filter = Filter::new(&Prior {
            matrix: learnt,
            covariance: unknown.covariance * doubt,
            ..unknown
        });
        Self {
            regression: GyroScale::default(),
            filter: filter.unsure_of_gyro(),
            attitudes: [Rotation3::identity()].into(),
            iron_mgauss: Vector3::new(900.0, -600.0, 900.0),
            soft,
            taken: 0.0,
            step: 0,
        }
    }

    /// Turns on for so many steps of 20 ms at this rate, rad/s at a time in seconds, with a gyro that reads so many times what it
    /// should.
    fn turn(&mut self, steps: u16, reads: f64, rate_rad_s: impl Fn(f64) -> Vector3<f64>) {
        let earth = Vector3::new(260.0, 0.0, -590.0);
        let dt = 0.02;
        for _ in 0..steps {
            let rate = rate_rad_s(f64::from(self.step) * dt);
            let newest = self.attitudes[0] * Rotation3::new(rate * dt);
            self.attitudes.push_front(newest);
            self.attitudes.pop_back();
            let shown = self.attitudes.back().unwrap();
            // Two counts of a chip, in turn on each axis.
            let noise = |axis, _| 2.0 - 4.0 * f64::from((self.step + axis as u16) % 2);
            let field =
                self.soft * (shown.inverse() * earth) + self.iron_mgauss + Vector3::from_fn(noise);
            let read = rate * (reads / (1.0 + self.taken));
            let mut input = Input {
                turned_rad: read * dt,
                period_s: dt,
                ..Input::turning_at(Matrix3::identity(), read, field)
            };
            input.board.gyro_matrix.fill_diagonal(self.taken);
            self.regression.take(&input, &self.filter);
            self.step += 1;
        }
    }
}

/// A board without soft iron.
fn judged(reads: f64, rate_rad_s: impl Fn(f64) -> Vector3<f64>) -> (GyroVerdict, f64) {
    let none = Matrix3::identity();
    judged_with(reads, none, none, rate_rad_s)
}

/// A board that has turned for 20 s.
fn judged_with(
    reads: f64,
    soft: Matrix3<f64>,
    learnt: Matrix3<f64>,
    rate_rad_s: impl Fn(f64) -> Vector3<f64>,
) -> (GyroVerdict, f64) {
    let mut board = TurnedBoard::new(soft, learnt);
    board.turn(1000, reads, rate_rad_s);
    let scale = board
        .regression
        .regress()
        .filter(FoundScale::is_enough)
        .map_or(f64::NAN, |found| found.scale);
    (board.regression.verdict(), scale)
}

fn tumbling(t_s: f64) -> Vector3<f64> {
    Vector3::new((0.7 * t_s).sin(), (0.45 * t_s).cos(), 1.0)
}

#[test]
fn a_wrong_scale_shows_beside_any_iron() {
    for (reads, verdict) in [
        (1.0, GyroVerdict::Right),
        (1.03, GyroVerdict::Right),
        (1.2, GyroVerdict::Wrong),
        (0.8, GyroVerdict::Wrong),
        (2.0, GyroVerdict::Wrong),
        (0.5, GyroVerdict::Wrong),
        (0.25, GyroVerdict::Wrong),
        (4.0, GyroVerdict::Wrong),
        (-1.0, GyroVerdict::Opposed),
    ] {
        // Fast enough beside a bias that is not known.
        let speed = f64::max(2.0 / f64::abs(reads), 3.0);
        for motion in [tumbling, |_| Vector3::z()] {
            let (found, scale) = judged(reads, |t_s| motion(t_s) * speed);
            assert_eq!(found, verdict, "{reads}: {scale}");
            assert!((scale * reads - 1.0).abs() < 0.03, "{reads}: {scale}");
        }
    }
}

/// Gravity shows a part of a wrong scale, and has not shown it at first.
#[test]
fn what_is_taken_out_of_the_rates_does_not_hide_a_wrong_scale() {
    let none = Matrix3::identity();
    let mut board = TurnedBoard::new(none, none);
    for taken in [0.0, 0.03, 0.05] {
        board.taken = taken;
        board.turn(300, 1.1, |t_s| tumbling(t_s) * 3.0);
    }
    let scale = board.regression.regress().unwrap().scale;
    assert!((scale * 1.1 - 1.0).abs() < 0.03, "{scale}");
    assert_eq!(board.regression.verdict(), GyroVerdict::Wrong);
}

/// Probably more than a right gyro's, but not certainly.
#[test]
fn a_scale_near_the_limit_is_suspected() {
    for (reads, suspected) in [(1.0, 0.0), (1.03, 0.0), (1.075, 0.07)] {
        let none = Matrix3::identity();
        let mut board = TurnedBoard::new(none, none);
        board.turn(1000, reads, |t_s| tumbling(t_s) * 3.0);
        let found = board.regression.suspected(true);
        assert!((found - suspected).abs() < 0.01, "{reads}: {found}");
    }
}

#[test]
fn the_first_arc_of_a_gyro_that_reads_half_is_suspected() {
    let level = |_: f64| Vector3::z() * 3.0;
    let suspected = |reads, was_right| {
        let none = Matrix3::identity();
        let mut board = TurnedBoard::new(none, none);
        // 138°.
        board.turn(40, reads, level);
        board.regression.suspected(was_right)
    };
    assert_eq!(suspected(1.0, false), 0.0);
    let found = suspected(0.5, false);
    assert!((found - 1.0).abs() < 0.2, "{found}");
    assert_eq!(suspected(0.5, true), 0.0);
}

/// About a horizontal axis, 75° to either side.
fn swinging(t_s: f64) -> Vector3<f64> {
    Vector3::y() * (1.3 * 3.0 * (3.0 * t_s).cos())
}

const SOFT: Matrix3<f64> = Matrix3::new(1.08, 0.04, 0.0, 0.04, 0.96, -0.03, 0.0, -0.03, 0.96);

#[test]
fn soft_iron_does_not_look_like_a_wrong_scale() {
    for motion in [tumbling, swinging] {
        for (reads, verdict) in [(1.0, GyroVerdict::Right), (1.25, GyroVerdict::Wrong)] {
            let (found, scale) = judged_with(reads, SOFT, SOFT, motion);
            assert_eq!(found, verdict, "{scale}");
            assert!((scale * reads - 1.0).abs() < 0.01, "{scale}");
        }
    }
}

#[test]
fn a_wrong_scale_shows_whatever_soft_iron_was_learnt() {
    let none = Matrix3::identity();
    for (soft, learnt) in [(SOFT, none), (none, SOFT)] {
        for reads in [0.8, 1.25] {
            let (found, scale) = judged_with(reads, soft, learnt, tumbling);
            assert_eq!(found, GyroVerdict::Wrong, "{reads}: {scale}");
        }
        let (found, scale) = judged_with(1.0, soft, learnt, tumbling);
        assert_ne!(found, GyroVerdict::Wrong, "{scale}");
    }
}

/// The Z axis of an HMC5883L reads a tenth less than the others. A roll of 86° to either side turns the field toward Z and away.
#[test]
fn an_axis_of_another_scale_does_not_look_like_a_wrong_scale_of_the_gyro_over_an_arc() {
    let chip = Matrix3::from_diagonal(&Vector3::new(1.0, 1.05, 0.9));
    let roll = |t_s: f64| Vector3::x() * (1.5 * 3.0 * (3.0 * t_s).cos());
    let (found, scale) = judged_with(1.0, chip, Matrix3::identity(), roll);
    assert!(scale < 0.9, "{scale}");
    assert_ne!(found, GyroVerdict::Wrong, "{scale}");
}

#[test]
fn swinging_to_and_fro_does_not_tell_a_scale_from_iron() {
    // 25° to either side.
    let swings = |t_s: f64| Vector3::z() * (0.44 * 4.0 * (4.0 * t_s).cos());
    assert_eq!(judged(0.5, swings).0, GyroVerdict::Unknown);
}

#[test]
fn a_slow_turn_does_not_tell_a_scale_from_a_bias_that_is_not_known() {
    let slow = |_| Vector3::z() * 0.5;
    assert_eq!(judged(0.5, slow).0, GyroVerdict::Unknown);
}

#[test]
fn a_scale_of_half_shows_though_the_bias_is_not_known_well() {
    // To 2 degrees a second on each axis, and the gyro reads 30.
    let found = judged(0.5, |t_s| tumbling(t_s) * 0.9);
    assert_eq!(found.0, GyroVerdict::Wrong, "{}", found.1);
    let found = judged(1.0, |t_s| tumbling(t_s) * 0.45);
    assert_eq!(found.0, GyroVerdict::Unknown, "{}", found.1);
}

#[test]
fn iron_that_comes_in_mid_turn_is_no_wrong_scale() {
    let none = Matrix3::identity();
    let mut board = TurnedBoard::new(none, none);
    let level = |_| Vector3::z() * 2.0;
    board.turn(80, 1.0, level);
    board.iron_mgauss.x -= 150.0;
    for _ in 0..160 {
        board.turn(1, 1.0, level);
        assert_ne!(board.regression.verdict(), GyroVerdict::Wrong);
    }
    assert_eq!(board.regression.verdict(), GyroVerdict::Right);
}

#[test]
fn a_lag_that_is_not_known_does_not_make_a_shaken_gyro_look_wrong() {
    // 30° to either side about each axis, three times a second, while it tumbles, and the magnetometer shows it 60 ms late.
    let shaken = |t_s: f64| {
        let phase = 19.0 * t_s;
        let rates = [phase, 0.93 * phase, 1.08 * phase].map(|phase| 10.0 * phase.cos());
        Vector3::from(rates) + tumbling(t_s)
    };
    let judged = |known: bool| {
        let none = Matrix3::identity();
        let mut board = if known {
            TurnedBoard::new(none, none)
        } else {
            TurnedBoard::of_unknown_lag(none, none)
        };
        board.attitudes = [Rotation3::identity(); 4].into();
        board.turn(1000, 1.0, shaken);
        board.regression.verdict()
    };
    assert_eq!(judged(false), GyroVerdict::Unknown);
    assert_eq!(judged(true), GyroVerdict::Opposed);
}
