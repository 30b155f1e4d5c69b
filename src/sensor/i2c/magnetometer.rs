//! The magnetometer's timetable: when a measurement is started, and when its result is read.

use super::auto_range::AutoRange;
use super::health::Health;
use super::settings::{STEADY_HZ, Settings};
use crate::sensor::bus::Bus;
use crate::sensor::chip::drivers::identify;
use crate::sensor::chip::magnetometer::{
    ChipSetup, Magnetometer, Measurement, MeasuringMode, change, start, verify,
};
use crate::sensor::chip::{ChipError, FROZEN_AFTER, RepeatWatch};
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

pub(super) struct MagnetometerPoller {
    pub(super) health: Health,
    named: Option<&'static dyn Magnetometer>,
    rate_hz: f64,
    gain: Option<u8>,
    /// The chip that the log has been told of.
    told: Option<&'static str>,
    at_work: Option<AtWork>,
    /// Kept when the chip is set up again: a frozen one may still be.
    memory: Memory,
}

#[derive(Default)]
struct Memory {
    last: Option<[i16; 3]>,
    repeats: RepeatWatch<[i16; 3]>,
    /// Whether two measurements differed.
    has_measured: bool,
}

struct AtWork {
    chip: &'static dyn Magnetometer,
    setup: ChipSetup,
    range: AutoRange,
    /// The next measurement was started with the gain before.
    outdated: bool,
    period_s: f64,
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

impl MagnetometerPoller {
    pub(super) fn new(settings: &Settings) -> Self {
        Self {
            health: Health::new("magnetometer"),
            named: settings.magnetometer.named(),
            rate_hz: settings.rate_hz,
            gain: settings.gain,
            told: None,
            at_work: None,
            memory: Memory::default(),
        }
    }

    /// When the next thing is to be done.
    pub(super) fn due_s(&self) -> f64 {
        let at_work = self.at_work.as_ref();
        let due_s = || at_work.map_or(f64::INFINITY, |at_work| at_work.due_s);
        self.health.set_up_at_s().unwrap_or_else(due_s)
    }

    /// Sets the chip up or reads it, if that is due; a measurement with its time if there is one to publish.
    pub(super) fn poll(
        &mut self,
        bus: &mut dyn Bus,
        clock: &mut dyn Clock,
    ) -> Result<Option<(f64, Measurement)>, ChipError> {
        if self.due_s() > clock.now_s() {
            return Ok(None);
        }
        if self.health.set_up_at_s().is_some() {
            self.start(bus, clock)?;
            self.health.set_up();
        }
        let now_s = clock.now_s();
        if self.due_s() > now_s {
            return Ok(None);
        }
        let measured = self.step(bus, now_s)?;
        if let Some((t_s, _)) = measured {
            self.health.worked(t_s);
        }
        Ok(measured)
    }

    /// Tells which chip it is, and sets it up.
    fn start(&mut self, bus: &mut dyn Bus, clock: &mut dyn Clock) -> Result<(), ChipError> {
        self.at_work = None;
        let found = identify(bus, clock, self.named)?;
        let chip = found.chip;
        let sheet = chip.sheet();
        let single = sheet.single_s.filter(|_| self.rate_hz == STEADY_HZ);
        let (mode, rate_hz) = if single.is_some() {
            (MeasuringMode::Single, STEADY_HZ)
        } else {
            let code = sheet.rate_code(self.rate_hz);
            (
                MeasuringMode::Continuous(code),
                sheet.rates_hz[usize::from(code)],
            )
        };
        let range = AutoRange::new(sheet, self.gain);
        let setup = ChipSetup {
            mode,
            gain: range.code(),
        };
        start(bus, chip, setup)?;
        if self.told != Some(sheet.name) {
            self.told = Some(sheet.name);
            let probably = if found.sure { "" } else { "probably " };
            tracing::info!(
                "magnetometer: {probably}{}: {}; {rate_hz} readings a second",
                sheet.name,
                found.why
            );
        }
        let now_s = clock.now_s();
        let period_s = 1.0 / rate_hz;
        self.at_work = Some(AtWork {
            chip,
            setup,
            range,
            outdated: true,
            period_s,
            // After a configuration the first measurement takes two periods.
            due_s: if single.is_none() {
                now_s + 2.0 * period_s
            } else {
                now_s
            },
            measuring_since_s: single.is_none().then_some(now_s + period_s),
            slot_s: now_s,
            // A chip whose clock is fast is not to run away before that is learnt.
            patience_s: single.unwrap_or(FAST * period_s),
            looked: false,
            at_once: 0,
            was_ready: false,
            verify_s: now_s + VERIFY_S,
        });
        Ok(())
    }

