//! Vehicles: car, boat, drone and robot.

use nalgebra::{Rotation3, Vector3};

use crate::chips::{Board, Draw};
use crate::drive::{Now, Scene, run};
use crate::motion::Motion;
use crate::random::Rng;
use crate::score::{From, Score};
use crate::waves::{Boat, Drone};
use crate::wheels::{Car, Driving, Robot};
use crate::world::{Dipole, World};

/// Chips in a vehicle: its iron is of the field's own strength at most.
const MODEST: Draw = Draw {
    hard: 1.0,
    soft: 0.1,
    apart_deg: 3.0,
    bias_deg_s: 2.0,
    room: 200.0,
};
/// How long a vehicle stands before it starts, seconds.
const WAIT_S: f64 = 5.0;

const USUAL: Driving = Driving {
    straight_s: (20.0, 150.0),
    turn_speed: (4.0, 10.0),
    across: (1.5, 3.5),
    stops: 0.3,
    grade_deg: 0.0,
    camber_deg: 0.0,
};
/// Roads are 2° steep and 1.5° cambered.
const HILLS: (f64, f64) = (2.0, 1.5);

fn vehicle(rng: &mut Rng, motion: impl Motion + 'static, length_s: f64) -> Scene {
    let world = World::draw(rng);
    let board = Board::draw(rng, world.strength(), &MODEST);
    Scene::new(world, board, motion, length_s)
}

/// Other cars come past: 30 to 300 A·m² each, in 2 to 6 m, one in 20 s on average.
fn traffic(rng: &mut Rng) -> impl FnMut(&Now, &mut World, &mut Board, &mut Rng) + 'static {
    let mut next_s = rng.wait(20.0);
    move |now, world, _, rng| {
        if now.t_s < next_s {
            return;
        }
        next_s = now.t_s + rng.wait(20.0);
        let ahead = now.pose.attitude * Vector3::x();
        let ahead = Vector3::new(ahead.x, ahead.y, 0.0).normalize();
        let right = Vector3::new(-ahead.y, ahead.x, 0.0);
        world.dipoles.push(Dipole {
            position: now.pose.position
                + ahead * 60.0
                + right * (rng.sign() * rng.uniform(2.0, 6.0))
                + Vector3::z() * rng.uniform(-0.5, 1.0),
            // Slow ones, parked ones and oncoming ones.
            velocity: ahead * rng.uniform(-15.0, 3.0),
            moment: rng.direction() * rng.uniform(30.0, 300.0),
        });
    }
}

/// Level roads, turns of 20 to 90°, 30 minutes.
pub fn car(rng: &mut Rng, score: &mut Score) {
    drive(USUAL, rng, score);
}

/// The same with an accelerometer as delivered.
pub fn untrimmed_car(rng: &mut Rng, score: &mut Score) {
    let mut scene = driven(USUAL, rng, score);
    scene.board.untrim(rng);
    run(scene, rng, score);
}

/// The same while the board warms up.
pub fn warming_car(rng: &mut Rng, score: &mut Score) {
    let mut scene = driven(USUAL, rng, score);
    scene.board.warm_up(rng);
    run(scene, rng, score);
}

/// A car over hills: their slopes look like acceleration, and the other way round.
pub fn car_on_hills(rng: &mut Rng, score: &mut Score) {
    let (grade_deg, camber_deg) = HILLS;
    let driving = Driving {
        grade_deg,
        camber_deg,
        ..USUAL
    };
    drive(driving, rng, score);
}

fn drive(driving: Driving, rng: &mut Rng, score: &mut Score) {
    let scene = driven(driving, rng, score);
    run(scene, rng, score);
}

fn driven(driving: Driving, rng: &mut Rng, score: &mut Score) -> Scene {
    score.starts_s = WAIT_S;
    score.errors_from = From::FirstGood;
    score.learnt_by_s = 600.0;
    let motion = Car::new(driving, WAIT_S, rng);
    vehicle(rng, motion, 1800.0).with(traffic(rng))
}

