//! How late readings come: a host that pauses stamps what has piled up when it wakes.
//!
//! A chip measures evenly. So a reading that comes a period and a half after the one before is half a period late, and
//! those that follow at once are still late by what is left of that. The last of them was late by less than a period: otherwise
//! there would be one more. If nothing follows at once, nothing had piled up: readings were lost, and none is late.

/// The period is the mean over this time, seconds.
const MEAN_S: f64 = 30.0;
/// Later than this is a hole, seconds.
const HOLE_S: f64 = 0.1;
/// Readings that had piled up come closer together than this share of a period: a line is at most four fifths full.
const PILED: f64 = 0.8;
/// A step of more than this many periods is a pause, or readings were lost in it.
const LONG: f64 = 1.5;
/// Weight of each long step in the mean of `losses`: the mean of about five.
const LOSS_WEIGHT: f64 = 0.2;

/// Follows one chip's readings.
#[derive(Clone, Copy, Debug, Default)]
pub struct Lateness {
    last_s: Option<f64>,
    period_s: f64,
    /// How long readings have come, up to `MEAN_S`, and how many steps there were.
    seen_s: f64,
    count: f64,
    late_s: f64,
    /// Whether the last step was long.
    long: bool,
    /// Mean over long steps: 1 where readings were lost, -1 where the host paused.
    losses: f64,
}

impl Lateness {
    /// Takes the time of a reading. How late it is, seconds, 0 to `HOLE_S`.
    pub fn take(&mut self, t_s: f64) -> f64 {
        let Some(last_s) = self.last_s.replace(t_s) else {
            return 0.0;
        };
        let step_s = t_s - last_s;
        if !(0.0..=HOLE_S).contains(&step_s) {
            // The number of readings in the hole is unknown, so the period is measured anew.
            *self = Self {
                last_s: Some(t_s),
                losses: self.losses,
                ..Self::default()
            };
            return 0.0;
        }
        self.seen_s = (self.seen_s + step_s).min(MEAN_S);
        // The same weight for each step, however long: their mean is the period.
        self.count += 1.0;
        let weight = (1.0 / self.count).max(self.period_s / MEAN_S);
        self.period_s += (step_s - self.period_s) * weight;
        if self.seen_s < HOLE_S {
            return 0.0;
        }
        let piled = step_s < PILED * self.period_s;
        if self.long {
            let loss = if piled { -1.0 } else { 1.0 };
            self.losses += (loss - self.losses) * LOSS_WEIGHT;
        }
        self.long = step_s > LONG * self.period_s;
        let before_s = if piled {
            self.late_s
        } else {
            self.late_s.min(self.period_s)
        };
        // If the measured period were too short, lateness would add up. One longest step at the end of the mean changes the period by
        // this share at most.
        let forgiven = HOLE_S / self.seen_s;
        let late_s = before_s + step_s - (1.0 + forgiven) * self.period_s;
        self.late_s = if self.losses > 0.0 {
            0.0
        } else {
            late_s.clamp(0.0, HOLE_S)
        };
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
            // A first long step may be a pause, until nothing follows at once.
            assert!(late_s < 1e-3 || i == 28, "{i}: {late_s}");
        }
    }

    /// A chip that measures every 10 ms, and a host that takes what has come every 64 ms.
    #[test]
    fn readings_in_bursts_have_the_chips_times() {
        let mut lateness = Lateness::default();
        let (mut last_s, mut apart_s) = (0.0_f64, Vec::new());
        for i in 0..4000 {
            let measured_s = f64::from(i) * 0.01;
            last_s = ((measured_s / 0.064).ceil() * 0.064).max(last_s + 0.0015);
            let late_s = lateness.take(last_s);
            if i > 1000 {
                apart_s.push(last_s - late_s - measured_s);
            }
        }
        let (least_s, most_s) = (apart_s.iter())
            .fold((f64::MAX, f64::MIN), |(least, most), &one| {
                (least.min(one), most.max(one))
            });
        // A constant delay remains: the duration of a burst. It cannot be observed.
        assert!(least_s > 0.0 && most_s < 0.015, "{least_s} {most_s}");
        assert!(most_s - least_s < 0.004, "{least_s} {most_s}");
    }

    #[test]
    fn readings_of_one_time_are_on_time() {
        let mut lateness = Lateness::default();
        for i in 0..100 {
            assert!(lateness.take(0.1 * f64::from(i / 10)) >= 0.0, "{i}");
        }
    }

    #[test]
    fn even_readings_are_on_time_and_so_is_what_follows_a_hole() {
        let mut lateness = Lateness::default();
        for i in 0..500 {
            assert!(lateness.take(f64::from(i) * 0.02) < 1e-3);
        }
        for i in 0..50 {
            assert!(lateness.take(20.0 + f64::from(i) * 0.02) < 1e-3);
        }
    }
}
