//! How late readings come: a host that pauses stamps what has piled up when it wakes.
//!
//! A chip measures evenly. So a reading that comes a period and a half after the one before is half a period late, and
//! those that follow at once are still late by what is left of that. The last of such a burst was late by less than a period: otherwise
//! there would be one more. If nothing follows at once, nothing had piled up: readings were lost, and none is late.
//!
//! The adapter of a serial line may hold back part of a packet, so that even the last reading of a burst is late. If that happens often,
//! the least late reading of two windows is taken to be late by less than a period.

/// The period is the mean over this time, seconds.
const MEAN_S: f64 = 30.0;
/// Later than this is a gap, seconds.
const GAP_S: f64 = 0.1;
/// Readings that had piled up come closer together than this share of a period: a serial line is at most four fifths full.
const PILED: f64 = 0.8;
/// A step of more than this many periods is a pause, or readings were lost in it.
const LONG: f64 = 1.5;
/// Weight of each long step in the mean of `losses`: the mean of about five.
const LOSS_WEIGHT: f64 = 0.2;
/// Weight of each burst in `held_back` and `mean_burst_s`: the mean of about 30, a second or two.
const BURST_WEIGHT: f64 = 0.03;
/// An adapter holds readings back if more than this share of the bursts end late. With a simulated host that takes all that has come, lost
/// readings cause up to 15 %; with a recorder's adapter, 35 % or more seem to end late.
const HELD_BACK: f64 = 0.25;
/// Length of a window, seconds: two windows have two polls of up to 64 ms.
const WINDOW_S: f64 = 0.075;
/// The walk is the mean over this time, seconds.
const WALK_MEAN_S: f64 = 10.0;

/// Follows one chip's readings.
#[derive(Clone, Copy, Debug, Default)]
pub struct Lateness {
    last_s: Option<f64>,
    period_s: f64,
    /// How long readings have come, up to `MEAN_S`, and how many steps there were.
    seen_s: f64,
    count: f64,
    late_s: f64,
    /// Least lateness in the window that runs and in the one before, and for how long the first has run, seconds.
    least_s: f64,
    least_before_s: f64,
    window_s: f64,
    /// Duration of the current burst, seconds. A reading that came alone is a burst of 0 s.
    burst_s: f64,
    /// Whether the last step was long.
    long: bool,
    habits: Habits,
}

/// What is known of source and host, which a gap does not change.
#[derive(Clone, Copy, Debug, Default)]
struct Habits {
    /// Mean over long steps: 1 where readings were lost, -1 where the host paused.
    losses: f64,
    /// Share of the bursts whose last reading was late by more than a period.
    held_back: f64,
    /// Mean squared correction per second, s²/s.
    walk_s2: f64,
    /// Duration of the mean burst, seconds, and the number of bursts.
    mean_burst_s: f64,
    bursts: f64,
}

impl Lateness {
    /// Takes the time of a reading. How late it is, seconds, 0 to `GAP_S`.
    pub fn take(&mut self, t_s: f64) -> f64 {
        let Some(last_s) = self.last_s.replace(t_s) else {
            return 0.0;
        };
        let step_s = t_s - last_s;
        if !(0.0..=GAP_S).contains(&step_s) {
            // The number of readings in the gap is unknown, so the period is measured anew.
            *self = Self {
                last_s: Some(t_s),
                habits: self.habits,
                ..Self::default()
            };
            return 0.0;
        }
        self.seen_s = (self.seen_s + step_s).min(MEAN_S);
        // The same weight for each step, however long: their mean is the period.
        self.count += 1.0;
        let weight = (1.0 / self.count).max(self.period_s / MEAN_S);
        self.period_s += (step_s - self.period_s) * weight;
        if self.seen_s < GAP_S {
            return 0.0;
        }
        let piled = step_s < PILED * self.period_s;
        if self.long {
            let loss = if piled { -1.0 } else { 1.0 };
            self.habits.losses += (loss - self.habits.losses) * LOSS_WEIGHT;
        }
        self.long = step_s > LONG * self.period_s;
        self.measure_bursts(step_s, piled);
        let before_s = self.limit_lateness_s(step_s, piled);
        let corrected2 = (self.late_s - before_s).powi(2);
        self.habits.walk_s2 += (corrected2 - self.habits.walk_s2 * step_s) / WALK_MEAN_S;
        // A measured period that is too short would make lateness add up. So it is lengthened by the share that one step of `GAP_S` can
        // change it by.
        let forgiven = GAP_S / self.seen_s;
        let late_s = before_s + step_s - (1.0 + forgiven) * self.period_s;
        self.late_s = if self.habits.losses > 0.0 {
            0.0
        } else {
            late_s.clamp(0.0, GAP_S)
        };
        self.late_s
    }

