//! The even clock: a gyro's readings come in bursts and with gaps, and the filter needs equal periods.

use nalgebra::Vector3;

/// Length of a tick, seconds.
pub const TICK_S: f64 = 0.01;

/// The gyro's rate as a line from reading to reading, integrated exactly over each tick.
#[derive(Default)]
pub(super) struct EvenClock {
    gap_s: f64,
    newest: Option<(f64, Vector3<f64>)>,
    base_s: f64,
    ticks: u64,
    /// Rotation from the last tick to the newest reading, bias included, radians.
    open_rad: Vector3<f64>,
}

impl EvenClock {
    pub(super) fn new(gap_s: f64) -> Self {
        Self {
            gap_s,
            ..Self::default()
        }
    }

    /// Takes a reading and calls `on_tick` with the end and the mean rate of each tick it completes. After a gap the clock restarts.
    /// Returns `false` if the reading was older than the newest one, or a repetition of it.
    pub(super) fn take(
        &mut self,
        t_s: f64,
        rate: Vector3<f64>,
        mut on_tick: impl FnMut(f64, Vector3<f64>),
    ) -> bool {
        let before = self.newest.filter(|_| !self.gap_before(t_s));
        let Some((mut from_s, mut from_rate)) = before else {
            self.start(t_s, rate);
            return true;
        };
        let span_s = t_s - from_s;
        if span_s <= 0.0 {
            return false;
        }
        let slope = (rate - from_rate) / span_s;
        loop {
            let end_s = self.base_s + (self.ticks + 1) as f64 * TICK_S;
            if end_s > t_s {
                break;
            }
            let step_s = end_s - from_s;
            let at_end = from_rate + slope * step_s;
            let mean = (self.open_rad + (from_rate + at_end) * (0.5 * step_s)) / TICK_S;
            (from_s, from_rate) = (end_s, at_end);
            self.open_rad = Vector3::zeros();
            self.ticks += 1;
            on_tick(end_s, mean);
        }
        self.open_rad += (from_rate + rate) * (0.5 * (t_s - from_s));
        self.newest = Some((t_s, rate));
        true
    }

    /// Whether the newest reading is further from `t_s` than a gap.
    pub(super) fn gap_before(&self, t_s: f64) -> bool {
        self.newest
            .is_some_and(|(newest_s, _)| (t_s - newest_s).abs() > self.gap_s)
    }

    /// Restarts with the next reading.
    pub(super) fn forget(&mut self) {
        self.newest = None;
    }

    fn start(&mut self, t_s: f64, rate: Vector3<f64>) {
        self.newest = Some((t_s, rate));
        self.base_s = t_s;
        self.ticks = 0;
        self.open_rad = Vector3::zeros();
    }

    /// Time of the newest reading, seconds.
    pub(super) fn newest_s(&self) -> Option<f64> {
        self.newest.map(|(newest_s, _)| newest_s)
    }

    /// Rotation from the last tick to `t_s` without `bias`. Beyond the newest reading its rate is held; `None` if that reading is further
    /// away than a gap.
    pub(super) fn beyond_tick_rad(&self, t_s: f64, bias: Vector3<f64>) -> Option<Vector3<f64>> {
        let (newest_s, rate) = self.newest?;
        // Also false for a time that is no number.
        let near = (t_s - newest_s).abs() <= self.gap_s;
        let since_tick_s = t_s - (self.base_s + self.ticks as f64 * TICK_S);
        near.then(|| self.open_rad + rate * (t_s - newest_s) - bias * since_tick_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uneven_readings_of_a_ramp_are_integrated_exactly() {
        let mut clock = EvenClock::new(0.5);
        let mut sum = Vector3::zeros();
        let mut ends = Vec::new();
        for t in [0.0, 0.003, 0.004, 0.064, 0.07, 0.3, 0.301, 0.405] {
            clock.take(t, Vector3::new(t, 1.0, -t), |end, mean| {
                sum += mean * TICK_S;
                ends.push(end);
            });
        }
        assert_eq!(ends.len(), 40);
        assert!((ends[39] - 0.4).abs() < 1e-12);
        assert!((sum - Vector3::new(0.08, 0.4, -0.08)).norm() < 1e-12);
        let beyond = clock.beyond_tick_rad(0.405, Vector3::zeros()).unwrap();
        assert!((beyond.y - 0.005).abs() < 1e-12);
    }

    #[test]
    fn gaps_and_jumps_restart_and_repetitions_are_ignored() {
        let mut clock = EvenClock::new(0.5);
        let rate = Vector3::x();
        let mut ticks = 0;
        let taken = [0.0, 0.2, 0.2, 0.1, 1.0, 1.05, 0.3]
            .map(|t| (clock.gap_before(t), clock.take(t, rate, |_, _| ticks += 1)));
        let (goes_on, ignored, restarts) = ((false, true), (false, false), (true, true));
        assert_eq!(
            taken,
            [
                goes_on, goes_on, ignored, ignored, restarts, goes_on, restarts
            ]
        );
        assert!((24..=25).contains(&ticks));
        assert!(clock.beyond_tick_rad(0.9, rate).is_none());
        assert!(clock.beyond_tick_rad(f64::NAN, rate).is_none());
    }
}
