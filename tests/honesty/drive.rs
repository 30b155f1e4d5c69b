//! One run: motion, world and chips make readings, the daemon answers, and the score is kept.
//!
//! A heading holds at its reading's time, which is when the reading reached the host, and is compared with the board's heading at that
//! time. A host that pauses reads late, while the board turns on.

use std::collections::VecDeque;

use headingd::frame::{Mountings, wrap_360};
use headingd::reading::Reading;
use headingd::recording::Entry;
use nalgebra::{UnitQuaternion, Vector3};

use crate::chips::Board;
use crate::daemon::{Daemon, Shown, true_calibration};
use crate::motion::{Motion, Pose};
use crate::random::Rng;
use crate::score::Score;
use crate::world::World;

/// Gravity, north, east, down, m/s².
const GRAVITY: Vector3<f64> = Vector3::new(0.0, 0.0, 9.80665);
/// Where X is nearer than this to the vertical it has no heading worth the name.
const STEEP_DEG: f64 = 25.0;
/// Poses are kept this far back, for the magnetometer's lag.
const PAST: usize = 16;
/// How long a host pauses, seconds.
const PAUSE_S: f64 = 0.06;

/// What holds at one step, as a script sees it.
pub struct Now {
    pub t_s: f64,
    pub pose: Pose,
    /// Specific force, body axes, m/s².
    pub force: Vector3<f64>,
}

/// What happens during a run: it may change world and board.
pub type Script = Box<dyn FnMut(&Now, &mut World, &mut Board, &mut Rng)>;

/// Everything that a run is made of.
pub struct Scene {
    pub world: World,
    pub board: Board,
    pub motion: Box<dyn Motion>,
    pub script: Script,
    pub length_s: f64,
    /// Step of the simulation, and period of gyro and accelerometer.
    pub dt_s: f64,
}

impl Scene {
    /// Gyro and accelerometer at 100 Hz, and nothing happens.
    pub fn new(world: World, board: Board, motion: impl Motion + 'static, length_s: f64) -> Self {
        Self {
            world,
            board,
            motion: Box::new(motion),
            script: Box::new(|_, _, _, _| {}),
            length_s,
            dt_s: 0.01,
        }
    }

    pub fn with(
        mut self,
        script: impl FnMut(&Now, &mut World, &mut Board, &mut Rng) + 'static,
    ) -> Self {
        self.script = Box::new(script);
        self
    }
}

/// The last poses, newest last.
struct Past {
    poses: [Pose; PAST],
    dt_s: f64,
    newest_s: f64,
}

impl Past {
    fn push(&mut self, pose: Pose) {
        self.poses.rotate_left(1);
        self.poses[PAST - 1] = pose;
        self.newest_s += self.dt_s;
    }

    /// The pose at `t_s`, and the newer of the two around it less the older.
    fn at(&self, t_s: f64) -> Pose {
        let back = ((self.newest_s - t_s) / self.dt_s).clamp(0.0, (PAST - 2) as f64);
        let older = PAST - 2 - back as usize;
        let share = 1.0 - back.fract();
        let (a, b) = (&self.poses[older], &self.poses[older + 1]);
        Pose {
            // So near to each other, and normalised, a chord is as good as an arc.
            attitude: UnitQuaternion::new_normalize(a.attitude.lerp(&b.attitude, share)),
            position: a.position.lerp(&b.position, share),
        }
    }
}

/// Readings and what was shown for them, until the simulation reaches their time. At the end of a run the last ones are not scored.
#[derive(Default)]
struct Awaited(VecDeque<(f64, Option<Shown>)>);

impl Awaited {
    /// Scores the readings whose time has come. If readings are kept, each gets its true heading.
    fn score(&mut self, past: &Past, turned_deg: f64, score: &mut Score) {
        while let Some(&(t_s, shown)) = self.0.front()
            && t_s <= past.newest_s
        {
            self.0.pop_front();
            let truth_deg = heading_deg(&past.at(t_s).attitude);
            let kept = score.readings.iter_mut().flatten().rev();
            for entry in kept.take_while(|entry| entry.reading.t_s >= t_s) {
                if entry.reading.t_s == t_s {
                    entry.heading_truth_deg = truth_deg.map(wrap_360);
                }
            }
            if let Some(shown) = shown {
                score.turned_deg = turned_deg;
                score.take(t_s, truth_deg, &shown);
            }
        }
    }
}

/// When readings reach the host.
struct Arrival {
    last_s: f64,
    pause_ends_s: f64,
    next_pause_s: f64,
}

