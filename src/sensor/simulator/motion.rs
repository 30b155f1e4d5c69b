//! How the simulated board moves: its attitude as a smooth function of time.

use std::f64::consts::TAU;

use nalgebra::{UnitQuaternion, Vector3};

use super::settings::{Scenario, Settings};

/// Time over which a movement gains and loses its rate.
const RAMP_S: f64 = 0.5;
/// Rest between two movements.
const PAUSE_S: f64 = 1.0;
const WANDER_S: f64 = 20.0;
/// Free motion turns about the vertical, the body's Y and its X at these shares of the turn rate, none
/// a multiple of another, so that the field visits all of the sphere.
const FREE_SHARES: [f64; 3] = [0.45, 0.62, 0.37];
/// Length of a free motion, counted in turns at the turn rate itself.
const FREE_TURNS: f64 = 8.0;

/// Yaw about the vertical, then pitch about the body's Y, then roll about its X, in radians.
type Angles = [f64; 3];
const YAW: usize = 0;
const PITCH: usize = 1;
const ROLL: usize = 2;

#[derive(Clone, Debug)]
pub(super) struct Motion {
    movements: Vec<Movement>,
    wander_start_s: Option<f64>,
    tilt_rad: f64,
    pub(super) duration_s: f64,
    /// The motion begins again after so many seconds, having turned by so much about the vertical.
    repeats: Option<(f64, f64)>,
}

/// One of the angles changes, at a constant rate but for soft ends.
#[derive(Clone, Copy, Debug)]
struct Movement {
    which: usize,
    start_s: f64,
    angle_rad: f64,
    rate_rad_s: f64,
}

impl Movement {
    fn ramp_s(&self) -> f64 {
        RAMP_S.min(self.angle_rad.abs() / self.rate_rad_s)
    }

    fn end_s(&self) -> f64 {
        self.start_s + self.angle_rad.abs() / self.rate_rad_s + self.ramp_s()
    }

    /// The part of the angle that has been made at `t_s`.
    fn angle_at(&self, t_s: f64) -> f64 {
        let ramp_s = self.ramp_s();
        // Angle within a ramp: the integral of the smooth step 3x² − 2x³.
        let ramp = |x: f64| self.rate_rad_s * ramp_s * x.powi(3) * (1.0 - x / 2.0);
        let (since_s, left_s) = (t_s - self.start_s, self.end_s() - t_s);
        let made = if since_s <= 0.0 {
            0.0
        } else if left_s <= 0.0 {
            self.angle_rad.abs()
        } else if since_s < ramp_s {
            ramp(since_s / ramp_s)
        } else if left_s < ramp_s {
            self.angle_rad.abs() - ramp(left_s / ramp_s)
        } else {
            self.rate_rad_s * (since_s - ramp_s / 2.0)
        };
        made.copysign(self.angle_rad)
    }
}

impl Motion {
    pub(super) fn new(settings: &Settings) -> Self {
        let rate_rad_s = settings.turn_deg_s.to_radians();
        let turns = (YAW, settings.turns * TAU);
        let mut motion = Self {
            movements: Vec::new(),
            wander_start_s: None,
            tilt_rad: settings.tilt_deg.to_radians(),
            duration_s: 3.0,
            repeats: None,
        };
        match settings.scenario {
            Scenario::Planar => motion.add(rate_rad_s, &[turns]),
            Scenario::Spatial => {
                motion.add(
                    rate_rad_s,
                    &[
                        turns,
                        (YAW, 30f64.to_radians() - settings.turns.fract() * TAU),
                        (ROLL, TAU),
                        (YAW, 90f64.to_radians()),
                        (ROLL, TAU),
                    ],
                );
            }
            Scenario::Free => {
                let start_s = motion.duration_s;
                for (which, share) in FREE_SHARES.iter().enumerate() {
                    motion.movements.push(Movement {
                        which,
                        start_s,
                        angle_rad: share * FREE_TURNS * TAU,
                        rate_rad_s: share * rate_rad_s,
                    });
                }
                motion.duration_s += FREE_TURNS * TAU / rate_rad_s + RAMP_S + PAUSE_S;
            }
            Scenario::Demo | Scenario::Endless => {
                motion.duration_s = 5.0;
                motion.add(rate_rad_s, &[turns]);
                motion.wander_start_s = Some(motion.duration_s);
                motion.duration_s += WANDER_S;
            }
        }
        // The last pause is part of the closing rest.
        motion.duration_s += 2.0;
        if settings.scenario == Scenario::Endless {
            motion.repeats = Some((motion.duration_s, turns.1));
            motion.duration_s = f64::INFINITY;
        }
        motion
    }

