//! HMC5843, HMC5883, HMC5883L and HMC5983: three-axis magnetometers.

mod identify;
mod kin;
mod range;
mod registers;
mod self_test;

use super::{ChipError, compare, write_all};
use crate::reading::Field;
use crate::sensor::bus::{Bus, read_byte};
use registers::*;

pub use identify::{Identified, identify};
pub use kin::{Gain, Kind, Straps};
pub use range::Range;
pub use self_test::{AxisTest, SelfTest, self_test};

/// The numbers that 12 bits hold; −4096 is the chip's word for an overflow, and no other ever comes.
const COUNTS: std::ops::RangeInclusive<i16> = -2048..=2047;

/// The address of all of them.
pub const MAG_ADDRESS: u8 = ADDRESS;

/// When it measures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pace {
    /// When it is told to.
    Single,
    /// By itself, with this rate code.
    Continuous(u8),
}

/// One measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Counts along X, Y and Z.
    pub raw: [i16; 3],
    /// The same in milligauss; `None` for an axis that overflowed.
    pub field_mgauss: Field,
}

impl Sample {
    /// A measurement with this gain; `raw` is in the order X, Y, Z.
    pub fn new(kind: Kind, gain: u8, raw: [i16; 3]) -> Self {
        let mgauss_per_count = 1000.0 / kind.gains()[usize::from(gain)].counts_per_gauss;
        let field = |count: i16| {
            COUNTS
                .contains(&count)
                .then(|| f64::from(count) * mgauss_per_count)
        };
        Self {
            raw,
            field_mgauss: raw.map(field),
        }
    }

    /// Whether an axis overflowed.
    pub fn overflowed(&self) -> bool {
        self.field_mgauss.contains(&None)
    }
}

/// A magnetometer that is set up.
#[derive(Clone, Debug)]
pub struct Hmc5843 {
    kind: Kind,
    pace: Pace,
    gain: u8,
    /// Measurements still to come with the gain before.
    outdated: u8,
}

impl Hmc5843 {
    /// Sets the chip up, whatever state it was in: the kernel's driver leaves it asleep.
    pub fn start(bus: &mut dyn Bus, kind: Kind, pace: Pace, gain: u8) -> Result<Self, ChipError> {
        let mut chip = Self {
            kind,
            pace,
            gain,
            outdated: 1,
        };
        write_all(bus, ADDRESS, &chip.configuration())?;
        if let Pace::Continuous(_) = pace {
            bus.write(ADDRESS, MODE, CONTINUOUS)?;
        }
        chip.outdated = 1;
        Ok(chip)
    }

    /// The kind.
    pub fn kind(&self) -> Kind {
        self.kind
    }

    /// When it measures.
    pub fn pace(&self) -> Pace {
        self.pace
    }

    /// Has a single measurement begin.
    pub fn trigger(&self, bus: &mut dyn Bus) -> Result<(), ChipError> {
        Ok(bus.write(ADDRESS, MODE, SINGLE)?)
    }

    /// The measurement, if the status register has RDY: all six data registers in one transfer, since the chip
    /// holds its breath (LOCK) until all are read.
    pub fn poll(&self, bus: &mut dyn Bus) -> Result<Option<Sample>, ChipError> {
        if read_byte(bus, ADDRESS, STATUS)? & RDY == 0 {
            return Ok(None);
        }
        let mut bytes = [0; 6];
        bus.read(ADDRESS, DATA, &mut bytes)?;
        let raw = self.kind.ordered(super::big_endian(&bytes));
        Ok(Some(Sample::new(self.kind, self.gain, raw)))
    }

    /// Changes the gain. The next measurement still has the one before: see [`Self::is_outdated`].
    pub fn set_gain(&mut self, bus: &mut dyn Bus, gain: u8) -> Result<(), ChipError> {
        bus.write(ADDRESS, CRB, crb(gain))?;
        self.gain = gain;
        self.outdated = 1;
        Ok(())
    }

    /// Whether a measurement just read is to be discarded, since it began before the gain was set.
    pub fn is_outdated(&mut self) -> bool {
        let outdated = self.outdated > 0;
        self.outdated = self.outdated.saturating_sub(1);
        outdated
    }

    /// Looks whether CRA and CRB, and the mode if that stays, still are as they were set up.
    pub fn verify(&self, bus: &mut dyn Bus) -> Result<(), ChipError> {
        let [a, b] = self.configuration();
        match self.pace {
            Pace::Single => compare(bus, self.kind.name(), ADDRESS, [a, b]),
            Pace::Continuous(_) => {
                compare(bus, self.kind.name(), ADDRESS, [a, b, (MODE, CONTINUOUS)])
            }
        }
    }