impl Arrival {
    fn of(&mut self, t_s: f64, board: &Board, rng: &mut Rng) -> f64 {
        if t_s >= self.next_pause_s {
            self.pause_ends_s = t_s + PAUSE_S;
            self.next_pause_s = t_s + PAUSE_S + rng.wait(board.pause_every_s);
        }
        let apart = if self.last_s > t_s {
            rng.uniform(board.apart_s.0, board.apart_s.1)
        } else {
            0.0001
        };
        let mut on_time = t_s + board.jitter_s * rng.normal().abs();
        if board.polls_every_s > 0.0 {
            on_time = (on_time / board.polls_every_s).ceil() * board.polls_every_s;
        }
        self.last_s = on_time.max(self.pause_ends_s).max(self.last_s + apart);
        self.last_s
    }
}

/// The true heading of a board that lies like this, degrees; unknown where X is steep.
pub fn heading_deg(attitude: &UnitQuaternion<f64>) -> Option<f64> {
    let x = attitude * Vector3::x();
    let steep = x.z.abs() > STEEP_DEG.to_radians().cos();
    (!steep).then(|| x.y.atan2(x.x).to_degrees())
}

/// Runs the scene. What the daemon has come to at its end, and the board.
pub fn run(mut scene: Scene, rng: &mut Rng, score: &mut Score) -> (Daemon, Board) {
    let mag = &scene.board.mag;
    let given = score
        .given_truth
        .then(|| true_calibration(mag.matrix, mag.bias, scene.world.strength()));
    let mut daemon = Daemon::new(Mountings::default(), given);
    if let Some(off_deg) = score.place_off_deg {
        daemon.put_place(scene.world.place(off_deg));
    }
    let dt = scene.dt_s;
    let mut before = scene.motion.step(rng, dt);
    let mut past = Past {
        poses: [before; PAST],
        dt_s: dt,
        newest_s: 0.0,
    };
    let mut velocity = Vector3::zeros();
    let mut mag_s = rng.uniform(0.0, scene.board.mag.period_s);
    let mut arrival = Arrival {
        last_s: 0.0,
        pause_ends_s: 0.0,
        next_pause_s: if scene.board.pause_every_s.is_finite() {
            1.0
        } else {
            f64::INFINITY
        },
    };
    let mut awaited = Awaited::default();
    let steps = (scene.length_s / dt) as u64;
    for step in 1..=steps {
        let t_s = step as f64 * dt;
        let pose = scene.motion.step(rng, dt);
        past.push(pose);
        awaited.score(&past, scene.motion.turned_deg(), score);
        // In body axes, the mean over the step: what a gyro with a low-pass tells.
        let rate = (before.attitude.inverse() * pose.attitude).scaled_axis() / dt;
        let new_velocity = (pose.position - before.position) / dt;
        let accel = if step > 1 {
            (new_velocity - velocity) / dt
        } else {
            Vector3::zeros()
        };
        velocity = new_velocity;
        before = pose;
        let force = pose.attitude.inverse() * (accel - GRAVITY);
        let now = Now { t_s, pose, force };
        (scene.script)(&now, &mut scene.world, &mut scene.board, rng);
        scene.world.step(dt, &pose.position);
        while mag_s <= t_s {
            let sensed = past.at(mag_s - scene.board.mag.lag_s);
            let field = sensed.attitude.inverse() * scene.world.field(&sensed.position);
            let reading = Reading {
                t_s: arrival.of(mag_s, &scene.board, rng),
                field_mgauss: Some(scene.board.mag.read(&field, rng)),
                ..Reading::default()
            };
            if !lost(&scene.board, rng) {
                keep(score, reading);
                awaited.0.push_back((reading.t_s, daemon.read(reading)));
            }
            // A chip's own clock is even to a thousandth.
            mag_s += scene.board.mag.period_s * (1.0 + 0.001 * rng.normal());
        }
        let rate = scene.board.gyro.read(&rate, &force, dt, rng);
        let told = step.is_multiple_of(u64::from(scene.board.gyro.every));
        let reading = Reading {
            t_s: arrival.of(t_s, &scene.board, rng),
            rate_rad_s: told.then_some(rate),
            specific_force_m_s2: scene.board.force.read(&force, rng),
            ..Reading::default()
        };
        let empty = reading.rate_rad_s.is_none() && reading.specific_force_m_s2.is_none();
        if !empty && !lost(&scene.board, rng) {
            keep(score, reading);
            let _ = daemon.read(reading);
        }
    }
    (daemon, scene.board)
}

fn lost(board: &Board, rng: &mut Rng) -> bool {
    board.lost > 0.0 && rng.chance(board.lost)
}

fn keep(score: &mut Score, reading: Reading) {
    if let Some(readings) = &mut score.readings {
        readings.push(Entry {
            reading,
            heading_truth_deg: None,
        });
    }
}
