//! QMC5883L: a three-axis magnetometer that most boards sold with an HMC5883L carry. It has other registers at another
//! address, and no self-test.

use super::magnetometer::{ChipSetup, DataSheet, Driver, Identified, Magnetometer, MeasuringMode};
use super::{ChipError, little_endian, must_be};
use crate::sensor::bus::{Bus, read_byte};
use crate::sensor::clock::Clock;

// Registers (data sheet 1.0 of QST).
const ADDRESS: u8 = 0x0D;
/// Six registers, low byte first.
const DATA: u8 = 0x00;
const STATUS: u8 = 0x06;
const CONTROL_1: u8 = 0x09;
const CONTROL_2: u8 = 0x0A;
const SET_RESET_PERIOD: u8 = 0x0B;
const IDENTITY: u8 = 0x0D;

/// STATUS: a measurement is ready; reading a data register clears it.
const DRDY: u8 = 0x01;
/// STATUS: an axis overflowed.
const OVL: u8 = 0x02;
/// CONTROL_1: continuous measurement, 512 samples of the converter in each. Rate code in bits 3:2, gain code in 5:4.
const CONTINUOUS: u8 = 0x01;
/// CONTROL_2: the interrupt pin is not used.
const NO_INTERRUPT: u8 = 0x01;
/// SET_RESET_PERIOD: as recommended.
const PERIOD: u8 = 0x01;

static SHEET: DataSheet = DataSheet {
    name: "QMC5883L",
    address: ADDRESS,
    rates_hz: &[10.0, 50.0, 100.0, 200.0],
    gains: &[12_000.0, 3000.0],
    automatic_gains: (0, 1),
    // The output saturates at the ends of 16 bits.
    counts: (-i16::MAX, i16::MAX - 1),
    single_s: None,
};

pub static DRIVER: Driver = Driver {
    name: SHEET.name,
    chips: &[&Qmc5883l],
    identify,
};

/// A magnetometer QMC5883L, at 0x0D.
pub struct Qmc5883l;

impl Magnetometer for Qmc5883l {
    fn sheet(&self) -> &'static DataSheet {
        &SHEET
    }

    /// The chip is in standby after power-on, so a brown-out shows.
    fn registers(&self, setup: ChipSetup) -> Vec<(u8, u8)> {
        let rate = match setup.mode {
            MeasuringMode::Continuous(code) => code,
            MeasuringMode::Single => 0,
        };
        vec![
            (SET_RESET_PERIOD, PERIOD),
            (CONTROL_2, NO_INTERRUPT),
            (CONTROL_1, setup.gain << 4 | rate << 2 | CONTINUOUS),
        ]
    }

    fn poll(&self, bus: &mut dyn Bus) -> Result<Option<[i16; 3]>, ChipError> {
        let status = read_byte(bus, ADDRESS, STATUS)?;
        if status & DRDY == 0 {
            return Ok(None);
        }
        let mut bytes = [0; 6];
        bus.read(ADDRESS, DATA, &mut bytes)?;
        let raw = little_endian(&bytes);
        let saturated = |count: &i16| !(SHEET.counts.0..=SHEET.counts.1).contains(count);
        // The flag names no axis: unless one is saturated, all count as overflowed.
        let all = status & OVL != 0 && !raw.iter().any(saturated);
        Ok(Some(if all { [i16::MIN; 3] } else { raw }))
    }
}

fn identify(
    bus: &mut dyn Bus,
    _: &mut dyn Clock,
    _: Option<&'static dyn Magnetometer>,
) -> Result<Identified, ChipError> {
    // Transfers to other chips leave the identity unreadable until a data register has been read (ArduPilot, PX4).
    read_byte(bus, ADDRESS, DATA)?;
    must_be(bus, SHEET.name, (ADDRESS, IDENTITY), "ff", |found| {
        found == 0xFF
    })?;
    Ok(Identified {
        chip: &Qmc5883l,
        sure: true,
        why: "it answers at 0x0d with its identity",
    })
}