    /// CRA and CRB. Single measurements have the fastest rate, which no power-on default is: a brown-out shows.
    fn configuration(&self) -> [(u8, u8); 2] {
        let rate = match self.pace {
            Pace::Single => FASTEST,
            Pace::Continuous(code) => code,
        };
        [(CRA, cra(rate, NO_BIAS)), (CRB, crb(self.gain))]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor::bus::fake::{FakeBus, Transfer::*};

    const X_Y_Z: [u8; 6] = [0x05, 0x14, 0xFA, 0xEC, 0xF0, 0x00];

    fn ready(bytes: &[u8]) -> FakeBus {
        let bus = FakeBus::default();
        bus.set(ADDRESS, DATA, bytes);
        bus.set(ADDRESS, STATUS, &[RDY]);
        bus
    }

    #[test]
    fn single_measurements_are_set_up_triggered_and_verified() {
        let mut bus = ready(&X_Y_Z);
        let chip = Hmc5843::start(&mut bus, Kind::Hmc5843, Pace::Single, 1).unwrap();
        chip.trigger(&mut bus).unwrap();
        chip.verify(&mut bus).unwrap();
        let right = [
            Write(0x1E, 0x00, 0x18),
            Write(0x1E, 0x01, 0x20),
            Write(0x1E, 0x02, 0x01),
            Read(0x1E, 0x00, 2),
        ];
        assert_eq!(bus.transfers(), right);
        // The power-on defaults.
        bus.set(ADDRESS, CRA, &[0x10, 0x20]);
        let lost = chip.verify(&mut bus).unwrap_err();
        assert_eq!(lost.code(), "configuration_lost");
    }

    #[test]
    fn every_rate_and_gain_has_its_code() {
        for code in 0..7 {
            let mut bus = ready(&X_Y_Z);
            let pace = Pace::Continuous(code);
            let chip = Hmc5843::start(&mut bus, Kind::Hmc5843, pace, code + 1).unwrap();
            chip.verify(&mut bus).unwrap();
            let right = [
                Write(0x1E, 0x00, code << 2),
                Write(0x1E, 0x01, (code + 1) << 5),
                Write(0x1E, 0x02, 0x00),
                Read(0x1E, 0x00, 3),
            ];
            assert_eq!(bus.transfers(), right);
        }
    }

    #[test]
    fn rdy_is_looked_at_and_six_registers_come_in_one_transfer() {
        let mut bus = ready(&X_Y_Z);
        let chip = Hmc5843::start(&mut bus, Kind::Hmc5843, Pace::Single, 1).unwrap();
        bus.transfers();
        let sample = chip.poll(&mut bus).unwrap().unwrap();
        assert_eq!(bus.transfers(), [Read(0x1E, 0x09, 1), Read(0x1E, 0x03, 6)]);
        // 1300 counts are a gauss; −4096 is an overflow of its axis alone.
        assert_eq!(sample.raw, [1300, -1300, -4096]);
        assert_eq!(sample.field_mgauss, [Some(1000.0), Some(-1000.0), None]);
        assert!(sample.overflowed());
        // LOCK alone is no measurement.
        bus.set(ADDRESS, STATUS, &[0x02]);
        assert_eq!(chip.poll(&mut bus).unwrap(), None);
        assert_eq!(bus.transfers(), [Read(0x1E, 0x09, 1)]);
    }

    #[test]
    fn an_hmc5883l_sends_x_z_y() {
        let mut bus = ready(&[0x00, 0x01, 0x00, 0x03, 0x00, 0x02]);
        let chip = Hmc5843::start(&mut bus, Kind::Hmc5883l, Pace::Single, 1).unwrap();
        assert_eq!(chip.poll(&mut bus).unwrap().unwrap().raw, [1, 2, 3]);
    }

    #[test]
    fn a_new_gain_is_written_and_counts_from_the_second_measurement_on() {
        let mut bus = ready(&X_Y_Z);
        let mut chip = Hmc5843::start(&mut bus, Kind::Hmc5843, Pace::Single, 1).unwrap();
        assert!(chip.is_outdated() && !chip.is_outdated());
        bus.transfers();
        chip.set_gain(&mut bus, 4).unwrap();
        assert_eq!(bus.transfers(), [Write(0x1E, 0x01, 0x80)]);
        assert!(chip.is_outdated() && !chip.is_outdated());
        let sample = chip.poll(&mut bus).unwrap().unwrap();
        assert_eq!(sample.field_mgauss[0], Some(1300.0 / 530.0 * 1000.0));
    }

    #[test]
    fn the_12_bits_are_used_to_their_ends_and_not_beyond() {
        let field = |count| Sample::new(Kind::Hmc5843, 1, [count; 3]).field_mgauss[0];
        assert!(field(2047).is_some() && field(-2048).is_some());
        assert!(field(2048).is_none() && field(-2049).is_none() && field(-4096).is_none());
    }
}
