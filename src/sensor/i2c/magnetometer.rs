//! The magnetometer's time table: when it is told to measure, and when it is looked at.

use super::settings::{STEADY_HZ, Settings};
use crate::sensor::bus::Bus;
use crate::sensor::chip::hmc5843::{Hmc5843, Kind, Pace, Range, Sample, identify};
use crate::sensor::chip::{ChipError, FROZEN_AFTER, FrozenWatch};
use crate::sensor::clock::Clock;

/// A chip that is not ready when it should be is looked at again after this, seconds.
const LOOK_S: f64 = 0.002;
/// It may be late by this many periods.
const LATE_PERIODS: f64 = 5.0;
/// How often its configuration is read back, seconds.
const VERIFY_S: f64 = 1.0;
/// Its own clock may be this much faster or slower than it should be.
const FAST: f64 = 0.9;
const SLOW: f64 = 1.1;

/// The magnetometer at work.
pub(super) struct Magnetometer {
    named: Option<Kind>,
    rate_hz: f64,
    gain: Option<u8>,
    told: Option<Kind>,
    at_work: Option<AtWork>,
    /// What it said last: kept when it is set up anew, since a frozen chip may well still be.
    memory: Memory,
}

#[derive(Default)]
struct Memory {
    last: Option<[i16; 3]>,
    frozen: FrozenWatch<[i16; 3]>,
}

struct AtWork {
    chip: Hmc5843,
    range: Range,
    period_s: f64,
    /// When to do the next thing.
    due_s: f64,
    /// When the measurement that is waited for began: as a single one, or after the last one.
    measuring_since_s: Option<f64>,
    /// When the last single measurement was to begin.
    slot_s: f64,
    /// How long after the beginning of a measurement it is looked for: as learnt.
    patience_s: f64,
    looked: bool,
    /// So many in a row were found at the first look.
    at_once: u32,
    was_ready: bool,
    verify_s: f64,
}

impl Magnetometer {
    pub(super) fn new(settings: &Settings) -> Self {
        Self {
            named: settings.magnetometer.kind(),
            rate_hz: settings.rate_hz,
            gain: settings.gain,
            told: None,
            at_work: None,
            memory: Memory::default(),
        }
    }

    /// When something is to be done, if the chip is set up.
    pub(super) fn due_s(&self) -> f64 {
        self.at_work
            .as_ref()
            .map_or(f64::INFINITY, |at_work| at_work.due_s)
    }

    /// Tells which chip it is, and sets it up.
    pub(super) fn start(
        &mut self,
        bus: &mut dyn Bus,
        clock: &mut dyn Clock,
    ) -> Result<(), ChipError> {
        self.at_work = None;
        let found = identify(bus, clock, self.named)?;
        let kind = found.kind;
        let (pace, rate_hz) = if self.rate_hz == STEADY_HZ {
            (Pace::Single, STEADY_HZ)
        } else {
            let code = kind.rate_code(self.rate_hz);
            (Pace::Continuous(code), kind.rates_hz()[usize::from(code)])
        };
        let range = Range::new(kind, self.gain);
        let chip = Hmc5843::start(bus, kind, pace, range.code())?;
        if self.told != Some(kind) {
            self.told = Some(kind);
            let surely = if found.sure { "is" } else { "is probably" };
            tracing::info!(
                "the magnetometer {surely} an {}: {}; {rate_hz} readings a second",
                kind.name(),
                found.why
            );
        }
        let now_s = clock.now_s();
        let period_s = 1.0 / rate_hz;
        let continuous = pace != Pace::Single;
        self.at_work = Some(AtWork {
            chip,
            range,
            period_s,
            // After a configuration the first measurement takes two periods.
            due_s: if continuous {
                now_s + 2.0 * period_s
            } else {
                now_s
            },
            measuring_since_s: continuous.then_some(now_s + period_s),
            slot_s: now_s,
            // A chip whose clock is fast is not to run away before that is learnt.
            patience_s: if continuous {
                FAST * period_s
            } else {
                kind.conversion_s()
            },
            looked: false,
            at_once: 0,
            was_ready: false,
            verify_s: now_s + VERIFY_S,
        });
        Ok(())
    }

    /// Does what is due, and gives a measurement with its time if there is one to publish.
    pub(super) fn step(
        &mut self,
        bus: &mut dyn Bus,
        now_s: f64,
    ) -> Result<Option<(f64, Sample)>, ChipError> {
        let Some(at_work) = &mut self.at_work else {
            return Ok(None);
        };
        let stepped = at_work.step(bus, now_s, &mut self.memory);
        if stepped.is_err() && at_work.due_s <= now_s {
            // It is tried again with the next measurement.
            at_work.due_s = now_s + at_work.period_s;
            if at_work.chip.pace() == Pace::Single {
                at_work.measuring_since_s = None;
                at_work.slot_s = at_work.due_s;
            }
        }
        stepped
    }
}

