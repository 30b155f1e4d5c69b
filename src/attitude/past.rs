//! The board's motion of the last moments: a magnetometer lags behind the gyro, so its samples belong to the past.

use std::collections::VecDeque;

use nalgebra::UnitQuaternion;

use super::BoardMotion;

/// How long ticks are kept, seconds: a magnetometer lags by up to 0.12 s, and a pause of the host delays a sample by up to 0.1 s.
const KEPT_S: f64 = 0.25;

/// The last ticks, oldest first.
#[derive(Clone, Debug, Default)]
pub(super) struct Past {
    ticks: VecDeque<BoardMotion>,
}

impl Past {
    /// Takes the newest tick, and forgets old ticks and those of another frame.
    pub(super) fn take(&mut self, tick: &BoardMotion) {
        while let Some(oldest) = self.ticks.front()
            && (tick.t_s - oldest.t_s > KEPT_S || oldest.pose.frame_id != tick.pose.frame_id)
        {
            self.ticks.pop_front();
        }
        self.ticks.push_back(*tick);
    }

    /// Whether `t_s` is before the end of the last tick.
    pub(super) fn reaches(&self, t_s: f64) -> bool {
        self.ticks.back().is_some_and(|tick| t_s < tick.t_s)
    }

    /// The motion at `t_s`. The rate is constant within a tick, before the oldest tick and after the newest.
    pub(super) fn at(&self, t_s: f64) -> Option<BoardMotion> {
        let after = self.ticks.partition_point(|tick| tick.t_s < t_s);
        let tick = self.ticks.get(after).or(self.ticks.back())?;
        let turn = tick.rate_rad_s * (t_s - tick.t_s);
        let mut now = *tick;
        now.t_s = t_s;
        now.pose.orientation *= UnitQuaternion::from_scaled_axis(turn);
        now.turned_rad += turn;
        Some(now)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use crate::attitude::Pose;
    use crate::attitude::clock::TICK_S;

    /// Half a second of a board that turns faster and faster about its Z.
    fn spun_up(past: &mut Past, frame_id: u32) {
        let mut angle = 0.0;
        for tick in 1..=50 {
            let rate = 0.2 * f64::from(tick);
            angle += rate * TICK_S;
            past.take(&BoardMotion {
                t_s: f64::from(tick) * TICK_S,
                pose: Pose {
                    orientation: UnitQuaternion::from_scaled_axis(Vector3::z() * angle),
                    vertical_known: true,
                    frame_id,
                },
                rate_rad_s: Vector3::z() * rate,
                turned_rad: Vector3::z() * angle,
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
    fn poses_of_another_frame_are_forgotten() {
        let mut past = Past::default();
        spun_up(&mut past, 0);
        spun_up(&mut past, 1);
        assert!(past.ticks.iter().all(|tick| tick.pose.frame_id == 1));
    }
}
