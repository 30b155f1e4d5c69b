//! How boards move: where they are and how they lie, step by step. North, east, down; body axes X forward, Z down.

use nalgebra::{UnitQuaternion, Vector3};

use crate::random::{Rng, Smooth};

/// Where a board is.
#[derive(Clone, Copy)]
pub struct Pose {
    /// From body axes to north, east, down.
    pub attitude: UnitQuaternion<f64>,
    pub position: Vector3<f64>,
}

/// A motion.
pub trait Motion {
    /// Where the board is `dt_s` later.
    fn step(&mut self, rng: &mut Rng, dt_s: f64) -> Pose;

    /// How far it has turned in turns so far, degrees.
    fn turned_deg(&self) -> f64 {
        0.0
    }
}

/// The way from 0 to 1 with a speed that swells and ebbs away.
pub fn ease(share: f64) -> f64 {
    let u = share.clamp(0.0, 1.0);
    u - (std::f64::consts::TAU * u).sin() / std::f64::consts::TAU
}

/// A turn with such a speed under way, radians.
pub struct EasedTurn {
    from: f64,
    by: f64,
    t_s: f64,
    length_s: f64,
}

impl EasedTurn {
    pub fn new(from: f64, by: f64, length_s: f64) -> Self {
        Self {
            from,
            by,
            t_s: 0.0,
            length_s,
        }
    }

    /// The yaw `dt_s` later, and whether that is the end of the turn.
    pub fn step(&mut self, dt_s: f64) -> (f64, bool) {
        self.t_s += dt_s;
        let yaw = self.from + self.by * ease(self.t_s / self.length_s);
        (yaw, self.t_s >= self.length_s)
    }
}

/// Rises from 0 to 1 and falls again, over `edge_s` at either end.
fn envelope(t_s: f64, length_s: f64, edge_s: f64) -> f64 {
    ease((t_s / edge_s).min((length_s - t_s) / edge_s))
}

/// A part of what a hand or a stand does with a board.
#[derive(Clone, Copy)]
pub enum Part {
    /// Nothing, for so many seconds.
    Rest(f64),
    /// Back to level.
    Level(f64),
    /// A rotation about the vertical; the hand sways by some degrees, and the board is moved on a circle.
    Turn {
        deg: f64,
        s: f64,
        sway_deg: f64,
        radius: f64,
    },
    /// A rotation about an axis of the body.
    Roll {
        axis: Vector3<f64>,
        deg: f64,
        s: f64,
    },
    /// Any rotation at this rate (RMS an axis), with accelerations of the wrist of this size (RMS an axis) within some decimetres.
    Free { s: f64, rate: f64, accel: f64 },
}

impl Part {
    pub fn length_s(&self) -> f64 {
        match *self {
            Self::Rest(s) | Self::Level(s) => s,
            Self::Turn { s, .. } | Self::Roll { s, .. } | Self::Free { s, .. } => s,
        }
    }
}

/// How long the parts take together, seconds.
pub fn length_s(parts: &[Part]) -> f64 {
    parts.iter().map(Part::length_s).sum()
}

/// How far a hand moves a board, metres RMS an axis.
const REACH: f64 = 0.12;
/// Longest distance from the wrist, about which the hand turns the board, to the chips, metres.
const WRIST: f64 = 0.15;

/// A hand, or a stand, that does one part after the other, and rests at the end.
pub struct Hand {
    parts: Vec<Part>,
    next: usize,
    t_s: f64,
    start: Pose,
    now: Pose,
    /// From the wrist to the chips, body axes, metres.
    arm: Vector3<f64>,
    rate: Smooth<2>,
    place: Smooth<4>,
    sway: Smooth<3>,
}

impl Hand {
    /// From level, at any heading.
    pub fn new(parts: Vec<Part>, rng: &mut Rng) -> Self {
        let yaw = rng.uniform(0.0, std::f64::consts::TAU);
        let start = Pose {
            attitude: UnitQuaternion::from_euler_angles(0.0, 0.0, yaw),
            position: Vector3::zeros(),
        };
        let accel = parts.iter().find_map(|part| match part {
            Part::Free { accel, .. } => Some(*accel),
            _ => None,
        });
        // Four low-passes leave an acceleration of reach / (tau² √5).
        let tau = (REACH / accel.unwrap_or(1.0) / 5f64.sqrt()).sqrt();
        let rate_tau = rng.uniform(0.2, 0.6);
        let mut apart = rng.apart();
        Self {
            parts,
            next: 0,
            t_s: 0.0,
            start,
            now: start,
            arm: apart.direction() * apart.uniform(0.0, WRIST),
            rate: Smooth::new(rate_tau, rng),
            place: Smooth::new(tau, rng),
            sway: Smooth::new(0.7, rng),
        }
    }

    /// Where the chips are.
    fn chips(&self) -> Pose {
        Pose {
            position: self.now.position + self.now.attitude * self.arm,
            ..self.now
        }
    }
}

impl Motion for Hand {
    fn step(&mut self, rng: &mut Rng, dt_s: f64) -> Pose {
        self.t_s += dt_s;
        let Some(part) = self.parts.get(self.next) else {
            return self.chips();
        };
        let (t, length) = (self.t_s, part.length_s());
        let start = self.start;
        match *part {
            Part::Rest(_) => {}
            Part::Level(s) => {
                let (_, _, yaw) = start.attitude.euler_angles();
                let level = UnitQuaternion::from_euler_angles(0.0, 0.0, yaw);
                let way = start.attitude.rotation_to(&level).scaled_axis();
                self.now.attitude = UnitQuaternion::new(way * ease(t / s)) * start.attitude;
            }
            Part::Turn {
                deg,
                s,
                sway_deg,
                radius,
            } => {
                let angle = deg.to_radians() * ease(t / s);
                let about = UnitQuaternion::new(Vector3::z() * angle);
                let sway = if sway_deg > 0.0 {
                    let size = sway_deg.to_radians() * envelope(t, s, 1.5);
                    UnitQuaternion::new(self.sway.step(rng, dt_s) * size)
                } else {
                    UnitQuaternion::identity()
                };
                self.now.attitude = about * start.attitude * sway;
                let (_, _, yaw) = start.attitude.euler_angles();
                let arm = |yaw: f64| Vector3::new(yaw.cos(), yaw.sin(), 0.0) * radius;
                self.now.position = start.position + arm(yaw + angle) - arm(yaw);
            }
            Part::Roll { axis, deg, s } => {
                let angle = deg.to_radians() * ease(t / s);
                self.now.attitude = start.attitude * UnitQuaternion::new(axis * angle);
            }
            Part::Free { s, rate, .. } => {
                // Motion that was there before the log is, and does not swell up.
                let first = self.next == 0;
                let from = if first { t + 1.0 } else { t };
                let size = envelope(from, s + from - t, 1.0);
                let rate = self.rate.step(rng, dt_s) * (rate * size);
                self.now.attitude *= UnitQuaternion::new(rate * dt_s);
                self.now.position = start.position + self.place.step(rng, dt_s) * (REACH * size);
            }
        }
        if self.t_s >= length {
            self.t_s = 0.0;
            self.start = self.now;
            self.next += 1;
        }
        self.chips()
    }
}