    /// Movements one after the other, each with a pause behind it.
    fn add(&mut self, rate_rad_s: f64, angles: &[(usize, f64)]) {
        for &(which, angle_rad) in angles {
            let movement = Movement {
                which,
                start_s: self.duration_s,
                angle_rad,
                rate_rad_s,
            };
            self.duration_s = movement.end_s() + PAUSE_S;
            self.movements.push(movement);
        }
    }

    /// The rotation from body (X forward, Y right, Z down) to earth (magnetic north, east, down).
    pub(super) fn attitude(&self, t_s: f64) -> UnitQuaternion<f64> {
        let mut angles: Angles = [0.0; 3];
        let mut t_s = t_s;
        if let Some((period_s, turned_rad)) = self.repeats {
            let before = (t_s / period_s).floor();
            t_s -= before * period_s;
            angles[YAW] = before * turned_rad;
        }
        for movement in &self.movements {
            angles[movement.which] += movement.angle_at(t_s);
        }
        if let Some(start_s) = self.wander_start_s {
            let wander = wander(t_s - start_s);
            angles.iter_mut().zip(wander).for_each(|(a, w)| *a += w);
        }
        UnitQuaternion::from_euler_angles(angles[ROLL], angles[PITCH] + self.tilt_rad, angles[YAW])
    }

    /// Angular rate in body axes, rad/s: attitude before and after, half a millisecond each way.
    pub(super) fn rate_rad_s(&self, t_s: f64) -> Vector3<f64> {
        const HALF_S: f64 = 0.5e-3;
        let (before, after) = (self.attitude(t_s - HALF_S), self.attitude(t_s + HALF_S));
        (before.inverse() * after).scaled_axis() / (2.0 * HALF_S)
    }
}

