//! Something changes after all has been learnt: magnets, iron, the gyro.

use headingd::condition::Condition;
use nalgebra::Vector3;

use crate::chips::{Board, Draw, GyroFault};
use crate::daemon::Shown;
use crate::drive::{Scene, run};
use crate::handled::{FAIR, free, in_room, misread, teaching};
use crate::motion::{Part, length_s};
use crate::random::Rng;
use crate::score::{From, Score};
use crate::world::Dipole;

fn disturbed(shown: &Shown) -> bool {
    shown.condition == Condition::Disturbed
}

/// A board that has been taught goes through `before` and `after`, and something changes so many seconds after `after` has begun.
/// The scene, and when it changes, seconds.
fn taught(
    rng: &mut Rng,
    score: &mut Score,
    before: &[Part],
    after: &[Part],
    later_s: f64,
) -> (Scene, f64) {
    let mut parts = teaching(rng);
    parts.extend(before);
    let change_s = length_s(&parts) + later_s;
    parts.extend(after);
    score.starts_s = 4.0;
    score.learnt_by_s = 60.0;
    score.faults = vec![(change_s, f64::INFINITY)];
    let length = length_s(&parts);
    (in_room(rng, &FAIR, parts, length), change_s)
}

/// Free motion at this rate.
fn moving(s: f64, rate: f64) -> Part {
    Part::Free {
        s,
        rate,
        accel: 1.0,
    }
}

/// A magnet of 30 to 300 mG.
fn magnet(rng: &mut Rng) -> Vector3<f64> {
    rng.direction() * rng.log_uniform(30.0, 300.0)
}

/// Attached while the board rests; then it is moved.
pub fn magnet_at_rest(rng: &mut Rng, score: &mut Score) {
    let after = [Part::Rest(20.0), free(rng, 40.0)];
    let (scene, change_s) = taught(rng, score, &[Part::Rest(15.0)], &after, 0.0);
    score.watch(change_s, disturbed);
    let field = magnet(rng);
    let scene = scene.with(move |now, _, board, _| {
        board.mag.attached = field * ((now.t_s - change_s) / 0.5).clamp(0.0, 1.0);
    });
    run(scene, rng, score);
}

/// A magnet of 300 to 2500 mG, as a small one has at 1 to 2 cm, is attached while the board moves, and taken off again. Headings are to be
/// good 15 s after either.
pub fn large_magnet(rng: &mut Rng, score: &mut Score) {
    const ON_S: f64 = 40.0;
    const LEARNT_S: f64 = 15.0;
    let rate = rng.uniform(0.5, 1.2);
    let mut parts = teaching(rng);
    let change_s = length_s(&parts) + 10.0;
    parts.push(moving(10.0 + 2.0 * ON_S, rate));
    let draw = Draw {
        room: 3000.0,
        ..FAIR
    };
    let length = length_s(&parts);
    let scene = in_room(rng, &draw, parts, length);
    score.starts_s = 4.0;
    score.learnt_by_s = change_s;
    score.excluded = [0.0, ON_S]
        .map(|after_s| (change_s + after_s, change_s + after_s + LEARNT_S))
        .into();
    score.watch(change_s, disturbed);
    let field = rng.direction() * rng.log_uniform(300.0, 2500.0);
    let scene = scene.with(move |now, _, board, _| {
        let on = (now.t_s - change_s) / 0.3;
        let off = (now.t_s - change_s - ON_S) / 0.3;
        board.mag.attached = field * (on.clamp(0.0, 1.0) - off.clamp(0.0, 1.0));
    });
    run(scene, rng, score);
}

/// Attached while the board moves.
pub fn magnet_in_motion(rng: &mut Rng, score: &mut Score) {
    let moving = moving(70.0, rng.uniform(0.5, 1.2));
    let (scene, change_s) = taught(rng, score, &[], &[moving], 10.0);
    score.watch(change_s, disturbed);
    // By then it is learnt.
    score.errors_from = From::Time(change_s + 15.0);
    let field = magnet(rng);
    let scene = scene.with(move |now, _, board, _| {
        board.mag.attached = field * ((now.t_s - change_s) / 0.3).clamp(0.0, 1.0);
    });
    run(scene, rng, score);
}

/// The gyro of a moving board repeats its last reading for 0.2 to 20 s, and then measures again.
pub fn hung_gyro(rng: &mut Rng, score: &mut Score) {
    let moving = moving(90.0, rng.uniform(0.3, 1.2));
    let (scene, change_s) = taught(rng, score, &[], &[moving], 10.0);
    let resumes_s = change_s + rng.log_uniform(0.2, 20.0);
    score.errors_from = From::Time(change_s);
    let scene = scene.with(move |now, _, board, _| {
        let hangs = (change_s..resumes_s).contains(&now.t_s);
        board.gyro.fault = if hangs {
            GyroFault::Hangs
        } else {
            GyroFault::None
        };
    });
    run(scene, rng, score);
}

