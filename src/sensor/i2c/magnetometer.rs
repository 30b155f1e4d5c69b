//! Sets up, reads and watches the magnetometer.

use super::VERIFY_S;
use super::auto_range::AutoRange;
use super::health::Health;
use super::settings::{STEADY_HZ, Settings};
use super::timetable::{SLOW, Timetable};
use crate::sensor::bus::Bus;
use crate::sensor::chip::drivers::identify;
use crate::sensor::chip::magnetometer::{ChipSetup, Magnetometer, Measurement, MeasuringMode};
use crate::sensor::chip::{ChipError, FROZEN_AFTER, RepeatWatch};
use crate::sensor::clock::Clock;

/// A measurement may be late by this many periods.
const LATE_PERIODS: f64 = 5.0;

pub(super) struct MagnetometerPoller {
    pub(super) health: Health,
    named: Option<&'static dyn Magnetometer>,
    rate_hz: f64,
    gain: Option<u8>,
    /// The chip that the log has been told of.
    told: Option<&'static str>,
    at_work: Option<AtWork>,
    /// Survives a reinitialisation: a frozen chip may stay frozen.
    memory: Memory,
}

#[derive(Default)]
struct Memory {
    last: Option<[i16; 3]>,
    repeats: RepeatWatch<[i16; 3]>,
    /// A chip that has given two different measurements. It is not identified again: frozen or slow, it would be taken for
    /// another one.
    known: Option<&'static dyn Magnetometer>,
}

struct AtWork {
    chip: &'static dyn Magnetometer,
    setup: ChipSetup,
    /// Without it the gain is fixed.
    range: Option<AutoRange>,
    /// Discard the next measurement: it still has the previous gain.
    discard_next: bool,
    times: Timetable,
    was_ready: bool,
    verify_s: f64,
}

impl MagnetometerPoller {
    pub(super) fn new(settings: &Settings) -> Self {
        Self {
            health: Health::new("magnetometer", true),
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
        let measuring_s = self.at_work.as_ref().map(|at_work| at_work.times.due_s);
        let due_s = self.health.set_up_at_s.or(measuring_s);
        due_s.unwrap_or(f64::INFINITY)
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
        if self.health.set_up_at_s.is_some() {
            self.start(bus, clock)?;
            self.health.set_up();
        }
        let now_s = clock.now_s();
        let at_work = self.at_work.as_mut();
        let Some(at_work) = at_work.filter(|at_work| at_work.times.due_s <= now_s) else {
            return Ok(None);
        };
        let stepped = at_work.step(bus, now_s, &mut self.memory);
        if stepped.is_err() && at_work.times.due_s <= now_s {
            at_work.times.failed(now_s);
        }
        let measured = stepped.map_err(|error| match error {
            ChipError::NotReady { .. } | ChipError::Frozen { .. }
                if self.memory.known.is_none() =>
            {
                at_work.chip.imitation().unwrap_or(error)
            }
            error => error,
        })?;
        if let Some((t_s, _)) = measured {
            self.health.worked(t_s);
        }
        Ok(measured)
    }

    /// Tells which chip it is, and sets it up.
    fn start(&mut self, bus: &mut dyn Bus, clock: &mut dyn Clock) -> Result<(), ChipError> {
        self.at_work = None;
        let known = self.named.or(self.memory.known);
        let found = identify(bus, clock, known).inspect_err(|error| {
            // There may be another chip now.
            if error.is_no_answer() || !matches!(error, ChipError::Bus(_)) {
                self.memory.known = None;
            }
        })?;
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
        let gain = self.gain.unwrap_or(sheet.automatic_gains.0);
        let coarsest = sheet.gains.len() as u8 - 1;
        let setup = ChipSetup {
            mode,
            gain: gain.min(coarsest),
        };
        chip.start(bus, setup)?;
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
        self.at_work = Some(AtWork {
            chip,
            setup,
            range: self.gain.is_none().then(AutoRange::default),
            discard_next: true,
            times: Timetable::new(now_s, 1.0 / rate_hz, single),
            was_ready: false,
            verify_s: now_s + VERIFY_S,
        });
        Ok(())
    }
}

impl AtWork {
    /// Does what is due, and gives a measurement with its time if there is one to publish.
    fn step(
        &mut self,
        bus: &mut dyn Bus,
        now_s: f64,
        memory: &mut Memory,
    ) -> Result<Option<(f64, Measurement)>, ChipError> {
        let Some(since_s) = self.times.measuring_since_s else {
            self.verify(bus, now_s)?;
            self.chip.trigger(bus)?;
            self.times.started(now_s);
            return Ok(None);
        };
        let waited_s = now_s - since_s;
        let raw = self.chip.poll(bus)?;
        self.was_ready |= raw.is_some();
        let sample = raw.map(|raw| Measurement::new(self.chip.sheet(), self.setup.gain, raw));
        let Some(sample) = sample.filter(|sample| self.is_new(sample, memory, waited_s)) else {
            self.times.looked_in_vain(now_s);
            let late = self.late(waited_s);
            if late.is_err() {
                // A chip that has lost its configuration does not measure, either.
                self.chip.verify(bus, self.setup)?;
            }
            return late.map(|()| None);
        };
        let last = memory.last.replace(sample.raw);
        if last.is_some_and(|last| last != sample.raw) {
            memory.known = Some(self.chip);
        }
        self.times.measured(now_s);
        self.was_ready = false;
        let sample = self.take(bus, now_s, sample, memory)?;
        if self.times.single_s.is_none() {
            self.verify(bus, now_s)?;
        }
        Ok(sample.map(|sample| (now_s, sample)))
    }

