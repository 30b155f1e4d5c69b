//! Times for frames of a device that sends none, but sends them evenly.
//!
//! Frames are counted, and their times are those of an even clock fitted beneath their arrivals. A late
//! frame was delayed; sustained lateness means that frames were lost: the count then skips their number.

use super::envelope::Envelope;

/// The Razor's loop (`OUTPUT__DATA_INTERVAL`), seconds.
const RAZOR_PERIOD_S: f64 = 0.02;
/// How far the device's period may be off from what it is taken for, as a share.
const TOLERANCE: f64 = 0.1;
/// Longest delay of a frame while the port is read, seconds. One that comes later means that frames were lost.
const LONGEST_DELAY_S: f64 = 0.5;
/// Arrivals all late by more than this share of a period mean that frames were lost.
const LATE_SHARE: f64 = 0.6;
/// For this long, seconds, and at least this many.
const LATE_S: f64 = 0.3;
const LATE_FRAMES: u32 = 8;
/// Frames that come nearer by more than this share of a period are catching up.
const LATE_STEP_SHARE: f64 = 1.5;
/// The device's rate is counted over this long, seconds.
const RATE_S: f64 = 2.0;
/// A rate off by more than this share, twice, is another rate.
const RATE_SHARE: f64 = 0.15;

/// Arrivals in, times out.
#[derive(Clone, Debug)]
pub struct SteadyClock {
    period_s: f64,
    envelope: Envelope,
    count: u64,
    lost: u64,
    last_s: f64,
    /// The port was not read for a while: arriving frames may be old.
    away: bool,
    rate: Option<Rate>,
}

#[derive(Clone, Debug)]
struct Rate {
    since_s: f64,
    frames: u32,
    /// The period counted before, if it was not ours.
    other_s: Option<f64>,
}

impl Default for SteadyClock {
    fn default() -> Self {
        Self {
            period_s: RAZOR_PERIOD_S,
            envelope: Envelope::new(TOLERANCE, LATE_STEP_SHARE * RAZOR_PERIOD_S),
            count: 0,
            lost: 0,
            last_s: f64::NEG_INFINITY,
            away: false,
            rate: None,
        }
    }
}

impl SteadyClock {
    /// The time of the frame that has arrived, seconds on the clock of the arrivals. Times never decrease, and
    /// are never later than the arrival.
    pub fn time(&mut self, arrival_s: f64) -> f64 {
        // Buffered frames arrive faster than they were sent.
        if self.away {
            self.rate = None;
        } else {
            self.count_rate(arrival_s);
        }
        self.count += 1;
        let late_s = self.envelope.late_s(self.device_s(), arrival_s);
        if late_s > LONGEST_DELAY_S && !self.away {
            self.lost += (late_s / self.period_s) as u64;
            self.envelope.restart();
        } else if late_s > LATE_SHARE * self.period_s && (self.envelope.learnt || self.away) {
            let steady = self.envelope.late(late_s, arrival_s);
            if steady.arrivals >= LATE_FRAMES && steady.lasts_s >= LATE_S {
                let lost = (steady.least_s / self.period_s).round().max(1.0) as u64;
                self.count += lost;
                self.lost += lost;
                self.envelope.in_time();
                self.away = false;
            }
        } else {
            self.envelope.in_time();
            self.away = false;
        }
        let t_s = self.envelope.time(self.device_s(), arrival_s);
        self.last_s = t_s.max(self.last_s);
        self.last_s
    }

    /// The port was not read for a while. Until the buffered frames are through, a frame's age follows from its count.
    pub fn resume(&mut self) {
        self.away = true;
    }

    /// How many frames were lost, as far as the gaps tell.
    pub fn lost(&self) -> u64 {
        self.lost
    }

    fn device_s(&self) -> f64 {
        self.count as f64 * self.period_s
    }

    /// A device may have another rate than it is taken for.
    fn count_rate(&mut self, arrival_s: f64) {
        let rate = self.rate.get_or_insert(Rate {
            since_s: arrival_s,
            frames: 0,
            other_s: None,
        });
        let span_s = arrival_s - rate.since_s;
        if span_s >= RATE_S {
            let counted_s = span_s / f64::from(rate.frames.max(1));
            let off = |from_s: f64| (counted_s / from_s - 1.0).abs() > RATE_SHARE;
            // A pause is no rate.
            let plain = span_s < 2.0 * RATE_S && rate.frames >= LATE_FRAMES;
            let other_s = (plain && off(self.period_s)).then_some(counted_s);
            if let (Some(period_s), Some(before_s)) = (other_s, rate.other_s)
                && !off(before_s)
            {
                self.period_s = period_s;
                self.envelope = Envelope::new(TOLERANCE, LATE_STEP_SHARE * period_s);
            }
            self.rate = Some(Rate {
                since_s: arrival_s,
                frames: 1,
                other_s,
            });
        } else {
            rate.frames += 1;
        }
    }
}
