//! What all magnetometers have in common: numbers of a data sheet, registers that are set up and read back, a
//! measurement, and a self-test where the chip has one.

use super::{ChipError, compare, write_all};
use crate::reading::Field;
use crate::sensor::bus::Bus;
use crate::sensor::clock::Clock;

#[derive(Debug, PartialEq)]
pub struct DataSheet {
    /// The name that is printed on the chip. In small letters it is the word in the configuration, in logs and in kept
    /// calibrations.
    pub name: &'static str,
    pub address: u8,
    /// The rates of continuous measurement, Hz, by code, rising.
    pub rates_hz: &'static [f64],
    /// The gains, counts per gauss, by code, finest first.
    pub gains: &'static [f64],
    /// The codes of the finest and the coarsest gain that are chosen automatically.
    pub automatic_gains: (u8, u8),
    /// The smallest and the largest count of a measurement; any other is an overflow of its axis.
    pub counts: (i16, i16),
    /// The longest that a single measurement takes, seconds; `None` for a chip that measures continuously only.
    pub single_s: Option<f64>,
}

impl DataSheet {
    /// The code of the smallest rate ≥ `rate_hz`, else of the fastest.
    pub fn rate_code(&self, rate_hz: f64) -> u8 {
        let slower = self.rates_hz.partition_point(|rate| *rate < rate_hz);
        slower.min(self.rates_hz.len() - 1) as u8
    }

    /// The counts per gauss of a code that the chip has.
    pub fn gain(&self, code: u8) -> f64 {
        self.gains[usize::from(code)]
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeasuringMode {
    /// On each trigger.
    Single,
    /// By itself, with this rate code.
    Continuous(u8),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ChipSetup {
    pub mode: MeasuringMode,
    pub gain: u8,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measurement {
    /// Counts along X, Y and Z.
    pub raw: [i16; 3],
    /// The same in milligauss; `None` for an axis that overflowed.
    pub field_mgauss: Field,
}

impl Measurement {
    /// A measurement with this gain; `raw` is in the order X, Y, Z.
    pub fn new(sheet: &DataSheet, gain: u8, raw: [i16; 3]) -> Self {
        let mgauss_per_count = 1000.0 / sheet.gain(gain);
        let (least, most) = sheet.counts;
        let field = |count: i16| {
            (least..=most)
                .contains(&count)
                .then(|| f64::from(count) * mgauss_per_count)
        };
        Self {
            raw,
            field_mgauss: raw.map(field),
        }
    }

    pub fn overflowed(&self) -> bool {
        self.field_mgauss.contains(&None)
    }
}

/// A magnetometer. The chip has all the state: [`ChipSetup`] is how it is set up.
pub trait Magnetometer: Sync {
    fn sheet(&self) -> &'static DataSheet;

    /// The registers that set the chip up, in the order in which they are written. Their addresses have no gaps, and
    /// they read back as written.
    fn registers(&self, setup: ChipSetup) -> Vec<(u8, u8)>;

    /// Starts a single measurement. Chips that measure continuously only are never asked.
    fn trigger(&self, _bus: &mut dyn Bus) -> Result<(), ChipError> {
        Ok(())
    }

    /// The counts along X, Y and Z, if a measurement is ready.
    fn poll(&self, bus: &mut dyn Bus) -> Result<Option<[i16; 3]>, ChipError>;

    /// Runs the self-test of X, Y and Z; `None` if the chip has none. The chip must be set up anew after it.
    fn self_test(
        &self,
        _bus: &mut dyn Bus,
        _clock: &mut dyn Clock,
    ) -> Result<Option<[AxisTest; 3]>, ChipError> {
        Ok(None)
    }

    /// Sets the chip up, whatever state it was in: the kernel's drivers leave some asleep.
    fn start(&self, bus: &mut dyn Bus, setup: ChipSetup) -> Result<(), ChipError> {
        write_all(bus, self.sheet().address, &self.registers(setup))
    }

    /// Writes the registers that differ between two setups: a chip goes on measuring while its gain changes. The next
    /// measurement still has the old gain.
    fn change(&self, bus: &mut dyn Bus, from: ChipSetup, to: ChipSetup) -> Result<(), ChipError> {
        let held = self.registers(from);
        let mut changed = self.registers(to);
        changed.retain(|register| !held.contains(register));
        write_all(bus, self.sheet().address, &changed)
    }

    fn verify(&self, bus: &mut dyn Bus, setup: ChipSetup) -> Result<(), ChipError> {
        let mut registers = self.registers(setup);
        registers.sort_unstable();
        compare(bus, self.sheet().name, self.sheet().address, &registers)
    }

    /// The error for a chip that identifies itself as this one but never delivers a new measurement, if imitations are
    /// known to do that.
    fn imitation(&self) -> Option<ChipError> {
        None
    }
}

/// One axis of a self-test: what the chip measured of its own field.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct AxisTest {
    pub axis: &'static str,
    /// Counts of a typical chip.
    pub expected: f64,
    /// The smallest and the largest count of a good chip.
    pub limits: (f64, f64),
    /// Counts as measured; `None` if the axis overflowed.
    pub measured: Option<f64>,
    pub passed: bool,
}

/// A chip that was identified, and how certain that is.
#[derive(Clone, Copy)]
pub struct Identified {
    pub chip: &'static dyn Magnetometer,
    /// Whether that is certain. If not, it is the most likely one.
    pub sure: bool,
    pub why: &'static str,
}

/// A driver: the chips that answer alike at one address.
pub struct Driver {
    /// Its chips, as people call them.
    pub name: &'static str,
    /// Its chips; the configuration may name each by its word.
    pub chips: &'static [&'static dyn Magnetometer],
    /// Identifies the chip that answers. With a chip that the configuration names, only the identity registers are
    /// read; without one, the chip may be written to.
    pub identify: Identify,
}

pub type Identify = fn(
    &mut dyn Bus,
    &mut dyn Clock,
    Option<&'static dyn Magnetometer>,
) -> Result<Identified, ChipError>;

impl Driver {
    pub fn address(&self) -> u8 {
        self.chips[0].sheet().address
    }

    pub fn chip(&self, word: &str) -> Option<&'static dyn Magnetometer> {
        let mut chips = self.chips.iter().copied();
        chips.find(|chip| chip.sheet().name.eq_ignore_ascii_case(word))
    }
}
