//! How late readings come: a host that pauses stamps what has piled up when it wakes.
//!
//! A chip measures evenly. So a reading that comes a period and a half after the one before is half a period late, and
//! those that follow at once are still late by what is left of that. If those that follow take their time, none had piled up:
//! readings were lost, and none is late.

/// The period is the mean over this time, seconds, …
const MEAN_S: f64 = 30.0;
/// … and a reading is called late by no more than this share of it less for each reading: a period that is measured a little
/// too short would add up.
const FORGIVEN: f64 = 0.03;
/// So many of the steps must be a period long, within half of it. Where fewer are, the chip is read at odd times, and each
/// reading's time is its own.
const REGULAR: f64 = 0.6;
/// A reading that comes after less than this share of a period had piled up.
const PILED: f64 = 0.75;
/// Weight of each long step in the share of those that were losses, so that the last five count.
const LOSS_WEIGHT: f64 = 0.2;
/// Later than this is a hole, seconds.
const HOLE_S: f64 = 0.1;

/// Follows one chip's readings.
#[derive(Clone, Copy, Debug, Default)]
pub struct Lateness {
    last_s: Option<f64>,
    period_s: f64,
    seen_s: f64,
    count: f64,
    /// Share of the steps that are a period long.
    regular: f64,
    late_s: f64,
    /// Share of the long steps after which nothing had piled up.
    lost: f64,
}

impl Lateness {
    /// Takes the time of a reading. How late it is, seconds.
    pub fn take(&mut self, t_s: f64) -> f64 {
        let Some(last_s) = self.last_s.replace(t_s) else {
            return 0.0;
        };
        let step_s = t_s - last_s;
        if !(0.0..=HOLE_S).contains(&step_s) {
            *self = Self {
                last_s: Some(t_s),
                ..Self::default()
            };
            return 0.0;
        }
        self.seen_s += step_s;
        // The same weight for each step, however long: their mean is the period.
        self.count += 1.0;
        let weight = (1.0 / self.count).max(self.period_s / MEAN_S);
        self.period_s += (step_s - self.period_s) * weight;
        let is_period = (step_s - self.period_s).abs() < 0.5 * self.period_s;
        self.regular += (f64::from(u8::from(is_period)) - self.regular) * weight;
        if self.seen_s < 1.0 {
            return 0.0;
        }
        let piled = step_s < PILED * self.period_s;
        if self.late_s > 0.5 * self.period_s {
            self.lost += (f64::from(u8::from(!piled)) - self.lost) * LOSS_WEIGHT;
        }
        let before_s = if piled { self.late_s } else { 0.0 };
        let late_s = before_s + step_s - (1.0 + FORGIVEN) * self.period_s;
        self.late_s = late_s.clamp(0.0, HOLE_S);
        if self.regular < REGULAR || self.lost > 0.5 {
            return 0.0;
        }
        self.late_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A chip that measures every 10 ms, and a host that wakes at these times only.
    #[test]
    fn what_has_piled_up_in_a_pause_is_as_late_as_it_is() {
        let (mut lateness, mut last_s) = (Lateness::default(), 0.0_f64);
        for i in 0..2000 {
            let measured_s = f64::from(i) * 0.01;
            // Every second it sleeps for 60 ms, and takes what has come 2 ms apart.
            let phase = measured_s % 1.0;
            let wakes_s = if phase < 0.06 {
                measured_s - phase + 0.06
            } else {
                measured_s
            };
            last_s = wakes_s.max(last_s + 0.002);
            let late_s = lateness.take(last_s);
            if i > 500 {
                assert!(
                    (last_s - late_s - measured_s).abs() < 0.006,
                    "{i}: {late_s}"
                );
            }
        }
    }

    /// A chip that measures every 10 ms, and a line on which each 20th reading is lost.
    #[test]
    fn what_follows_a_loss_is_on_time() {
        let mut lateness = Lateness::default();
        for i in (0..2000).filter(|i| i % 20 != 7) {
            let late_s = lateness.take(f64::from(i) * 0.01);
            if i % 20 > 8 || i > 500 {
                assert!(late_s < 1e-3, "{i}: {late_s}");
            }
        }
    }

    #[test]
    fn even_readings_are_on_time_and_a_hole_begins_anew() {
        let mut lateness = Lateness::default();
        for i in 0..500 {
            assert!(lateness.take(f64::from(i) * 0.02) < 1e-3);
        }
        assert_eq!(lateness.take(20.0), 0.0);
        assert_eq!(lateness.take(20.09), 0.0);
    }
}
