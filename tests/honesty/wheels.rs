//! Motion on wheels: a car on roads, a robot on a floor.

use nalgebra::{UnitQuaternion, Vector3};

use crate::motion::{EasedTurn, Motion, Pose};
use crate::random::{Rng, Smooth};

/// How a car is driven.
#[derive(Clone, Copy)]
pub struct Driving {
    /// Straights between turns, seconds: least and most.
    pub straight_s: (f64, f64),
    /// Speed in turns, m/s: least and most.
    pub turn_speed: (f64, f64),
    /// Acceleration across in turns, at its peak, m/s²: least and most. Usual drivers stay below 3 to 4.
    pub across: (f64, f64),
    /// How often a stop at a light comes before a turn.
    pub stops: f64,
    /// Grade and camber of the roads, degrees.
    pub grade_deg: f64,
    pub camber_deg: f64,
}

enum Plan {
    Stand { left_s: f64 },
    Straight { left_s: f64, cruise: f64 },
    Brake { to: f64 },
    Turn(EasedTurn),
}

/// A car.
pub struct Car {
    driving: Driving,
    plan: Plan,
    yaw: f64,
    speed: f64,
    accel: f64,
    position: Vector3<f64>,
    turned: f64,
    /// Grade and camber of the road, shaking on its springs.
    road: Smooth<3>,
    shake: Smooth<2>,
    wander: Smooth<3>,
}

impl Car {
    /// A car that stands for `wait_s` first.
    pub fn new(driving: Driving, wait_s: f64, rng: &mut Rng) -> Self {
        Self {
            driving,
            plan: Plan::Stand { left_s: wait_s },
            yaw: rng.uniform(0.0, std::f64::consts::TAU),
            speed: 0.0,
            accel: 0.0,
            position: Vector3::zeros(),
            turned: 0.0,
            road: Smooth::new(5.0, rng),
            shake: Smooth::new(0.05, rng),
            wander: Smooth::new(2.0, rng),
        }
    }

    fn next_straight(&self, rng: &mut Rng) -> Plan {
        let (least, most) = self.driving.straight_s;
        Plan::Straight {
            left_s: rng.uniform(least, most),
            cruise: rng.uniform(8.0, 22.0),
        }
    }

    /// The acceleration that is wanted, and the rate of turn. Usual drivers speed up by 1 to 1.3 m/s² and brake by
    /// less than 2.
    fn drive(&mut self, rng: &mut Rng, dt: f64) -> (f64, f64) {
        match &mut self.plan {
            Plan::Stand { left_s } => {
                *left_s -= dt;
                if *left_s <= 0.0 {
                    self.plan = self.next_straight(rng);
                }
                ((-self.speed / 1.5).max(-1.8), 0.0)
            }
            Plan::Straight { left_s, cruise } => {
                *left_s -= dt;
                let wanted = ((*cruise - self.speed) / 4.0).clamp(-1.0, 1.3);
                if *left_s <= 0.0 {
                    let (least, most) = self.driving.turn_speed;
                    let to = rng.uniform(least, most);
                    self.plan = Plan::Brake { to };
                }
                (wanted, 0.0)
            }
            Plan::Brake { to } => {
                let to = *to;
                if (self.speed - to).abs() < 0.3 {
                    let (least, most) = self.driving.across;
                    let across = rng.uniform(least, most);
                    let rad = rng.sign() * rng.uniform(20.0, 90.0).to_radians();
                    // The eased turn's rate peaks at twice its mean.
                    let length_s = 2.0 * rad.abs() * self.speed.max(2.0) / across;
                    self.plan = Plan::Turn(EasedTurn::new(self.yaw, rad, length_s));
                }
                (((to - self.speed) / 1.5).clamp(-1.8, 1.3), 0.0)
            }
            Plan::Turn(turn) => {
                let (yaw, over) = turn.step(dt);
                let rate = (yaw - self.yaw) / dt;
                if over {
                    self.plan = if rng.chance(self.driving.stops) {
                        Plan::Stand {
                            left_s: rng.uniform(5.0, 40.0),
                        }
                    } else {
                        self.next_straight(rng)
                    };
                }
                (0.0, rate)
            }
        }
    }
}