#[cfg(test)]
mod tests {
    use super::super::magnetometer::Measurement;
    use super::super::tests::JumpingClock;
    use super::*;
    use crate::sensor::bus::fake::{FakeBus, Transfer::*};

    fn setup(rate: u8, gain: u8) -> ChipSetup {
        let mode = MeasuringMode::Continuous(rate);
        ChipSetup { mode, gain }
    }

    #[test]
    fn it_is_identified_after_a_data_register_was_read() {
        let mut bus = FakeBus::default();
        bus.set(0x0D, 0x0D, &[0xFF]);
        let found = identify(&mut bus, &mut JumpingClock::default(), None).unwrap();
        assert!(found.sure && found.chip.sheet().name == "QMC5883L");
        assert_eq!(bus.transfers(), [Read(0x0D, 0x00, 1), Read(0x0D, 0x0D, 1)]);
    }

    #[test]
    fn every_rate_and_gain_has_its_code_and_is_read_back() {
        for (rate, gain, control) in [(0, 0, 0x01), (1, 0, 0x05), (2, 1, 0x19), (3, 1, 0x1D)] {
            let mut bus = FakeBus::default();
            bus.set(0x0D, 0x0D, &[0xFF]);
            Qmc5883l.start(&mut bus, setup(rate, gain)).unwrap();
            Qmc5883l.verify(&mut bus, setup(rate, gain)).unwrap();
            let right = [
                Write(0x0D, 0x0B, 0x01),
                Write(0x0D, 0x0A, 0x01),
                Write(0x0D, 0x09, control),
                Read(0x0D, 0x09, 3),
            ];
            assert_eq!(bus.transfers(), right);
            // Standby: what it is in after power-on.
            bus.set(0x0D, 0x09, &[0, 0, 0]);
            let lost = Qmc5883l.verify(&mut bus, setup(rate, gain)).unwrap_err();
            assert_eq!(lost.code(), "configuration_lost");
        }
        let codes = [0.5, 10.0, 40.0, 100.0, 220.0].map(|hz| SHEET.rate_code(hz));
        assert_eq!(codes, [0, 0, 1, 2, 3]);
    }

    #[test]
    fn drdy_is_looked_at_and_six_registers_low_byte_first_are_a_field() {
        let mut bus = FakeBus::default();
        bus.set(0x0D, 0x00, &[0xE0, 0x2E, 0x20, 0xD1, 0xFF, 0x7F, 0x01]);
        let raw = Qmc5883l.poll(&mut bus).unwrap().unwrap();
        assert_eq!(bus.transfers(), [Read(0x0D, 0x06, 1), Read(0x0D, 0x00, 6)]);
        assert_eq!(raw, [12_000, -12_000, 32_767]);
        // 12000 counts are a gauss; a saturated axis alone overflowed.
        let sample = Measurement::new(&SHEET, 0, raw);
        assert_eq!(sample.field_mgauss, [Some(1000.0), Some(-1000.0), None]);
        let coarse = Measurement::new(&SHEET, 1, [3000, -1, 0]).field_mgauss;
        assert_eq!(coarse, [Some(1000.0), Some(-1.0 / 3.0), Some(0.0)]);
        // The flag without a saturated axis: nothing of it can be used.
        bus.set(0x0D, 0x04, &[0, 0, 0x03]);
        let raw = Qmc5883l.poll(&mut bus).unwrap().unwrap();
        assert_eq!(Measurement::new(&SHEET, 0, raw).field_mgauss, [None; 3]);
        // A skipped measurement alone is no measurement.
        bus.set(0x0D, 0x06, &[0x04]);
        bus.transfers();
        assert_eq!(Qmc5883l.poll(&mut bus).unwrap(), None);
        assert_eq!(bus.transfers(), [Read(0x0D, 0x06, 1)]);
    }
}