    /// Delay of all readings that their times do not show, seconds: its mean and its deviation are half the duration of a burst. A host that
    /// reads until nothing is left adds none of it; one that reads what had arrived when it began adds the whole burst.
    pub fn unobservable_s(&self) -> f64 {
        0.5 * self.habits.mean_burst_s
    }

    fn measure_bursts(&mut self, step_s: f64, piled: bool) {
        if piled {
            self.burst_s += step_s;
            return;
        }
        self.habits.bursts += 1.0;
        let weight = (1.0 / self.habits.bursts).max(BURST_WEIGHT);
        self.habits.mean_burst_s += (self.burst_s - self.habits.mean_burst_s) * weight;
        self.burst_s = 0.0;
    }

    /// Variance that the corrections add to the times per second, s²/s. A lost reading shifts the times of those after it, until a
    /// correction shows by how much.
    pub fn walk_s2(&self) -> f64 {
        self.habits.walk_s2
    }

    /// Limits how late the reading before was, by the length of the step after it. Returns that lateness, seconds, and learns whether
    /// readings are held back.
    fn limit_lateness_s(&mut self, step_s: f64, piled: bool) -> f64 {
        let mut late_s = self.late_s;
        if !piled {
            let held_back = f64::from(late_s > self.period_s);
            self.habits.held_back += (held_back - self.habits.held_back) * BURST_WEIGHT;
            if self.habits.held_back < HELD_BACK {
                late_s = late_s.min(self.period_s);
            }
        }
        self.least_s = self.least_s.min(late_s);
        self.window_s += step_s;
        if self.window_s > WINDOW_S {
            let least_s = self.least_s.min(self.least_before_s);
            let beyond_s = (least_s - self.period_s).max(0.0);
            late_s -= beyond_s;
            self.least_before_s = self.least_s - beyond_s;
            (self.least_s, self.window_s) = (f64::INFINITY, 0.0);
        }
        late_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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

    /// A chip that measures every 10 ms, and a host that takes each reading at the time `taken_s` of its measurement, but 1.5 ms after
    /// the one before at the earliest. When each was measured and taken, seconds.
    fn readings(taken_s: impl Fn(f64) -> f64) -> impl Iterator<Item = (f64, f64)> {
        let mut last_s = 0.0_f64;
        (0..4000).map(move |i| {
            let measured_s = f64::from(i) * 0.01;
            last_s = taken_s(measured_s).max(last_s + 0.0015);
            (measured_s, last_s)
        })
    }

    /// How long after its measurement each counts as measured, once 10 s have passed.
    fn apart_s(taken_s: impl Fn(f64) -> f64) -> Vec<f64> {
        let mut lateness = Lateness::default();
        let all = readings(taken_s).map(|(measured_s, t_s)| t_s - lateness.take(t_s) - measured_s);
        all.skip(1001).collect()
    }

    /// When a host takes a reading that takes what has come every 64 ms.
    fn polled_s(measured_s: f64) -> f64 {
        (measured_s / 0.064).ceil() * 0.064
    }

    /// The same of a host that sleeps for 60 ms every second.
    fn paused_s(measured_s: f64) -> f64 {
        (measured_s.floor() + 0.06).max(measured_s)
    }

    #[test]
    fn what_has_piled_up_in_a_pause_is_as_late_as_it_is() {
        let apart_s = apart_s(paused_s);
        assert!(apart_s.iter().all(|apart_s| apart_s.abs() < 0.006));
    }

    #[test]
    fn readings_in_bursts_have_the_chips_times() {
        let apart_s = apart_s(polled_s);
        let (least_s, most_s) = (apart_s.iter())
            .fold((f64::MAX, f64::MIN), |(least, most), &one| {
                (least.min(one), most.max(one))
            });
        // A constant delay remains: the duration of a burst. It cannot be observed.
        assert!(least_s > 0.0 && most_s < 0.015, "{least_s} {most_s}");
        assert!(most_s - least_s < 0.004, "{least_s} {most_s}");
    }

    #[test]
    fn half_of_a_burst_is_in_doubt_where_readings_come_in_bursts() {
        fn unobservable_s(taken_s: impl Fn(f64) -> f64) -> f64 {
            let mut lateness = Lateness::default();
            for (_, t_s) in readings(taken_s) {
                lateness.take(t_s);
            }
            lateness.unobservable_s()
        }
        // Six or seven readings: five or six times 1.5 ms.
        let polled_s = unobservable_s(polled_s);
        assert!((0.003..0.005).contains(&polled_s), "{polled_s}");
        let paused_s = unobservable_s(paused_s);
        assert!(paused_s < 0.001, "{paused_s}");
        // At most 1 ms late.
        let punctual_s =
            unobservable_s(|measured_s| measured_s + 0.001 * (1000.0 * measured_s).sin().abs());
        assert_eq!(punctual_s, 0.0);
    }

    /// A chip that measures every 10 ms, and a host that polls an adapter every 32 ms, which holds back what has come in the last 15
    /// or 30 ms of two polls in three.
    #[test]
    fn one_reading_in_some_is_on_time_where_an_adapter_holds_them_back() {
        let apart_s = apart_s(|measured_s| {
            let mut poll = (measured_s / 0.032).ceil();
            while poll * 0.032 - 0.015 * (poll % 3.0) < measured_s {
                poll += 1.0;
            }
            poll * 0.032
        });
        let mean_s = apart_s.iter().sum::<f64>() / apart_s.len() as f64;
        let square = |apart_s: &f64| (apart_s - mean_s).powi(2);
        let sd_s = (apart_s.iter().map(square).sum::<f64>() / apart_s.len() as f64).sqrt();
        assert!(sd_s < 0.004, "{sd_s}");
    }

    /// Each reading that is lost shifts those after it, and it shows only later by how much.
    #[test]
    fn times_walk_where_readings_of_a_burst_are_lost() {
        let (mut whole, mut with_losses) = (Lateness::default(), Lateness::default());
        for (i, (_, t_s)) in readings(polled_s).enumerate() {
            whole.take(t_s);
            if i % 100 != 50 {
                with_losses.take(t_s);
            }
        }
        // A period a second at most.
        let walk_s2 = with_losses.walk_s2();
        assert!((3e-6..1.2e-4).contains(&walk_s2), "{walk_s2}");
        assert!(whole.walk_s2() < 1e-7, "{}", whole.walk_s2());
    }

    #[test]
    fn readings_of_one_time_are_late_by_no_more_than_a_burst() {
        let mut lateness = Lateness::default();
        for i in 0..100 {
            let late_s = lateness.take(0.1 * f64::from(i / 10));
            assert!((0.0..=0.1).contains(&late_s), "{late_s}");
        }
    }

    #[test]
    fn even_readings_are_on_time_and_so_is_what_follows_a_gap() {
        let mut lateness = Lateness::default();
        for i in 0..500 {
            assert!(lateness.take(f64::from(i) * 0.02) < 1e-3);
        }
        for i in 0..50 {
            assert!(lateness.take(20.0 + f64::from(i) * 0.02) < 1e-3);
        }
    }
}
