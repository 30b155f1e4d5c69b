//! Turns to calibrate on: clean ones, and ones that something spoils. The board has nothing before, turns once level,
//! rests, and is then moved about.

use nalgebra::{UnitQuaternion, Vector3};

use crate::chips::{Board, Draw};
use crate::drive::{Now, Scene, run};
use crate::motion::{Hand, Part, length_s};
use crate::random::Rng;
use crate::score::{Score, apart_deg};
use crate::world::{Dipole, World};

/// Parallel chips and hardly any soft iron: what is wrong with a calibration comes from the turn.
const PARALLEL: Draw = Draw {
    hard: 0.7,
    soft: 0.005,
    apart_deg: 0.0,
    bias_deg_s: 2.0,
    room: 500.0,
};
/// The turn begins after this rest, seconds.
const REST_S: f64 = 4.0;
/// How much a board on a turntable or a floor sways, degrees RMS.
const SWAY_DEG: f64 = 0.5;

/// The scene, and when its turn ends, seconds.
fn turned(rng: &mut Rng, sway_deg: f64, radius: f64) -> (Scene, f64) {
    let s = rng.uniform(12.0, 30.0);
    let turn = Part::Turn {
        deg: rng.sign() * rng.uniform(365.0, 420.0),
        s,
        sway_deg,
        radius,
    };
    let part = |rng: &mut Rng, deg: f64| Part::Turn {
        deg,
        s: rng.uniform(4.0, 7.0),
        sway_deg: 3.0,
        radius: 0.0,
    };
    let first = rng.sign() * rng.uniform(60.0, 150.0);
    let second = rng.sign() * rng.uniform(60.0, 150.0);
    let parts = vec![
        Part::Rest(REST_S),
        turn,
        Part::Rest(5.0),
        part(rng, first),
        part(rng, second),
        Part::Rest(3.0),
    ];
    let world = World::draw(rng);
    let board = Board::draw(rng, world.strength(), &PARALLEL);
    let length = length_s(&parts);
    let hand = Hand::new(parts, rng);
    (Scene::new(world, board, hand, length), REST_S + s)
}

/// Runs it, and asks each calibration accepted from `from_s` on for its heading all the way round, in the earth's field.
fn judge(scene: Scene, turned_s: f64, from_s: f64, rng: &mut Rng, score: &mut Score) {
    score.starts_s = REST_S;
    score.learnt_by_s = turned_s + 1.0;
    let earth = scene.world.earth;
    // As the board is in the end: a motor has stopped by then, and what was attached to it has stayed.
    let (daemon, board) = run(scene, rng, score);
    for accepted in daemon.accepted.iter().filter(|a| a.t_s >= from_s) {
        let mut squares = 0.0;
        for step in 0..36 {
            let truth = f64::from(step) * 10.0;
            let yaw = UnitQuaternion::from_euler_angles(0.0, 0.0, truth.to_radians());
            let raw = board.mag.ideal(&(yaw.inverse() * earth));
            let error = accepted
                .level_heading_deg(&raw)
                .map_or(180.0, |heading| apart_deg(heading, truth));
            squares += error * error;
        }
        let error = f64::sqrt(squares / 36.0);
        score.accepted.push((accepted.claimed_sd_deg, error));
    }
}

/// By hand, level.
pub fn clean_by_hand(rng: &mut Rng, score: &mut Score) {
    let (scene, turned_s) = turned(rng, 2.0, 0.0);
    judge(scene, turned_s, 0.0, rng, score);
}

/// On a stand.
pub fn clean_on_stand(rng: &mut Rng, score: &mut Score) {
    let (scene, turned_s) = turned(rng, 0.0, 0.0);
    judge(scene, turned_s, 0.0, rng, score);
}

/// Something happens; what is accepted before this share of the turn cannot know of it.
fn spoiled(
    rng: &mut Rng,
    score: &mut Score,
    from_share: f64,
    mut spoil: impl FnMut(&Now, f64, &mut World, &mut Board) + 'static,
) {
    let (scene, turned_s) = turned(rng, SWAY_DEG, 0.0);
    let lasts_s = turned_s - REST_S;
    let scene = scene.with(move |now, world, board, _| {
        spoil(now, (now.t_s - REST_S) / lasts_s, world, board);
    });
    let accepted_from_s = REST_S + from_share * lasts_s;
    judge(scene, turned_s, accepted_from_s, rng, score);
}

