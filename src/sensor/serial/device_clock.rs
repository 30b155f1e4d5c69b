//! Times for readings of a device that sends its own: its clock is brought in line with ours.
//!
//! A reading that arrives late was delayed on the way, as when the daemon was stopped and its bytes waited for it, or
//! the device's clock has stood still for a moment. Only what follows tells which: delays pass.

use super::envelope::Envelope;

/// How far the device's clock may be fast or slow, as a share: a ceramic resonator is off by up to 0.5 %.
const TOLERANCE: f64 = 0.05;
/// Nothing arrives before it was sent. A reading that is early by more, seconds, is of a clock that has leapt: no
/// clock gains as much between two looks at it.
const EARLY_S: f64 = 0.1;
/// A clock that goes back by more, seconds, has begun anew. By less, rows came out of order; a clock that was
/// set back shows in readings that stay late.
const BACK_S: f64 = 0.1;
/// Readings that are later than this, seconds, …
const LATE_FROM_S: f64 = 0.1;
/// … and stay equally late to within this, seconds, …
const LATE_STEP_S: f64 = 0.03;
/// … for this long, seconds, are of a clock that has lost time.
const LATE_S: f64 = 0.4;

/// Device times and arrivals in, times out.
#[derive(Clone, Debug)]
pub struct DeviceClock {
    envelope: Envelope,
    /// The last time that the device sent, as it was sent, and when it first arrived.
    sent_s: f64,
    first_arrival_s: f64,
    last_device_s: f64,
    last_s: f64,
}

impl Default for DeviceClock {
    fn default() -> Self {
        Self {
            envelope: Envelope::new(TOLERANCE, LATE_STEP_S),
            sent_s: f64::NEG_INFINITY,
            first_arrival_s: f64::NEG_INFINITY,
            last_device_s: f64::NEG_INFINITY,
            last_s: f64::NEG_INFINITY,
        }
    }
}

impl DeviceClock {
    /// The time of a reading, seconds on the clock of the arrivals. Times never decrease, and are never later
    /// than the arrival.
    pub fn time(&mut self, sent_s: f64, arrival_s: f64) -> f64 {
        let restarted = sent_s < self.sent_s - BACK_S;
        let device_s = self.refined(sent_s, arrival_s);
        let late_s = self.envelope.late_s(device_s, arrival_s);
        if restarted || late_s < -EARLY_S {
            self.envelope.restart();
        } else if late_s > LATE_FROM_S {
            if self.envelope.late(late_s, arrival_s).lasts_s >= LATE_S {
                self.envelope.restart();
            }
        } else {
            self.envelope.in_time();
        }
        self.last_device_s = device_s;
        self.last_s = self.envelope.time(device_s, arrival_s).max(self.last_s);
        self.last_s
    }