impl AtWork {
    fn step(
        &mut self,
        bus: &mut dyn Bus,
        now_s: f64,
        memory: &mut Memory,
    ) -> Result<Option<(f64, Sample)>, ChipError> {
        let Some(since_s) = self.measuring_since_s else {
            self.verify(bus, now_s)?;
            self.chip.trigger(bus)?;
            self.measuring_since_s = Some(now_s);
            self.due_s = now_s + self.patience_s;
            return Ok(None);
        };
        let sample = self.chip.poll(bus)?;
        self.was_ready |= sample.is_some();
        match sample {
            Some(sample) if self.is_new(&sample, memory, now_s - since_s) => {
                memory.last = Some(sample.raw);
                self.schedule(now_s);
                let sample = self.take(bus, now_s, sample, memory)?;
                if self.chip.pace() != Pace::Single {
                    self.verify(bus, now_s)?;
                }
                Ok(sample.map(|sample| (now_s, sample)))
            }
            _ => {
                self.looked = true;
                self.due_s = now_s + self.look_s();
                self.late(now_s - since_s)?;
                Ok(None)
            }
        }
    }

    /// RDY need not fall when the data are read or a measurement begins (the data sheet has it low for 250 µs
    /// alone), so noise tells a new measurement from the one before. A single one that looks the same is new once
    /// the longest time that it may take is over.
    fn is_new(&self, sample: &Sample, memory: &Memory, waited_s: f64) -> bool {
        memory.last != Some(sample.raw)
            || match self.chip.pace() {
                Pace::Single => waited_s >= self.chip.kind().conversion_s(),
                Pace::Continuous(_) => sample.overflowed(),
            }
    }

    fn look_s(&self) -> f64 {
        match self.chip.pace() {
            Pace::Single => LOOK_S,
            Pace::Continuous(_) => LOOK_S.max(self.period_s / 20.0),
        }
    }

    /// When the next thing is to be done after a measurement that was read now.
    fn schedule(&mut self, now_s: f64) {
        self.learn();
        match self.chip.pace() {
            Pace::Single => {
                self.measuring_since_s = None;
                self.slot_s += self.period_s;
                if now_s > self.slot_s + self.period_s {
                    self.slot_s = now_s;
                }
                self.due_s = self.slot_s;
            }
            Pace::Continuous(_) => {
                // Counted from when it was due, in whole steps: the chip does not wait for a board that is late.
                let since_s = now_s - (now_s - self.due_s) % self.patience_s;
                self.measuring_since_s = Some(since_s);
                self.due_s = since_s + self.patience_s;
            }
        }
        self.was_ready = false;
    }

    /// Learns how long to wait. A measurement found at the first look may have been there for long: each time the next
    /// one is looked for a bit earlier, until one is not there yet. That look in vain costs a wake-up, and so is to be
    /// rare: whoever came down to it in many steps knows the time well, and goes back by little.
    fn learn(&mut self) {
        let steps = f64::from(self.at_once);
        let looks = if self.looked {
            self.at_once = 0;
            0.5 / (2.0 + steps)
        } else {
            self.at_once = self.at_once.saturating_add(1);
            -(2e-5 * steps * steps).min(0.1)
        };
        let (least_s, most_s) = match self.chip.pace() {
            Pace::Single => (LOOK_S, self.chip.kind().conversion_s()),
            Pace::Continuous(_) => (FAST * self.period_s, SLOW * self.period_s),
        };
        self.patience_s = (self.patience_s + looks * self.look_s()).clamp(least_s, most_s);
        self.looked = false;
    }

    fn take(
        &mut self,
        bus: &mut dyn Bus,
        now_s: f64,
        sample: Sample,
        memory: &mut Memory,
    ) -> Result<Option<Sample>, ChipError> {
        if self.chip.is_outdated() {
            return Ok(None);
        }
        if !sample.overflowed() {
            memory.frozen.take(self.chip.kind().name(), sample.raw)?;
        }
        let Some(gain) = self.range.take(now_s, &sample) else {
            return Ok(Some(sample));
        };
        self.chip.set_gain(bus, gain)?;
        let range_gauss = self.chip.kind().gains()[usize::from(gain)].range_gauss;
        tracing::info!("the magnetometer's range is now {range_gauss} gauss either way");
        Ok((!sample.overflowed()).then_some(sample))
    }

    fn late(&self, waited_s: f64) -> Result<(), ChipError> {
        let chip = self.chip.kind().name();
        if self.was_ready && waited_s > f64::from(FROZEN_AFTER) * self.period_s {
            return Err(ChipError::Frozen {
                chip,
                count: FROZEN_AFTER,
            });
        }
        if !self.was_ready && waited_s > LATE_PERIODS * self.period_s {
            return Err(ChipError::NotReady { chip, waited_s });
        }
        Ok(())
    }

    fn verify(&mut self, bus: &mut dyn Bus, now_s: f64) -> Result<(), ChipError> {
        if now_s < self.verify_s {
            return Ok(());
        }
        self.verify_s = now_s + VERIFY_S;
        self.chip.verify(bus)
    }
}