/// On an arm of 0.2 to 0.6 m, beside a piece of iron.
pub fn radius_beside_iron(rng: &mut Rng, score: &mut Score) {
    let radius = rng.uniform(0.2, 0.6);
    let (mut scene, turned_s) = turned(rng, SWAY_DEG, radius);
    let bearing = rng.uniform(0.0, std::f64::consts::TAU);
    let far = radius + rng.uniform(0.4, 1.0);
    // 20 to 150 mG where the board comes nearest.
    let moment = rng.direction() * rng.log_uniform(20.0, 150.0) * (far - radius).powi(3);
    scene.world.dipoles.push(Dipole {
        position: Vector3::new(
            bearing.cos() * far,
            bearing.sin() * far,
            rng.uniform(-0.2, 0.2),
        ),
        velocity: Vector3::zeros(),
        moment,
    });
    judge(scene, turned_s, 0.0, rng, score);
}

/// A motor's current runs during the turn only.
pub fn motor(rng: &mut Rng, score: &mut Score) {
    let field = rng.direction() * rng.log_uniform(15.0, 200.0);
    spoiled(rng, score, 0.0, move |_, share, _, board| {
        let on = (0.0..1.0).contains(&share);
        board.mag.attached = field * f64::from(on);
    });
}

/// The field creeps by 30 to 150 mG during the turn, and stays.
pub fn creep(rng: &mut Rng, score: &mut Score) {
    let field = rng.direction() * rng.uniform(30.0, 150.0);
    spoiled(rng, score, 0.0, move |_, share, _, board| {
        // The creep is the board's own, of a current or a temperature.
        board.mag.attached = field * share.clamp(0.0, 1.0);
    });
}

/// A slow hum: a current of 0.05 to 2 Hz nearby.
pub fn hum(rng: &mut Rng, score: &mut Score) {
    let field = rng.direction() * rng.log_uniform(10.0, 100.0);
    let turns_s = rng.log_uniform(0.05, 2.0) * std::f64::consts::TAU;
    spoiled(rng, score, 0.0, move |now, _, world, _| {
        world.added = field * (turns_s * now.t_s).sin();
    });
}

/// The magnetometer clips one axis or two, and does not say so.
pub fn silent_clipping(rng: &mut Rng, score: &mut Score) {
    let (mut scene, turned_s) = turned(rng, SWAY_DEG, 0.0);
    let level = scene.world.earth.x;
    let most = (scene.board.mag.bias.xy().abs().add_scalar(level)).max();
    scene.board.mag.clip = most - level * rng.uniform(0.1, 0.9);
    judge(scene, turned_s, 0.0, rng, score);
}

/// A car comes past, 100 to 500 A·m², at 3 to 15 m/s.
pub fn car_passing(rng: &mut Rng, score: &mut Score) {
    let aside = rng.uniform(1.5, 4.0);
    let speed = rng.uniform(3.0, 15.0);
    let at = rng.uniform(0.1, 0.9);
    let moment = rng.direction() * rng.uniform(100.0, 500.0);
    let mut came = false;
    spoiled(rng, score, 0.0, move |_, share, world, _| {
        if !came && share > at - 0.05 {
            came = true;
            world.dipoles.push(Dipole {
                position: Vector3::new(aside, -3.0 * speed, 0.3),
                velocity: Vector3::new(0.0, speed, 0.0),
                moment,
            });
        }
    });
}

/// A magnet is swept past by hand within 1 to 4 s.
pub fn magnet_swept(rng: &mut Rng, score: &mut Score) {
    let moment = rng.direction() * rng.log_uniform(30.0, 300.0) * 0.027;
    let (begins, bearing) = (
        rng.uniform(0.1, 0.8),
        rng.uniform(0.0, std::f64::consts::TAU),
    );
    let length_s = rng.uniform(1.0, 4.0);
    let mut since_s = None;
    spoiled(rng, score, 0.0, move |now, share, world, _| {
        world.dipoles.clear();
        if share < begins {
            return;
        }
        let t = (now.t_s - *since_s.get_or_insert(now.t_s)) / length_s;
        if t < 1.0 {
            let near = Vector3::new(bearing.cos(), bearing.sin(), 0.0) * 0.3;
            let along = Vector3::new(-bearing.sin(), bearing.cos(), 0.0) * (4.0 * t - 2.0);
            world.dipoles.push(Dipole {
                position: now.pose.position + near + along,
                velocity: Vector3::zeros(),
                moment,
            });
        }
    });
}

/// A magnet is attached somewhere in the turn, and stays.
pub fn magnet_attached(rng: &mut Rng, score: &mut Score) {
    let field = rng.direction() * rng.log_uniform(20.0, 300.0);
    let at = rng.uniform(0.1, 0.9);
    spoiled(rng, score, at, move |_, share, _, board| {
        board.mag.attached = field * f64::from(share > at);
    });
}
