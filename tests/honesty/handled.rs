//! Boards in a hand.

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Matrix3, Rotation3, Vector3};

use crate::chips::{Board, Draw, GyroFault};
use crate::drive::{Scene, run};
use crate::motion::{Hand, Part, length_s};
use crate::random::Rng;
use crate::score::{From, Score};
use crate::world::World;

/// Chips as they are found: iron of up to three times the field, axes apart, an untrimmed gyro.
const ROUGH: Draw = Draw {
    hard: 3.0,
    soft: 0.15,
    apart_deg: 5.0,
    bias_deg_s: 5.0,
    room: 200.0,
};
/// Chips of one board, with some iron near.
pub const FAIR: Draw = Draw {
    hard: 0.5,
    soft: 0.05,
    apart_deg: 1.0,
    bias_deg_s: 2.0,
    room: 500.0,
};

/// A hand in a furnished room: the field differs by 0.5 to 1.5 % over half a metre.
pub fn in_room(rng: &mut Rng, draw: &Draw, parts: Vec<Part>, length_s: f64) -> Scene {
    let mut world = World::draw(rng);
    let share = rng.uniform(0.005, 0.015);
    world.furnish(rng, share);
    let board = Board::draw(rng, world.strength(), draw);
    let hand = Hand::new(parts, rng);
    Scene::new(world, board, hand, length_s)
}

/// What shows everything about a board: level turns, turns about other axes, free motion. Then it is at rest.
pub fn teaching(rng: &mut Rng) -> Vec<Part> {
    let turn = |rng: &mut Rng| Part::Turn {
        deg: rng.sign() * rng.uniform(370.0, 420.0),
        s: rng.uniform(12.0, 18.0),
        sway_deg: 3.0,
        radius: 0.1,
    };
    let roll = |rng: &mut Rng, axis| Part::Roll {
        axis,
        deg: rng.sign() * rng.uniform(370.0, 400.0),
        s: rng.uniform(10.0, 15.0),
    };
    vec![
        Part::Rest(4.0),
        turn(rng),
        roll(rng, Vector3::y()),
        Part::Level(2.0),
        roll(rng, Vector3::x()),
        free(rng, 20.0),
        Part::Level(3.0),
    ]
}

/// Free motion of usual liveliness.
pub fn free(rng: &mut Rng, s: f64) -> Part {
    Part::Free {
        s,
        rate: rng.uniform(0.5, 1.2),
        accel: rng.uniform(0.5, 2.0),
    }
}

/// Perfect chips in an even field, and the daemon is given their calibration: what error is left is the simulation's.
pub fn perfect(rng: &mut Rng, score: &mut Score) {
    score.given_truth = true;
    score.errors_from = From::Time(10.0);
    let world = World::draw(rng);
    let board = Board::perfect();
    let mut parts = teaching(rng);
    // Accelerations that hardly tilt anything.
    parts.push(Part::Free {
        s: 60.0,
        rate: 1.0,
        accel: 0.02,
    });
    let hand = Hand::new(parts, rng);
    run(Scene::new(world, board, hand, 120.0), rng, score);
}

/// How long a board tumbles unless it warms up, seconds.
const TUMBLES_S: f64 = 90.0;

/// Any motion at once.
pub fn tumbling(rng: &mut Rng, score: &mut Score) {
    let scene = tumble(rng, score, TUMBLES_S);
    run(scene, rng, score);
}

/// The same with an accelerometer as delivered.
pub fn untrimmed(rng: &mut Rng, score: &mut Score) {
    let mut scene = tumble(rng, score, TUMBLES_S);
    scene.board.untrim(rng);
    run(scene, rng, score);
}

/// Tumbling, read by a host that polls 13 to 60 times a second, over a line that loses some readings.
pub fn in_bursts(rng: &mut Rng, score: &mut Score) {
    let mut scene = tumble(rng, score, TUMBLES_S);
    scene.board.polls_every_s = rng.uniform(0.016, 0.075);
    // As in the recorded logs: 15 bytes at 115,200 baud.
    scene.board.apart_s = (0.0012, 0.0016);
    scene.board.lost = rng.uniform(0.0, 0.02);
    run(scene, rng, score);
}

/// Free motion for so many seconds.
fn tumble(rng: &mut Rng, score: &mut Score, length_s: f64) -> Scene {
    score.errors_from = From::Time(30.0);
    score.learnt_by_s = 30.0;
    let parts = vec![Part::Free {
        s: length_s + 5.0,
        rate: rng.uniform(0.6, 2.0),
        accel: rng.uniform(0.5, 3.0),
    }];
    in_room(rng, &ROUGH, parts, length_s)
}

/// A board that only ever turns about one axis of its own, which is level within 10°: along that axis field and iron look the same.
pub fn one_axis(rng: &mut Rng, score: &mut Score) {
    let axis = if rng.sign() > 0.0 {
        Vector3::x()
    } else {
        Vector3::y()
    };
    let leans = Part::Roll {
        axis: axis.yxz(),
        deg: rng.uniform(-10.0, 10.0),
        s: 2.0,
    };
    let turns = rng.sign() * rng.uniform(8.0, 20.0);
    let turns = Part::Roll {
        axis,
        deg: 360.0 * turns,
        s: 60.0,
    };
    let scene = in_room(
        rng,
        &FAIR,
        vec![leans, Part::Rest(3.0), turns, Part::Level(5.0)],
        70.0,
    );
    run(scene, rng, score);
}

/// Tumbling with what a model says of the place's field.
pub fn place_known(rng: &mut Rng, score: &mut Score) {
    score.place_off_deg.get_or_insert(0.0);
    tumbling(rng, score);
}