    /// Does what is due, and gives a measurement with its time if there is one to publish.
    fn step(
        &mut self,
        bus: &mut dyn Bus,
        now_s: f64,
    ) -> Result<Option<(f64, Measurement)>, ChipError> {
        let Some(at_work) = &mut self.at_work else {
            return Ok(None);
        };
        let stepped = at_work.step(bus, now_s, &mut self.memory);
        if stepped.is_err() && at_work.due_s <= now_s {
            // It is tried again with the next measurement.
            at_work.due_s = now_s + at_work.period_s;
            if at_work.setup.mode == MeasuringMode::Single {
                at_work.measuring_since_s = None;
                at_work.slot_s = at_work.due_s;
            }
        }
        stepped.map_err(|error| match error {
            ChipError::NotReady { .. } | ChipError::Frozen { .. } if !self.memory.has_measured => {
                at_work.chip.imitation().unwrap_or(error)
            }
            error => error,
        })
    }
}

impl AtWork {
    fn step(
        &mut self,
        bus: &mut dyn Bus,
        now_s: f64,
        memory: &mut Memory,
    ) -> Result<Option<(f64, Measurement)>, ChipError> {
        let Some(since_s) = self.measuring_since_s else {
            self.verify(bus, now_s)?;
            self.chip.trigger(bus)?;
            self.measuring_since_s = Some(now_s);
            self.due_s = now_s + self.patience_s;
            return Ok(None);
        };
        let raw = self.chip.poll(bus)?;
        self.was_ready |= raw.is_some();
        let sheet = self.chip.sheet();
        match raw.map(|raw| Measurement::new(sheet, self.setup.gain, raw)) {
            Some(sample) if self.is_new(&sample, memory, now_s - since_s) => {
                memory.has_measured |= memory.last.is_some_and(|last| last != sample.raw);
                memory.last = Some(sample.raw);
                self.schedule(now_s);
                let sample = self.take(bus, now_s, sample, memory)?;
                if self.setup.mode != MeasuringMode::Single {
                    self.verify(bus, now_s)?;
                }
                Ok(sample.map(|sample| (now_s, sample)))
            }
            _ => {
                self.looked = true;
                self.due_s = now_s + self.look_s();
                let late = self.late(now_s - since_s);
                if late.is_err() {
                    // A chip that has lost its configuration does not measure, either.
                    verify(bus, self.chip, self.setup)?;
                }
                late.map(|()| None)
            }
        }
    }

    /// RDY need not fall when the data are read or a measurement begins (the data sheet has it low for 250 µs
    /// alone), so noise tells a new measurement from the one before. A single one that looks the same is new once
    /// the longest time that it may take is over.
    fn is_new(&self, sample: &Measurement, memory: &Memory, waited_s: f64) -> bool {
        memory.last != Some(sample.raw)
            || match self.single_s() {
                Some(longest_s) => waited_s >= longest_s,
                None => sample.overflowed(),
            }
    }

    /// The longest that a single measurement takes, while the chip makes those.
    fn single_s(&self) -> Option<f64> {
        let single = self.setup.mode == MeasuringMode::Single;
        self.chip.sheet().single_s.filter(|_| single)
    }

    fn look_s(&self) -> f64 {
        match self.setup.mode {
            MeasuringMode::Single => LOOK_S,
            MeasuringMode::Continuous(_) => LOOK_S.max(self.period_s / 20.0),
        }
    }

    /// When the next thing is to be done after a measurement that was read now.
    fn schedule(&mut self, now_s: f64) {
        self.learn();
        match self.setup.mode {
            MeasuringMode::Single => {
                self.measuring_since_s = None;
                self.slot_s += self.period_s;
                if now_s > self.slot_s + self.period_s {
                    self.slot_s = now_s;
                }
                self.due_s = self.slot_s;
            }
            MeasuringMode::Continuous(_) => {
                // Counted from when it was due, in whole steps: the chip does not wait for a board that is late.
                let since_s = now_s - (now_s - self.due_s) % self.patience_s;
                self.measuring_since_s = Some(since_s);
                self.due_s = since_s + self.patience_s;
            }
        }
        self.was_ready = false;
    }

    /// Adaptive poll delay: shortens until a poll is early, then backs off slightly. A measurement that is ready at the
    /// first poll may have been so for long; an early poll costs a wake-up, and so must be rare: after many steps the
    /// delay is well known, and the step back is small.
    fn learn(&mut self) {
        let steps = f64::from(self.at_once);
        let looks = if self.looked {
            self.at_once = 0;
            0.5 / (2.0 + steps)
        } else {
            self.at_once = self.at_once.saturating_add(1);
            -(2e-5 * steps * steps).min(0.1)
        };
        let (least_s, most_s) = match self.single_s() {
            Some(longest_s) => (LOOK_S, longest_s),
            None => (FAST * self.period_s, SLOW * self.period_s),
        };
        self.patience_s = (self.patience_s + looks * self.look_s()).clamp(least_s, most_s);
        self.looked = false;
    }

    fn take(
        &mut self,
        bus: &mut dyn Bus,
        now_s: f64,
        sample: Measurement,
        memory: &mut Memory,
    ) -> Result<Option<Measurement>, ChipError> {
        if std::mem::take(&mut self.outdated) {
            return Ok(None);
        }
        if !sample.overflowed() {
            memory.repeats.take(self.chip.sheet().name, sample.raw)?;
        }
        let Some(gain) = self.range.take(now_s, &sample) else {
            return Ok(Some(sample));
        };
        let setup = ChipSetup { gain, ..self.setup };
        change(bus, self.chip, self.setup, setup)?;
        self.setup = setup;
        self.outdated = true;
        let range_gauss = self.chip.sheet().gain(gain).range_gauss;
        tracing::info!("the magnetometer's range is now {range_gauss} gauss either way");
        Ok((!sample.overflowed()).then_some(sample))
    }

    fn late(&self, waited_s: f64) -> Result<(), ChipError> {
        let chip = self.chip.sheet().name;
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
        verify(bus, self.chip, self.setup)
    }
}
