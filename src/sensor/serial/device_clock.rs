//! Times for readings of a device that sends its own: its clock is brought in line with ours.

use super::envelope::Envelope;

/// How far the device's clock may be fast or slow, as a share: a ceramic resonator is off by up to 0.5 %.
const TOLERANCE: f64 = 0.05;
/// Off by more, seconds, the device has begun anew, or its clock has overflowed.
const JUMP_S: f64 = 1.0;

/// Device times and arrivals in, times out.
#[derive(Clone, Debug)]
pub struct DeviceClock {
    envelope: Envelope,
    last_device_s: f64,
    last_s: f64,
}

impl Default for DeviceClock {
    fn default() -> Self {
        Self {
            envelope: Envelope::new(TOLERANCE),
            last_device_s: f64::NEG_INFINITY,
            last_s: f64::NEG_INFINITY,
        }
    }
}

impl DeviceClock {
    /// The time of a reading, seconds on the clock of the arrivals. Times never decrease, and are never later
    /// than the arrival.
    pub fn time(&mut self, device_s: f64, arrival_s: f64) -> f64 {
        let line_s = self.envelope.time(device_s);
        if device_s < self.last_device_s
            || line_s.is_some_and(|line_s| (arrival_s - line_s).abs() > JUMP_S)
        {
            self.envelope.restart();
        }
        self.last_device_s = device_s;
        self.envelope.take(device_s, arrival_s);
        let line_s = self.envelope.time(device_s).unwrap_or(arrival_s);
        self.last_s = line_s.min(arrival_s).max(self.last_s);
        self.last_s
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
}