/// 8 m/s in tight turns, chips 3° apart, 10 minutes.
pub fn fast_car(rng: &mut Rng, score: &mut Score) {
    score.starts_s = WAIT_S;
    score.learnt_by_s = 200.0;
    let driving = Driving {
        straight_s: (5.0, 20.0),
        turn_speed: (8.0, 8.0),
        across: (4.0, 6.5),
        stops: 0.0,
        grade_deg: HILLS.0,
        camber_deg: HILLS.1,
    };
    let motion = Car::new(driving, WAIT_S, rng);
    let world = World::draw(rng);
    let parallel = Draw {
        apart_deg: 0.0,
        ..MODEST
    };
    let mut board = Board::draw(rng, world.strength(), &parallel);
    board.mag.matrix *= Rotation3::new(rng.direction() * 3f64.to_radians()).into_inner();
    let scene = Scene::new(world, board, motion, 600.0).with(traffic(rng));
    run(scene, rng, score);
}

/// 22 to 33 m/s through long curves, 30 minutes.
pub fn motorway(rng: &mut Rng, score: &mut Score) {
    let (grade_deg, camber_deg) = HILLS;
    let driving = Driving {
        straight_s: (10.0, 90.0),
        turn_speed: (22.0, 33.0),
        across: (0.8, 2.5),
        stops: 0.0,
        grade_deg,
        camber_deg,
    };
    drive(driving, rng, score);
}

/// Rolling by up to 15°, slow turns, 20 minutes.
pub fn boat(rng: &mut Rng, score: &mut Score) {
    score.learnt_by_s = 300.0;
    let motion = Boat::new(rng);
    let scene = vehicle(rng, motion, 1200.0);
    run(scene, rng, score);
}

/// Full circles, then 30 minutes at anchor: its gyro bias must not learn the swing.
pub fn anchor(rng: &mut Rng, score: &mut Score) {
    score.learnt_by_s = 300.0;
    let motion = Boat::anchoring(420.0, rng);
    let scene = vehicle(rng, motion, 2220.0);
    run(scene, rng, score);
}

/// Its motors' currents add up to 30 mG for a full throttle, 5 minutes.
pub fn drone(rng: &mut Rng, score: &mut Score) {
    score.starts_s = WAIT_S;
    score.learnt_by_s = 60.0;
    let motion = Drone::new(WAIT_S, rng);
    // Twisted leads of 20 to 40 A some centimetres away.
    let full = rng.direction() * rng.uniform(10.0, 60.0);
    let mut scene = vehicle(rng, motion, 300.0).with(move |now, _, board, _| {
        let running = f64::from(now.t_s > WAIT_S - 1.0);
        board.mag.attached = full * (0.5 * running * now.force.norm() / 9.80665);
    });
    // Motors shake the accelerometer by 0.5 m/s², whatever is done against it.
    scene.board.force.noise = 0.5;
    run(scene, rng, score);
}

/// A floor whose iron makes the field differ by 5 % from metre to metre, 10 minutes.
pub fn robot(rng: &mut Rng, score: &mut Score) {
    let scene = on_floor(rng, score);
    run(scene, rng, score);
}

/// The same without an accelerometer, on a board that stays level.
pub fn blind_robot(rng: &mut Rng, score: &mut Score) {
    let mut scene = on_floor(rng, score);
    scene.board.force.silent = true;
    score.faults = vec![(0.0, f64::INFINITY)];
    run(scene, rng, score);
}

/// The robot on a floor of usual iron, while its board warms up.
pub fn warming_robot(rng: &mut Rng, score: &mut Score) {
    let mut scene = on_floor(rng, score);
    scene.board.warm_up(rng);
    run(scene, rng, score);
}

fn on_floor(rng: &mut Rng, score: &mut Score) -> Scene {
    const HALF: f64 = 4.0;
    score.starts_s = WAIT_S;
    score.learnt_by_s = 120.0;
    let motion = Robot::new(HALF, WAIT_S, rng);
    let mut scene = vehicle(rng, motion, 600.0);
    scene.world.reinforce(rng, 0.05, HALF);
    scene
}
