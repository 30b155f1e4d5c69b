//! The board's motion of the last moments: a magnetometer lags behind the gyro, so its samples belong to the past.

use std::collections::VecDeque;

use nalgebra::{UnitQuaternion, Vector3};

use super::clock::TICK_S;
use super::{Pose, Tick};

/// How long ticks are kept, seconds: a magnetometer lags by up to 0.12 s, and a pause of the host delays a sample by up to 0.1 s.
const KEPT_S: f64 = 0.25;

/// How the board lay and turned at one instant.
#[derive(Clone, Copy, Debug)]
pub struct BoardMotion {
    /// The pose.
    pub pose: Pose,
    /// Angular rate freed of the gyro's bias, body axes, rad/s.
    pub rate_rad_s: Vector3<f64>,
    /// Integral of that rate from the first tick on, radians.
    pub turned_rad: Vector3<f64>,
    /// Variance of the rotation that the gyro has missed from the first tick on, each axis, rad².
    pub missed_rad2: f64,
}

/// The ends of the last ticks, oldest first.
#[derive(Clone, Debug, Default)]
pub(super) struct Past {
    ticks: VecDeque<(f64, BoardMotion)>,
    turned_rad: Vector3<f64>,
    missed_rad2: f64,
}

impl Past {
    /// Takes the newest tick, and forgets old ticks and those of another stretch.
    pub(super) fn take(&mut self, tick: &Tick) {
        self.turned_rad += tick.rate_rad_s * TICK_S;
        self.missed_rad2 += tick.missed_rad2;
        while let Some((t_s, oldest)) = self.ticks.front()
            && (tick.t_s - t_s > KEPT_S || oldest.pose.stretch != tick.pose.stretch)
        {
            self.ticks.pop_front();
        }
        let motion = BoardMotion {
            pose: tick.pose,
            rate_rad_s: tick.rate_rad_s,
            turned_rad: self.turned_rad,
            missed_rad2: self.missed_rad2,
        };
        self.ticks.push_back((tick.t_s, motion));
    }

    /// Whether `t_s` is before the end of the last tick.
    pub(super) fn reaches(&self, t_s: f64) -> bool {
        self.ticks.back().is_some_and(|(end_s, _)| t_s < *end_s)
    }

    /// The motion at `t_s`. The rate is constant within a tick, before the oldest tick and after the newest.
    pub(super) fn at(&self, t_s: f64) -> Option<BoardMotion> {
        let after = self.ticks.partition_point(|(end_s, _)| *end_s < t_s);
        let (end_s, motion) = self.ticks.get(after).or(self.ticks.back())?;
        let turn = motion.rate_rad_s * (t_s - end_s);
        Some(BoardMotion {
            pose: Pose {
                orientation: motion.pose.orientation * UnitQuaternion::from_scaled_axis(turn),
                ..motion.pose
            },
            turned_rad: motion.turned_rad + turn,
            ..*motion
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Half a second of a board that turns faster and faster about its Z.
    fn spun_up(past: &mut Past, stretch: u32) {
        let mut angle = 0.0;
        for tick in 1..=50 {
            let rate = 0.2 * f64::from(tick);
            angle += rate * TICK_S;
            past.take(&Tick {
                t_s: f64::from(tick) * TICK_S,
                pose: Pose {
                    orientation: UnitQuaternion::from_scaled_axis(Vector3::z() * angle),
                    vertical_known: true,
                    stretch,
                },
                rate_rad_s: Vector3::z() * rate,
                missed_rad2: 0.0,
                at_rest: false,
            });
        }
    }

    #[test]
    fn a_moment_ago_the_board_lay_as_it_did_then() {
        let mut past = Past::default();
        assert!(past.at(0.0).is_none());
        spun_up(&mut past, 0);
        // Rates of 0.2, 0.4, … rad/s, each for 10 ms.
        let angle = |t_s: f64| {
            let ticks = (t_s / TICK_S).floor();
            0.002 * ticks * (ticks + 1.0) / 2.0 + 0.2 * (ticks + 1.0) * (t_s - ticks * TICK_S)
        };
        for t_s in [0.2512, 0.3777, 0.444, 0.4999] {
            let motion = past.at(t_s).unwrap();
            assert!(
                (motion.pose.orientation.angle() - angle(t_s)).abs() < 1e-9,
                "{t_s}"
            );
            assert!((motion.turned_rad.z - angle(t_s)).abs() < 1e-9, "{t_s}");
        }
        // Beyond either end the rate stays: 10 rad/s, and 5 rad/s from 0.25 s back.
        assert!((past.at(0.51).unwrap().turned_rad.z - (angle(0.4999999) + 0.1)).abs() < 1e-5);
        assert!(
            (past.at(0.2).unwrap().turned_rad.z - (angle(0.2499999) - 5.0 * 0.05)).abs() < 1e-5
        );
        assert!(past.ticks.len() <= 26);
    }

    #[test]
    fn poses_of_another_stretch_are_forgotten() {
        let mut past = Past::default();
        spun_up(&mut past, 0);
        spun_up(&mut past, 1);
        assert!(
            past.ticks
                .iter()
                .all(|(_, motion)| motion.pose.stretch == 1)
        );
    }
}
