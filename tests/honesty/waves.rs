//! Motion without ground: a boat under way or at anchor, a drone in the air.

use std::f64::consts::TAU;

use nalgebra::{Rotation3, UnitQuaternion, Vector3};

use crate::motion::{EasedTurn, Motion, Pose, ease};
use crate::random::{Rng, Smooth};

/// Heading held for a while, then turned, again and again.
struct Course {
    yaw: f64,
    hold_s: (f64, f64),
    turn_deg: (f64, f64),
    /// Rate of turn at its peak, degrees a second.
    rate_deg_s: (f64, f64),
    left_s: f64,
    turn: Option<EasedTurn>,
    turned: f64,
}

impl Course {
    fn step(&mut self, rng: &mut Rng, dt: f64) -> f64 {
        let before = self.yaw;
        match &mut self.turn {
            Some(turn) => {
                let over;
                (self.yaw, over) = turn.step(dt);
                if over {
                    self.turn = None;
                    self.left_s = rng.uniform(self.hold_s.0, self.hold_s.1);
                }
            }
            None => {
                self.left_s -= dt;
                if self.left_s <= 0.0 {
                    let deg = rng.uniform(self.turn_deg.0, self.turn_deg.1);
                    let rate = rng.uniform(self.rate_deg_s.0, self.rate_deg_s.1);
                    let rad = rng.sign() * deg.to_radians();
                    self.turn = Some(EasedTurn::new(self.yaw, rad, 2.0 * deg / rate));
                }
            }
        }
        self.turned += (self.yaw - before).abs();
        self.yaw
    }
}

/// A boat.
pub struct Boat {
    course: Course,
    t_s: f64,
    /// Full turns at first, and rolling stops, the boat swinging at its anchor, from this time on.
    anchors_s: f64,
    swing: (f64, f64, f64),
    roll: (f64, f64, f64),
    pitch: (f64, f64, f64),
    heave: (f64, f64),
    speed: f64,
    wander: Smooth<3>,
    position: Vector3<f64>,
}

impl Boat {
    /// Under way, rolling by up to 15°.
    pub fn new(rng: &mut Rng) -> Self {
        Self {
            course: Course {
                yaw: rng.uniform(0.0, TAU),
                hold_s: (30.0, 120.0),
                turn_deg: (30.0, 180.0),
                rate_deg_s: (2.0, 8.0),
                left_s: 5.0,
                turn: None,
                turned: 0.0,
            },
            t_s: 0.0,
            anchors_s: f64::INFINITY,
            swing: (0.0, 1.0, 0.0),
            // Amplitude in degrees, period, phase: a yacht's 3 to 8 s.
            roll: (
                rng.uniform(5.0, 15.0),
                rng.uniform(3.0, 8.0),
                rng.uniform(0.0, TAU),
            ),
            pitch: (
                rng.uniform(1.0, 5.0),
                rng.uniform(3.0, 6.0),
                rng.uniform(0.0, TAU),
            ),
            heave: (rng.uniform(0.05, 0.4), rng.uniform(4.0, 7.0)),
            speed: rng.uniform(2.0, 4.0),
            wander: Smooth::new(3.0, rng),
            position: Vector3::zeros(),
        }
    }

    /// Two full circles and some minutes under way, then at anchor in calm water: it swings by up to 40° either way
    /// in 4 to 10 minutes, slower than 1.2 °/s.
    pub fn anchoring(anchors_s: f64, rng: &mut Rng) -> Self {
        let mut boat = Self::new(rng);
        boat.course.turn_deg = (400.0, 500.0);
        boat.course.hold_s = (20.0, 40.0);
        boat.course.rate_deg_s = (8.0, 12.0);
        boat.anchors_s = anchors_s;
        boat.swing = (
            rng.uniform(15.0, 40.0),
            rng.uniform(240.0, 600.0),
            rng.uniform(0.3, 0.6),
        );
        boat
    }
}