    /// The device's time of a reading. Where a coarse clock sends the same number several times (whole seconds, or a 32-bit float after some
    /// days), the arrivals say how much later the second reading was.
    fn refined(&mut self, sent_s: f64, arrival_s: f64) -> f64 {
        if sent_s == self.sent_s {
            return sent_s + (arrival_s - self.first_arrival_s);
        }
        let least_s = match sent_s > self.sent_s {
            true => self.last_device_s,
            false => f64::NEG_INFINITY,
        };
        (self.sent_s, self.first_arrival_s) = (sent_s, arrival_s);
        sent_s.max(least_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slow_clock_is_followed_and_delays_are_undone() {
        let mut clock = DeviceClock::default();
        let mut worst: f64 = 0.0;
        for i in 0..6000u32 {
            let true_s = f64::from(i) * 0.01;
            // Every 16 ms the USB hands over what has come.
            let arrival_s = (true_s / 0.016).ceil() * 0.016;
            let t_s = clock.time(true_s * 0.995, arrival_s);
            if true_s > 5.0 {
                worst = worst.max((t_s - true_s).abs());
            }
        }
        assert!(worst < 0.006, "{worst}");
    }

    /// Rows of gyro and magnetometer, each with the time of its measurement and sent when the magnetometer has answered.
    #[test]
    fn rows_a_little_out_of_order_keep_the_clock() {
        let mut clock = DeviceClock::default();
        let mut worst: f64 = 0.0;
        for i in 1..3000u32 {
            let true_s = f64::from(i) * 0.02;
            for row_s in [true_s, true_s - 0.002] {
                let arrival_s = (true_s / 0.016).ceil() * 0.016;
                let t_s = clock.time(row_s, arrival_s);
                if true_s > 5.0 {
                    worst = worst.max((t_s - row_s).abs());
                }
            }
        }
        assert!(worst < 0.006, "{worst}");
    }

    #[test]
    fn after_a_reset_times_go_on() {
        let mut clock = DeviceClock::default();
        assert_eq!(clock.time(100.0, 5.0), 5.0);
        assert_eq!(clock.time(100.5, 5.5), 5.5);
        // It begins at 0 again, two seconds later, and then its clock leaps.
        assert_eq!(clock.time(0.0, 7.5), 7.5);
        assert_eq!(clock.time(0.1, 7.6), 7.6);
        assert_eq!(clock.time(4000.0, 7.7), 7.7);
        assert_eq!(clock.time(f64::from(u32::MAX), 7.8), 7.8);
    }

    /// A clock that stood still while the board was busy, one that was set, and one that began anew.
    #[test]
    fn a_clock_that_loses_or_gains_time_is_followed_within_a_second() {
        let losses_s = [0.15, 0.55, 0.7, 0.9, 5.0, 3600.0].map(|lost_s| (lost_s, 0.0));
        let leaps_s = [-200.0, -0.7, 0.2, 0.55, 0.7, 0.9, 5.0, 3600.0].map(|leap_s| (0.0, leap_s));
        for (lost_s, leap_s) in losses_s.into_iter().chain(leaps_s) {
            let mut clock = DeviceClock::default();
            let (mut device_s, mut true_s): (f64, f64) = (200.0, 0.0);
            for i in 1..2000u32 {
                device_s += 0.02 * 1.003;
                true_s += 0.02;
                if i == 1000 {
                    device_s += leap_s;
                    true_s += lost_s;
                }
                let arrival_s = (true_s / 0.008).ceil() * 0.008;
                let age_s = arrival_s - clock.time(device_s, arrival_s);
                let settled = !(1000..1025).contains(&i);
                assert!(
                    !settled || age_s < 0.1,
                    "lost {lost_s} s, leapt {leap_s} s: {age_s} s old at {true_s} s"
                );
            }
        }
    }

    /// The clock counts whole seconds, quarters of one, or does not count at all.
    #[test]
    fn between_the_steps_of_a_coarse_clock_arrivals_count() {
        for step_s in [1.0, 0.25, f64::INFINITY] {
            let mut clock = DeviceClock::default();
            let mut worst: f64 = 0.0;
            for i in 1..3000u32 {
                let true_s = f64::from(i) * 0.02;
                let arrival_s = (true_s / 0.008).ceil() * 0.008;
                let sent_s = match step_s.is_finite() {
                    true => (true_s / step_s).floor() * step_s,
                    false => 0.0,
                };
                let t_s = clock.time(sent_s, arrival_s);
                if true_s > 5.0 {
                    worst = worst.max((t_s - true_s).abs());
                }
            }
            // As irregular as the readings fall between the steps.
            assert!(worst < 0.03, "{step_s}: {worst}");
        }
    }

    /// The daemon was stopped, and the kernel kept what came: all of it, or the oldest of it.
    #[test]
    fn what_has_waited_is_as_old_as_it_is() {
        for (away_s, kept_s) in [(0.3, 0.3), (6.0, 6.0), (60.0, 20.0)] {
            // Handed over in no time, or as fast as a busy machine takes it.
            for pace_s in [1e-4, 5e-3] {
                let mut clock = DeviceClock::default();
                let mut free_s: f64 = 0.0;
                let mut worst: f64 = 0.0;
                for i in 1..6000u32 {
                    let true_s = f64::from(i) * 0.02;
                    let waits = (30.0..30.0 + away_s).contains(&true_s);
                    if waits && true_s > 30.0 + kept_s {
                        continue;
                    }
                    let ready_s = if waits { 30.0 + away_s } else { true_s };
                    free_s = (free_s + pace_s).max(ready_s);
                    let t_s = clock.time(1.002 * true_s + 7.0, free_s);
                    if true_s > 20.0 {
                        worst = worst.max((t_s - true_s).abs());
                    }
                }
                assert!(worst < 0.05, "{away_s} s, {pace_s} s each: {worst}");
            }
        }
    }
}