impl Motion for Car {
    fn step(&mut self, rng: &mut Rng, dt: f64) -> Pose {
        let (wanted, rate) = self.drive(rng, dt);
        self.accel += (wanted - self.accel) * dt / 0.3;
        self.speed = (self.speed + self.accel * dt).max(0.0);
        self.yaw += rate * dt;
        self.turned += (rate * dt).abs();
        let moving = (self.speed / 5.0).min(1.0);
        let road = self.road.step(rng, dt * moving);
        let shake = self.shake.step(rng, dt) * (0.15 * moving + 0.01);
        let wander = self.wander.step(rng, dt * moving) * 0.4;
        let yaw = self.yaw + wander.x.to_radians();
        self.position += Vector3::new(yaw.cos(), yaw.sin(), 0.0) * (self.speed * dt);
        // A car rolls outwards and dives by 0.4° for each m/s².
        let roll = self.driving.camber_deg * road.x + shake.x - 0.4 * rate * self.speed;
        let pitch = self.driving.grade_deg * road.y + shake.y + 0.4 * self.accel;
        Pose {
            attitude: UnitQuaternion::from_euler_angles(roll.to_radians(), pitch.to_radians(), yaw),
            position: self.position,
        }
    }

    fn turned_deg(&self) -> f64 {
        self.turned.to_degrees()
    }
}

/// A robot that drives about on a floor and turns on the spot.
pub struct Robot {
    half: f64,
    yaw: f64,
    position: Vector3<f64>,
    speed: f64,
    /// Left of the straight, metres; the turn after it.
    straight: f64,
    turn: Option<EasedTurn>,
    wait_s: f64,
    shake: Smooth<2>,
}

impl Robot {
    /// On a floor from `-half` to `half`, after `wait_s`.
    pub fn new(half: f64, wait_s: f64, rng: &mut Rng) -> Self {
        Self {
            half,
            yaw: rng.uniform(0.0, std::f64::consts::TAU),
            position: Vector3::zeros(),
            speed: 0.0,
            straight: 1.0,
            turn: None,
            wait_s,
            shake: Smooth::new(0.1, rng),
        }
    }
}

impl Motion for Robot {
    fn step(&mut self, rng: &mut Rng, dt: f64) -> Pose {
        self.wait_s -= dt;
        let mut wanted = 0.0;
        if self.wait_s > 0.0 {
        } else if let Some(turn) = &mut self.turn {
            let over;
            (self.yaw, over) = turn.step(dt);
            if over {
                self.turn = None;
                self.straight = rng.uniform(0.5, 3.0);
            }
        } else {
            let ahead = Vector3::new(self.yaw.cos(), self.yaw.sin(), 0.0);
            let outside = (self.position + ahead * 0.5).amax() > self.half - 1.2;
            self.straight -= self.speed * dt;
            wanted = if self.straight > 0.0 && !outside {
                0.5
            } else {
                0.0
            };
            if wanted == 0.0 && self.speed < 0.02 {
                // Towards the middle from a wall, anywhere else.
                let rad = if outside {
                    let home = (-self.position.y).atan2(-self.position.x);
                    headingd::frame::wrap_pi(home + rng.uniform(-0.7, 0.7) - self.yaw)
                } else {
                    rng.sign() * rng.uniform(30.0, 180.0).to_radians()
                };
                let rate = rng.uniform(20.0, 60.0).to_radians();
                let length_s = (2.0 * rad.abs() / rate).max(0.2);
                self.turn = Some(EasedTurn::new(self.yaw, rad, length_s));
            }
        }
        self.speed += ((wanted - self.speed) / 0.3).clamp(-1.0, 1.0) * dt;
        self.position += Vector3::new(self.yaw.cos(), self.yaw.sin(), 0.0) * (self.speed * dt);
        let shake = self.shake.step(rng, dt) * (0.005 * (self.speed / 0.5).min(1.0));
        Pose {
            attitude: UnitQuaternion::from_euler_angles(shake.x, shake.y, self.yaw),
            position: self.position,
        }
    }
}