    /// Whether this is a new measurement. RDY need not fall when the data are read or a measurement begins (the data sheet has it low for
    /// 250 µs), so equal counts are taken for the measurement before: noise makes two differ. Two exceptions: (1) a single measurement is
    /// new once the longest time for one has passed; (2) an overflow has no noise, so an equal one is new, but while a measurement is to
    /// be discarded only after a slow chip's period: else the one before would be discarded in place of the one of the old gain.
    fn is_new(&self, sample: &Measurement, memory: &Memory, waited_s: f64) -> bool {
        memory.last != Some(sample.raw)
            || match self.times.single_s {
                Some(longest_s) => waited_s >= longest_s,
                None => {
                    let slowest_s = SLOW * self.times.period_s;
                    sample.overflowed() && (!self.discard_next || waited_s >= slowest_s)
                }
            }
    }

    fn take(
        &mut self,
        bus: &mut dyn Bus,
        now_s: f64,
        sample: Measurement,
        memory: &mut Memory,
    ) -> Result<Option<Measurement>, ChipError> {
        if std::mem::take(&mut self.discard_next) {
            return Ok(None);
        }
        if !sample.overflowed() {
            memory.repeats.take(self.chip.sheet().name, sample.raw)?;
        }
        let (sheet, range) = (self.chip.sheet(), self.range.as_mut());
        let gain = range.and_then(|range| range.take(sheet, self.setup.gain, now_s, &sample));
        let Some(gain) = gain else {
            return Ok(Some(sample));
        };
        let setup = ChipSetup { gain, ..self.setup };
        // If this fails, only the registers tell which gain the chip has.
        (self.discard_next, self.verify_s) = (true, now_s);
        self.chip.change(bus, self.setup, setup)?;
        self.setup = setup;
        let range_gauss = f64::from(sheet.counts.1) / sheet.gain(gain);
        tracing::info!("the magnetometer's range is now {range_gauss:.1} gauss either way");
        Ok((!sample.overflowed()).then_some(sample))
    }

    fn late(&self, waited_s: f64) -> Result<(), ChipError> {
        let chip = self.chip.sheet().name;
        if self.was_ready && waited_s > f64::from(FROZEN_AFTER) * self.times.period_s {
            return Err(ChipError::Frozen {
                chip,
                count: FROZEN_AFTER,
            });
        }
        if !self.was_ready && waited_s > LATE_PERIODS * self.times.period_s {
            return Err(ChipError::NotReady { chip, waited_s });
        }
        Ok(())
    }

    fn verify(&mut self, bus: &mut dyn Bus, now_s: f64) -> Result<(), ChipError> {
        if now_s < self.verify_s {
            return Ok(());
        }
        self.chip.verify(bus, self.setup)?;
        self.verify_s = now_s + VERIFY_S;
        Ok(())
    }
}