/// The same with a position that is wrong: a dip that is 30° off.
pub fn place_wrong(rng: &mut Rng, score: &mut Score) {
    score.place_off_deg = Some(30.0);
    tumbling(rng, score);
}

/// Moved fast, with accelerations of 1 g, 120 s.
pub fn fast_hand(rng: &mut Rng, score: &mut Score) {
    let rate = rng.uniform(1.0, 2.0);
    // 9.8 m/s² altogether.
    let scene = moved_fast(rng, score, rate, 5.7);
    run(scene, rng, score);
}

/// The same over a line that is silent eight times, for 0.1 to 2 s.
pub fn with_silences(rng: &mut Rng, score: &mut Score) {
    let rate = rng.uniform(1.0, 2.0);
    let accel = rng.uniform(0.5, 5.7);
    let silences: Vec<(f64, f64)> = (0..8)
        .map(|_| (rng.uniform(10.0, 120.0), rng.log_uniform(0.1, 2.0)))
        .collect();
    let scene = moved_fast(rng, score, rate, accel).with(move |now, _, board, _| {
        let silent = (silences.iter()).any(|(from_s, s)| (0.0..*s).contains(&(now.t_s - from_s)));
        board.silence(silent);
    });
    run(scene, rng, score);
}

fn moved_fast(rng: &mut Rng, score: &mut Score, rate: f64, accel: f64) -> Scene {
    score.starts_s = 3.0;
    score.learnt_by_s = 40.0;
    let s = 120.0;
    let parts = vec![Part::Rest(3.0), Part::Free { s, rate, accel }];
    in_room(rng, &FAIR, parts, s)
}

/// Tumbling for five minutes, while the board warms up.
pub fn warming_hand(rng: &mut Rng, score: &mut Score) {
    let mut scene = tumble(rng, score, 300.0);
    scene.board.warm_up(rng);
    run(scene, rng, score);
}

/// Ten minutes at rest after a good calibration, while the board warms up.
pub fn warming_at_rest(rng: &mut Rng, score: &mut Score) {
    let mut parts = teaching(rng);
    let rests_s = length_s(&parts);
    parts.push(Part::Rest(600.0));
    parts.push(free(rng, 30.0));
    score.starts_s = 4.0;
    score.learnt_by_s = 60.0;
    score.errors_from = From::Time(rests_s);
    let length = length_s(&parts);
    let mut scene = in_room(rng, &FAIR, parts, length);
    scene.board.warm_up(rng);
    run(scene, rng, score);
}

/// A chip that is wrong from the beginning.
fn wrong_chip(rng: &mut Rng, score: &mut Score, wrong: fn(&mut Rng, &mut Board)) {
    score.starts_s = 4.0;
    let mut parts = teaching(rng);
    parts.push(free(rng, 60.0));
    let mut scene = in_room(rng, &FAIR, parts, 140.0);
    wrong(rng, &mut scene.board);
    run(scene, rng, score);
}

/// It reads 0.5 to 2 times what it should.
pub fn misread_gyro(rng: &mut Rng, score: &mut Score) {
    wrong_chip(rng, score, |rng, board| {
        board.gyro.fault = GyroFault::Scaled(misread(rng));
    });
}

/// All of its signs are wrong.
pub fn negative_gyro(rng: &mut Rng, score: &mut Score) {
    wrong_chip(rng, score, |_, board| {
        board.gyro.fault = GyroFault::Scaled(-1.0)
    });
}

/// Two of its signs are wrong: it is mounted another way round.
pub fn mismounted_gyro(rng: &mut Rng, score: &mut Score) {
    wrong_chip(rng, score, |rng, board| {
        let axis = rng.uniform(0.0, 3.0) as usize;
        let mut signs = -Vector3::repeat(1.0);
        signs[axis] = 1.0;
        board.gyro.matrix = Matrix3::from_diagonal(&signs) * board.gyro.matrix;
    });
}

/// Its axes are in another order.
pub fn swapped_gyro(rng: &mut Rng, score: &mut Score) {
    wrong_chip(rng, score, |rng, board| {
        let by = if rng.chance(0.5) { 1 } else { 2 };
        let order = Matrix3::from_fn(|row, column| f64::from(u8::from((row + by) % 3 == column)));
        board.gyro.matrix = order * board.gyro.matrix;
    });
}

/// One axis is turned: two axes change places, one with another sign.
pub fn turned_gyro(rng: &mut Rng, score: &mut Score) {
    wrong_chip(rng, score, |rng, board| {
        board.gyro.matrix = quarter_turn(rng, 3.0) * board.gyro.matrix;
    });
}

/// The same with the magnetometer, but not about Z: level turns cannot show that.
pub fn turned_magnetometer(rng: &mut Rng, score: &mut Score) {
    wrong_chip(rng, score, |rng, board| {
        board.mag.matrix = quarter_turn(rng, 2.0) * board.mag.matrix;
    });
}

/// And with the accelerometer.
pub fn turned_accelerometer(rng: &mut Rng, score: &mut Score) {
    wrong_chip(rng, score, |rng, board| {
        board.force.matrix = quarter_turn(rng, 3.0) * board.force.matrix;
    });
}

/// A quarter of a turn about one of the first so many axes.
fn quarter_turn(rng: &mut Rng, axes: f64) -> Matrix3<f64> {
    let axis = rng.uniform(0.0, axes) as usize;
    Rotation3::new(Vector3::ith(axis, FRAC_PI_2)).into_inner()
}

/// How many times too much it reads: 0.5 to 2, but not nearly 1.
pub fn misread(rng: &mut Rng) -> f64 {
    let scale = rng.log_uniform(1.1, 2.0);
    if rng.chance(0.5) { 1.0 / scale } else { scale }
}