/// Changes of heading by up to 60° and of tilt by up to 20° on either axis, from rest and back to it: as a hand carries a board.
fn wander(since_s: f64) -> Angles {
    if !(0.0..WANDER_S).contains(&since_s) {
        return [0.0; 3];
    }
    let x = (since_s.min(WANDER_S - since_s) / 3.0).min(1.0);
    let strength = x * x * (3.0 - 2.0 * x);
    let wave = |degrees: f64, period_s: f64| {
        strength * degrees.to_radians() * (TAU * since_s / period_s).sin()
    };
    [
        wave(40.0, 11.0) + wave(20.0, 6.1),
        wave(20.0, 4.3),
        wave(20.0, 5.2),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn motion(scenario: Scenario) -> Motion {
        Motion::new(&Settings {
            scenario,
            ..Settings::default()
        })
    }

    #[test]
    fn two_turns_at_51_4_degrees_a_second_take_14_seconds_and_soft_ends() {
        let motion = motion(Scenario::Planar);
        let turn = motion.movements[0];
        assert!((turn.end_s() - (3.0 + 720.0 / 51.4 + 0.5)).abs() < 1e-12);
        assert_eq!(motion.rate_rad_s(1.0), Vector3::zeros());
        let cruise = motion.rate_rad_s(8.0);
        assert!((cruise - Vector3::z() * 51.4f64.to_radians()).norm() < 1e-9);
        // The ramp takes half of what the cruise would.
        let after = turn.angle_at(4.0).to_degrees();
        assert!((after - 51.4 * 0.75).abs() < 1e-9, "{after}");
        let middle = (turn.start_s + turn.end_s()) / 2.0;
        assert!((turn.angle_at(middle) - TAU).abs() < 1e-12);
    }

    #[test]
    fn a_movement_runs_on_smoothly_even_if_it_is_short() {
        for angle_rad in [-7.0, -0.1, 0.0, 0.1, 7.0] {
            let movement = Movement {
                which: YAW,
                start_s: 1.0,
                angle_rad,
                rate_rad_s: 0.9,
            };
            let steps = (0..20_000).map(|i| movement.angle_at(f64::from(i) * 1e-3));
            let angles: Vec<f64> = steps.collect();
            for pair in angles.windows(2) {
                let step = (pair[1] - pair[0]) * angle_rad.signum();
                assert!(
                    (-1e-12..=0.9e-3 + 1e-12).contains(&step),
                    "{angle_rad}: {step}"
                );
            }
            assert_eq!(angles.last(), Some(&angle_rad));
        }
    }

    #[test]
    fn the_spatial_motion_ends_level_at_heading_120_with_two_rolls_behind_it() {
        let motion = motion(Scenario::Spatial);
        let end = motion.attitude(motion.duration_s);
        let (roll, pitch, yaw) = end.euler_angles();
        assert!(roll.abs() < 1e-9 && pitch.abs() < 1e-9);
        assert!((yaw.to_degrees() - 120.0).abs() < 1e-9);
        let rolls = motion.movements.iter().filter(|m| m.which == ROLL);
        assert_eq!(rolls.count(), 2);
    }

    #[test]
    fn the_wander_stays_within_29_degrees_of_level() {
        let motion = motion(Scenario::Demo);
        let mut most = 0f64;
        for i in 0..4000 {
            let down = motion.attitude(f64::from(i) * 0.01) * Vector3::z();
            most = most.max(down.z.acos().to_degrees());
        }
        assert!((18.0..29.0).contains(&most), "{most}");
    }

    #[test]
    fn the_endless_motion_goes_on_where_it_ended() {
        let motion = Motion::new(&Settings {
            scenario: Scenario::Endless,
            turns: 1.3,
            ..Settings::default()
        });
        assert_eq!(motion.duration_s, f64::INFINITY);
        let (period_s, _) = motion.repeats.unwrap();
        for round in [1.0, 2.0, 1000.0] {
            let (before, after) = [-1e-4, 1e-4]
                .map(|step_s| motion.attitude(round * period_s + step_s))
                .into();
            let step_rad = before.angle_to(&after);
            assert!(step_rad < 1e-6, "{round}: {step_rad}");
            let turning = motion.rate_rad_s(round * period_s + 10.0).norm();
            assert!((turning - 51.4f64.to_radians()).abs() < 1e-6, "{turning}");
        }
    }

    #[test]
    fn free_motion_shows_the_field_from_all_sides() {
        let motion = motion(Scenario::Free);
        let field = Vector3::new(162.8, 0.0, 526.7).normalize();
        let seen: Vec<Vector3<f64>> = (0..(motion.duration_s * 40.0) as i32)
            .map(|i| {
                motion
                    .attitude(f64::from(i) / 40.0)
                    .inverse_transform_vector(&field)
            })
            .collect();
        // From 400 directions spread evenly, the nearest sample is never far.
        for i in 0..400 {
            let z = 1.0 - (2.0 * f64::from(i) + 1.0) / 400.0;
            let turn = f64::from(i) * 2.399_963;
            let r = (1.0 - z * z).sqrt();
            let direction = Vector3::new(r * turn.cos(), r * turn.sin(), z);
            let nearest = seen.iter().map(|s| s.dot(&direction)).fold(-1.0, f64::max);
            assert!(nearest.acos().to_degrees() < 35.0, "{direction}");
        }
    }
}