impl Motion for Boat {
    fn step(&mut self, rng: &mut Rng, dt: f64) -> Pose {
        self.t_s += dt;
        let t = self.t_s;
        let wave = |(size, period, phase): (f64, f64, f64)| {
            // Groups of waves: the size swells and falls over nine periods.
            let group = 0.7 + 0.3 * (TAU * t / (9.0 * period)).sin();
            (size * group * (TAU * t / period + phase).sin()).to_radians()
        };
        let wander = self.wander.step(rng, dt).x;
        // The sea calms down within a minute of anchoring, to a twentieth.
        let calm = 1.0 - 0.97 * ease((t - self.anchors_s) / 60.0);
        let yaw = if t < self.anchors_s {
            self.course.step(rng, dt)
        } else {
            let (deg, period, second) = self.swing;
            let phase = TAU * (t - self.anchors_s) / period;
            let share = (1.0 - phase.cos()) + second * (1.0 - (2.0 * phase).cos()) / 2.0;
            self.course.yaw + (deg * share).to_radians()
        };
        let yaw = yaw + (2.0 * wander * calm).to_radians();
        let ahead = Vector3::new(yaw.cos(), yaw.sin(), 0.0);
        self.position += ahead * (self.speed * calm * dt * (t / 5.0).min(1.0));
        let attitude =
            UnitQuaternion::from_euler_angles(wave(self.roll) * calm, wave(self.pitch) * calm, yaw);
        let (heave, period) = self.heave;
        let up = Vector3::z() * (heave * calm * (TAU * t / period).sin());
        // The board hangs 1 m above the axis that the boat rolls about.
        Pose {
            attitude,
            position: self.position + up - attitude * Vector3::z(),
        }
    }

    fn turned_deg(&self) -> f64 {
        self.course.turned.to_degrees()
    }
}

/// A drone: its thrust points where its accelerometer says up is, whatever it does.
pub struct Drone {
    course: Course,
    t_s: f64,
    starts_s: f64,
    place: Smooth<4>,
    before: [Vector3<f64>; 2],
    shake: Smooth<2>,
}

/// How far a drone strays from its place, metres RMS, and over which time.
const STRAY: f64 = 3.0;
const STRAY_TAU_S: f64 = 0.85;

impl Drone {
    /// On the ground until `starts_s`.
    pub fn new(starts_s: f64, rng: &mut Rng) -> Self {
        Self {
            course: Course {
                yaw: rng.uniform(0.0, TAU),
                hold_s: (3.0, 15.0),
                turn_deg: (30.0, 180.0),
                rate_deg_s: (30.0, 90.0),
                left_s: starts_s + 3.0,
                turn: None,
                turned: 0.0,
            },
            t_s: 0.0,
            starts_s,
            place: Smooth::new(STRAY_TAU_S, rng),
            before: [Vector3::zeros(); 2],
            shake: Smooth::new(0.05, rng),
        }
    }
}

impl Motion for Drone {
    fn step(&mut self, rng: &mut Rng, dt: f64) -> Pose {
        self.t_s += dt;
        let flying = ease((self.t_s - self.starts_s) / 3.0);
        let stray = Vector3::new(STRAY, STRAY, STRAY / 2.0);
        let place = self.place.step(rng, dt).component_mul(&stray) * flying;
        let accel = (place - self.before[0] * 2.0 + self.before[1]) / (dt * dt);
        self.before = [place, self.before[0]];
        let yaw = self.course.step(rng, dt);
        // Level on the ground, thrust against gravity and inertia in the air.
        let accel = if self.t_s > self.starts_s + 4.0 * dt {
            accel
        } else {
            Vector3::zeros()
        };
        let down = (Vector3::new(0.0, 0.0, 9.80665) - accel).normalize();
        let ahead = Vector3::new(yaw.cos(), yaw.sin(), 0.0);
        let right = down.cross(&ahead).normalize();
        let axes = [right.cross(&down), right, down];
        let attitude =
            UnitQuaternion::from_rotation_matrix(&Rotation3::from_basis_unchecked(&axes));
        let shake = self.shake.step(rng, dt) * (0.005 * flying);
        Pose {
            attitude: attitude * UnitQuaternion::new(shake),
            position: place,
        }
    }
}
