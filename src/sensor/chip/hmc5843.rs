//! HMC5843, HMC5883, HMC5883L and HMC5983: three-axis magnetometers.

mod identify;
mod registers;
mod self_test;
mod variants;

use super::ChipError;
use super::magnetometer::{AxisTest, ChipSetup, DataSheet, Driver, Magnetometer, MeasuringMode};
use crate::sensor::bus::{Bus, read_byte};
use crate::sensor::clock::Clock;
use registers::*;
use variants::{HMC5843, HMC5883, HMC5883L, HMC5983};

pub use variants::Variant;

pub static DRIVER: Driver = Driver {
    name: identify::NAME,
    chips: &[
        &Variant::Hmc5843,
        &Variant::Hmc5883,
        &Variant::Hmc5883l,
        &Variant::Hmc5983,
    ],
    identify: identify::identify,
};

impl Magnetometer for Variant {
    fn sheet(&self) -> &'static DataSheet {
        match self {
            Self::Hmc5843 => &HMC5843,
            Self::Hmc5883 => &HMC5883,
            Self::Hmc5883l => &HMC5883L,
            Self::Hmc5983 => &HMC5983,
        }
    }

    /// Single measurements have the fastest rate, which is not the power-on default: a brown-out shows.
    fn registers(&self, setup: ChipSetup) -> Vec<(u8, u8)> {
        let gain = (CRB, crb(setup.gain));
        match setup.mode {
            MeasuringMode::Single => vec![(CRA, cra(FASTEST, NO_BIAS)), gain],
            MeasuringMode::Continuous(rate) => {
                vec![(CRA, cra(rate, NO_BIAS)), gain, (MODE, CONTINUOUS)]
            }
        }
    }

    fn trigger(&self, bus: &mut dyn Bus) -> Result<(), ChipError> {
        Ok(bus.write(ADDRESS, MODE, SINGLE)?)
    }

    /// All six data registers in one transfer: output is locked (LOCK) until all six are read.
    fn poll(&self, bus: &mut dyn Bus) -> Result<Option<[i16; 3]>, ChipError> {
        if read_byte(bus, ADDRESS, STATUS)? & RDY == 0 {
            return Ok(None);
        }
        let mut bytes = [0; 6];
        bus.read(ADDRESS, DATA, &mut bytes)?;
        let [first, second, third] = super::big_endian(&bytes);
        Ok(Some(match self {
            Self::Hmc5843 => [first, second, third],
            // X, Z, Y.
            Self::Hmc5883 | Self::Hmc5883l | Self::Hmc5983 => [first, third, second],
        }))
    }

    fn self_test(
        &self,
        bus: &mut dyn Bus,
        clock: &mut dyn Clock,
    ) -> Result<Option<[AxisTest; 3]>, ChipError> {
        self_test::self_test(bus, clock, *self).map(Some)
    }

    fn imitation(&self) -> Option<ChipError> {
        (*self == Self::Hmc5883l).then_some(ChipError::FakeHmc5883l)
    }
}

#[cfg(test)]
mod tests {
    use super::super::magnetometer::Measurement;
    use super::*;
    use crate::sensor::bus::fake::{FakeBus, Transfer::*};

    const X_Y_Z: [u8; 6] = [0x05, 0x14, 0xFA, 0xEC, 0xF0, 0x00];
    const SINGLE_AT_1: ChipSetup = ChipSetup {
        mode: MeasuringMode::Single,
        gain: 1,
    };

    fn ready(bytes: &[u8]) -> FakeBus {
        let bus = FakeBus::default();
        bus.set(ADDRESS, DATA, bytes);
        bus.set(ADDRESS, STATUS, &[RDY]);
        bus
    }

    #[test]
    fn single_measurements_are_set_up_triggered_and_verified() {
        let mut bus = ready(&X_Y_Z);
        let chip = Variant::Hmc5843;
        chip.start(&mut bus, SINGLE_AT_1).unwrap();
        chip.trigger(&mut bus).unwrap();
        chip.verify(&mut bus, SINGLE_AT_1).unwrap();
        let right = [
            Write(0x1E, 0x00, 0x18),
            Write(0x1E, 0x01, 0x20),
            Write(0x1E, 0x02, 0x01),
            Read(0x1E, 0x00, 2),
        ];
        assert_eq!(bus.transfers(), right);
        // The power-on defaults.
        bus.set(ADDRESS, CRA, &[0x10, 0x20]);
        let lost = chip.verify(&mut bus, SINGLE_AT_1).unwrap_err();
        assert_eq!(lost.code(), "configuration_lost");
    }

    #[test]
    fn every_rate_and_gain_has_its_code() {
        for code in 0..7 {
            let mut bus = ready(&X_Y_Z);
            let setup = ChipSetup {
                mode: MeasuringMode::Continuous(code),
                gain: code + 1,
            };
            Variant::Hmc5843.start(&mut bus, setup).unwrap();
            Variant::Hmc5843.verify(&mut bus, setup).unwrap();
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
        let chip = Variant::Hmc5843;
        let raw = chip.poll(&mut bus).unwrap().unwrap();
        assert_eq!(bus.transfers(), [Read(0x1E, 0x09, 1), Read(0x1E, 0x03, 6)]);
        assert_eq!(raw, [1300, -1300, -4096]);
        // 1300 counts are a gauss; −4096 is an overflow of its axis alone.
        let sample = Measurement::new(chip.sheet(), 1, raw);
        assert_eq!(sample.field_mgauss, [Some(1000.0), Some(-1000.0), None]);
        assert!(sample.overflowed());
        let ends = Measurement::new(chip.sheet(), 1, [2047, -2048, 2048]);
        assert_eq!(
            ends.field_mgauss.map(|axis| axis.is_some()),
            [true, true, false]
        );
        // LOCK alone is no measurement.
        bus.set(ADDRESS, STATUS, &[0x02]);
        assert_eq!(chip.poll(&mut bus).unwrap(), None);
        assert_eq!(bus.transfers(), [Read(0x1E, 0x09, 1)]);
    }

    #[test]
    fn all_but_an_hmc5843_send_x_z_y() {
        let mut bus = ready(&[0x00, 0x01, 0x00, 0x03, 0x00, 0x02]);
        for chip in [Variant::Hmc5883, Variant::Hmc5883l, Variant::Hmc5983] {
            assert_eq!(chip.poll(&mut bus).unwrap(), Some([1, 2, 3]));
        }
    }

    #[test]
    fn a_new_gain_is_one_write() {
        let mut bus = ready(&X_Y_Z);
        let to = ChipSetup {
            gain: 4,
            ..SINGLE_AT_1
        };
        Variant::Hmc5843.change(&mut bus, SINGLE_AT_1, to).unwrap();
        assert_eq!(bus.transfers(), [Write(0x1E, 0x01, 0x80)]);
    }
}