/// A moving board is silent for 0.6 to 3 s. Meanwhile its iron changes by 30 to 300 mG, and its gyro's bias by 0.3°/s, as in a repair.
pub fn while_silent(rng: &mut Rng, score: &mut Score) {
    let moving = moving(70.0, rng.uniform(0.5, 1.2));
    let (scene, change_s) = taught(rng, score, &[], &[moving], 10.0);
    let resumes_s = change_s + rng.log_uniform(0.6, 3.0);
    score.excluded = vec![(change_s, resumes_s + 15.0)];
    let field = magnet(rng);
    let mut bias_jump = rng.vector(0.3f64.to_radians());
    let scene = scene.with(move |now, _, board, _| {
        let silent = (change_s..resumes_s).contains(&now.t_s);
        board.silence(silent);
        if silent {
            board.mag.attached = field;
            board.gyro.bias += std::mem::take(&mut bias_jump);
        }
    });
    run(scene, rng, score);
}

/// A piece of iron is carried past a board at rest and away again, twice. Headings are to be good 10 s after it has gone.
pub fn moved_iron(rng: &mut Rng, score: &mut Score) {
    const EVERY_S: f64 = 45.0;
    let after = [Part::Rest(2.0 * EVERY_S), free(rng, 20.0)];
    let (scene, change_s) = taught(rng, score, &[Part::Rest(10.0)], &after, 0.0);
    let begun_s = change_s + 2.0;
    score.watch(begun_s, disturbed);
    score.faults = [0.0, EVERY_S]
        .map(|at_s| (change_s + at_s, change_s + at_s + 28.0))
        .into();
    // 40 to 400 mG at its nearest, 0.3 m away: a tool, a loudspeaker.
    let moment = rng.direction() * rng.log_uniform(40.0, 400.0) * 0.027;
    let side = rng.direction();
    let across = side.cross(&rng.direction()).normalize();
    let scene = scene.with(move |now, world, _, _| {
        // There by 2 s after the change, around for 16 s, gone; and again.
        let t = (now.t_s - change_s) % EVERY_S;
        if now.t_s < change_s || now.t_s > change_s + 2.0 * EVERY_S || t > 18.0 {
            world.dipoles.truncate(ROOM);
            return;
        }
        let far = 1.5 * (1.0 - (t / 2.0).min(1.0)) + 1.5 * ((t - 16.0) / 2.0).max(0.0);
        let sweep = across * (0.1 * (t - 2.0).clamp(0.0, 14.0).sin());
        let iron = Dipole {
            position: now.pose.position + side * (0.3 + far) + sweep,
            velocity: Vector3::zeros(),
            moment,
        };
        world.dipoles.truncate(ROOM);
        world.dipoles.push(iron);
    });
    run(scene, rng, score);
}

/// The dipoles of a furnished room come first.
const ROOM: usize = 6;

/// A lesson, then free motion throughout, in which `fault` happens after 10 s.
pub fn in_motion(
    rng: &mut Rng,
    score: &mut Score,
    s: f64,
    rate: f64,
    wanted: fn(&Shown) -> bool,
    mut fault: impl FnMut(&mut Board) + 'static,
) {
    let (scene, change_s) = taught(rng, score, &[], &[moving(s + 10.0, rate)], 10.0);
    score.watch(change_s, wanted);
    score.good_from_s = change_s;
    score.errors_from = From::Time(change_s);
    let scene = scene.with(move |now, _, board, _| {
        if now.t_s >= change_s {
            fault(board);
        }
    });
    run(scene, rng, score);
}

pub fn flipped_gyro(rng: &mut Rng, score: &mut Score) {
    let wanted = |shown: &Shown| shown.reason == "gyro_sign";
    let rate = rng.uniform(0.5, 1.2);
    in_motion(rng, score, 60.0, rate, wanted, |board| {
        board.gyro.fault = GyroFault::Scaled(-1.0);
    });
}

/// A gyro that is set up for another range.
pub fn scaled_gyro(rng: &mut Rng, score: &mut Score) {
    let wanted = |shown: &Shown| shown.reason == "gyro_scale";
    let rate = rng.uniform(0.5, 1.2);
    let scale = misread(rng);
    in_motion(rng, score, 60.0, rate, wanted, move |board| {
        board.gyro.fault = GyroFault::Scaled(scale);
    });
}

/// Range 250 °/s as of the recorded logs, motion of twice as much.
pub fn clipped_gyro(rng: &mut Rng, score: &mut Score) {
    let (mut scene, change_s) = taught(rng, score, &[], &[moving(70.0, 3.5)], 0.0);
    scene.board.gyro.range = 250f64.to_radians();
    score.watch(change_s, |shown| shown.reason == "gyro_clipped");
    score.good_from_s = change_s;
    score.errors_from = From::Time(change_s);
    run(scene, rng, score);
}

pub fn slow_gyro(rng: &mut Rng, score: &mut Score) {
    let wanted = |shown: &Shown| shown.reason == "no_gyro";
    let rate = rng.uniform(0.5, 1.2);
    in_motion(rng, score, 60.0, rate, wanted, |board| {
        board.gyro.every = 100
    });
}

/// It never was there.
pub fn no_accelerometer(rng: &mut Rng, score: &mut Score) {
    let moving = free(rng, 60.0);
    let (mut scene, _) = taught(rng, score, &[], &[moving], 0.0);
    scene.board.force.silent = true;
    score.faults = vec![(0.0, f64::INFINITY)];
    score.watch(0.0, |shown| shown.reason == "no_accelerometer");
    run(scene, rng, score);
}
