//! A gyro, an accelerometer, or both in one: what all of them have in common. A chip's own file has its data sheet.

use nalgebra::Vector3;

use super::{ChipError, compare, must_be, pause, write_all};
use crate::reading::STANDARD_GRAVITY_M_S2;
use crate::sensor::bus::Bus;
use crate::sensor::clock::Clock;

/// The registers of a chip, and what its numbers mean.
#[derive(Debug)]
pub struct CompanionSheet {
    /// The name that is printed on the chip.
    pub name: &'static str,
    /// The register by which it identifies itself, the bits that count, and what they must be.
    pub who_am_i: u8,
    pub identity_mask: u8,
    pub identity: u8,
    /// What the register may hold, for people.
    pub identity_right: &'static str,
    /// Sets all registers to their defaults: register, value, and how long that takes, seconds.
    pub reset: Option<(u8, u8, f64)>,
    /// The registers that set it up, in the order in which they are written.
    pub setup: &'static [(u8, u8)],
    /// How long it settles after that, seconds.
    pub settling_s: f64,
    /// The registers of `setup` that are read back; their addresses follow one another.
    pub held: &'static [(u8, u8)],
    /// The first register of a sample, and how many there are.
    pub data: (u8, usize),
    /// The numbers of a sample: gyro X, Y, Z, accelerometer X, Y, Z; 0 where it has none.
    pub counts: fn(&[u8]) -> [i16; 6],
    /// Counts for one degree a second, if it is a gyro.
    pub counts_per_deg_s: Option<f64>,
    /// Counts for one g, if it is an accelerometer.
    pub counts_per_g: Option<f64>,
}

impl CompanionSheet {
    pub fn at(&'static self, address: u8) -> Companion {
        let sheet = self;
        Companion { sheet, address }
    }

    /// The rate of these counts; `None` if the chip has no gyro.
    pub fn rate_rad_s(&self, counts: Vector3<f64>) -> Option<Vector3<f64>> {
        Some(counts * (1.0 / self.counts_per_deg_s?).to_radians())
    }

    /// The specific force of these counts; `None` if the chip has no accelerometer.
    pub fn specific_force_m_s2(&self, counts: Vector3<f64>) -> Option<Vector3<f64>> {
        Some(counts * (STANDARD_GRAVITY_M_S2 / self.counts_per_g?))
    }
}

/// A chip on the bus. It keeps no state here: all of it is in the chip's registers.
#[derive(Clone, Copy, Debug)]
pub struct Companion {
    sheet: &'static CompanionSheet,
    address: u8,
}

/// What a companion measured, chip axes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct InertialSample {
    /// The numbers of the chip, to see whether they change; 0 where it has none.
    pub raw: [i16; 6],
    pub rate_rad_s: Option<Vector3<f64>>,
    pub specific_force_m_s2: Option<Vector3<f64>>,
}

impl Companion {
    pub fn name(&self) -> &'static str {
        self.sheet.name
    }

    /// Whether it is an accelerometer, or one as well.
    pub fn measures_force(&self) -> bool {
        self.sheet.counts_per_g.is_some()
    }

    pub fn identify(&self, bus: &mut dyn Bus) -> Result<(), ChipError> {
        let sheet = self.sheet;
        let place = (self.address, sheet.who_am_i);
        must_be(bus, sheet.name, place, sheet.identity_right, |found| {
            found & sheet.identity_mask == sheet.identity
        })
    }

    pub fn start(&self, bus: &mut dyn Bus, clock: &mut dyn Clock) -> Result<(), ChipError> {
        self.identify(bus)?;
        if let Some((register, value, takes_s)) = self.sheet.reset {
            bus.write(self.address, register, value)?;
            pause(clock, takes_s)?;
        }
        write_all(bus, self.address, self.sheet.setup)?;
        pause(clock, self.sheet.settling_s)
    }

    /// Reads what it measures, in one transfer.
    pub fn read(&self, bus: &mut dyn Bus) -> Result<InertialSample, ChipError> {
        let (register, count) = self.sheet.data;
        let mut bytes = [0; 14];
        let bytes = &mut bytes[..count];
        bus.read(self.address, register, bytes)?;
        let raw = (self.sheet.counts)(bytes);
        let [rate, force] = [0, 3].map(|at| Vector3::from_fn(|axis, _| f64::from(raw[at + axis])));
        Ok(InertialSample {
            raw,
            rate_rad_s: self.sheet.rate_rad_s(rate),
            specific_force_m_s2: self.sheet.specific_force_m_s2(force),
        })
    }

    pub fn verify(&self, bus: &mut dyn Bus) -> Result<(), ChipError> {
        compare(bus, self.name(), self.address, self.sheet.held)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::super::tests::JumpingClock;
    use super::*;
    use crate::sensor::bus::fake::{FakeBus, Transfer};

    /// The transfers that set a chip up and read its registers back, and how long they take, seconds. The chip notices
    /// every register that is lost, and refuses another chip.
    pub(crate) fn started(
        sheet: &'static CompanionSheet,
        address: u8,
        identity: u8,
    ) -> (Vec<Transfer>, f64) {
        let (mut bus, mut clock) = (FakeBus::default(), JumpingClock::default());
        let chip = sheet.at(address);
        bus.set(address, sheet.who_am_i, &[identity]);
        chip.start(&mut bus, &mut clock).unwrap();
        chip.verify(&mut bus).unwrap();
        let transfers = bus.transfers();
        for &(register, right) in sheet.held {
            bus.set(address, register, &[!right]);
            let lost = chip.verify(&mut bus).unwrap_err();
            assert_eq!(lost.code(), "configuration_lost");
            bus.set(address, register, &[right]);
        }
        bus.set(address, sheet.who_am_i, &[!identity]);
        let other = chip.identify(&mut bus).unwrap_err();
        assert_eq!(other.code(), "wrong_identity");
        let found = format!("[{:02x}]", !identity);
        assert!(other.to_string().contains(&found), "{other}");
        (transfers, clock.now_s)
    }
}
