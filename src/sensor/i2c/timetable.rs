//! Schedules the magnetometer: when to start a measurement, and when to poll for it, learnt from when it was ready.

/// A chip that is not ready when it should be is looked at again after this, seconds.
const LOOK_S: f64 = 0.002;
/// Its own clock may be this much faster or slower than it should be.
const FAST: f64 = 0.9;
pub(super) const SLOW: f64 = 1.1;

pub(super) struct Timetable {
    pub(super) period_s: f64,
    /// The longest that a single measurement takes, seconds; `None` for a chip that measures by itself.
    pub(super) single_s: Option<f64>,
    /// When the next thing is to be done.
    pub(super) due_s: f64,
    /// When the measurement that is waited for began: as a single one, or after the last one.
    pub(super) measuring_since_s: Option<f64>,
    /// Scheduled start of this single measurement or the next.
    slot_s: f64,
    /// Delay from the start of a measurement to its first poll, as learnt.
    patience_s: f64,
    looked: bool,
    /// Measurements in a row that were ready at the first poll.
    at_once: u32,
}

impl Timetable {
    /// Of a chip that was set up now.
    pub(super) fn new(now_s: f64, period_s: f64, single_s: Option<f64>) -> Self {
        // After a configuration the first measurement takes two periods.
        let (due_s, measuring_since_s) = match single_s {
            Some(_) => (now_s, None),
            None => (now_s + 2.0 * period_s, Some(now_s + period_s)),
        };
        Self {
            period_s,
            single_s,
            due_s,
            measuring_since_s,
            slot_s: now_s,
            // The shortest period first, so that no measurement of a fast chip is missed while its period is learnt.
            patience_s: single_s.unwrap_or(FAST * period_s),
            looked: false,
            at_once: 0,
        }
    }

    /// A single measurement was started.
    pub(super) fn started(&mut self, now_s: f64) {
        self.measuring_since_s = Some(now_s);
        self.due_s = now_s + self.patience_s;
    }

    /// The measurement was not ready.
    pub(super) fn looked_in_vain(&mut self, now_s: f64) {
        self.looked = true;
        self.due_s = now_s + self.look_s();
    }

    /// A transfer failed: it is tried again with the next measurement.
    pub(super) fn failed(&mut self, now_s: f64) {
        self.due_s = now_s + self.period_s;
        if let Some(longest_s) = self.single_s {
            // The measurement under way is never read. A poll that comes too early after the next trigger would find it, and `learn` would
            // shorten the delay further.
            self.patience_s = longest_s;
            self.looked = false;
            self.measuring_since_s = None;
            self.slot_s = self.due_s;
        }
    }

    /// A measurement was read.
    pub(super) fn measured(&mut self, now_s: f64) {
        self.learn();
        if self.single_s.is_some() {
            self.measuring_since_s = None;
            self.slot_s += self.period_s;
            if now_s > self.slot_s + self.period_s {
                self.slot_s = now_s;
            }
            self.due_s = self.slot_s;
        } else {
            // Counted from when it was due, in whole steps: the chip does not wait for a board that is late.
            let since_s = now_s - (now_s - self.due_s) % self.patience_s;
            self.measuring_since_s = Some(since_s);
            self.due_s = since_s + self.patience_s;
        }
    }

    fn look_s(&self) -> f64 {
        match self.single_s {
            Some(_) => LOOK_S,
            None => LOOK_S.max(self.period_s / 20.0),
        }
    }

    /// Adaptive poll delay: shortens until a poll is early, then backs off slightly. A measurement that is ready at the
    /// first poll may have waited; an early poll costs a wake-up. The more polls in a row were on time, the smaller the
    /// step back.
    fn learn(&mut self) {
        let steps = f64::from(self.at_once);
        let looks = if self.looked {
            self.at_once = 0;
            0.5 / (2.0 + steps)
        } else {
            self.at_once = self.at_once.saturating_add(1);
            -(2e-5 * steps * steps).min(0.1)
        };
        let (least_s, most_s) = match self.single_s {
            Some(longest_s) => (LOOK_S, longest_s),
            None => (FAST * self.period_s, SLOW * self.period_s),
        };
        self.patience_s = (self.patience_s + looks * self.look_s()).clamp(least_s, most_s);
        self.looked = false;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn after_a_failed_transfer_a_measurement_is_polled_late_enough_to_be_the_new_one() {
        const LONGEST_S: f64 = 0.01;
        let mut times = Timetable::new(0.0, 0.025, Some(LONGEST_S));
        let delay_s = |times: &mut Timetable| {
            let now_s = times.due_s;
            times.started(now_s);
            times.due_s - now_s
        };
        for _ in 0..50 {
            delay_s(&mut times);
            times.measured(times.due_s);
        }
        assert!(delay_s(&mut times) < 0.9 * LONGEST_S);
        times.failed(times.due_s);
        assert!((delay_s(&mut times) - LONGEST_S).abs() < 1e-9);
    }
}
