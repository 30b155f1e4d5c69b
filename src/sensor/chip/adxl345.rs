//! ADXL345: an accelerometer of ±16 g.

use super::{
    ChipError, Companion, InertialSample, STANDARD_GRAVITY_M_S2, compare, little_endian, must_be,
    scaled, write_all,
};
use crate::sensor::bus::Bus;
use crate::sensor::clock::Clock;

// Registers of the ADXL345 (kernel's `adxl345_core.c`).
const DEVID: u8 = 0x00;
const BW_RATE: u8 = 0x2C;
const POWER_CTL: u8 = 0x2D;
const DATA_FORMAT: u8 = 0x31;
const DATAX0: u8 = 0x32;

const IDENTITY: u8 = 0xE5;
/// BW_RATE: 200 Hz: a reading is never older than 5 ms.
const RATE_200_HZ: u8 = 0x0B;
/// POWER_CTL: it boots in standby.
const MEASURE: u8 = 0x08;
/// DATA_FORMAT: full resolution, ±16 g.
const FULL_RESOLUTION_16_G: u8 = 0x0B;
/// At full resolution, in every range.
const COUNTS_PER_G: f64 = 256.0;

const NAME: &str = "ADXL345";

/// An accelerometer ADXL345, at 0x53 or 0x1D.
#[derive(Clone, Debug)]
pub struct Adxl345 {
    address: u8,
}

impl Adxl345 {
    /// The accelerometer at this address.
    pub fn new(address: u8) -> Self {
        Self { address }
    }
}

impl Companion for Adxl345 {
    fn name(&self) -> &'static str {
        NAME
    }

    fn measures_force(&self) -> bool {
        true
    }

    /// By register 0x00, DEVID.
    fn identify(&self, bus: &mut dyn Bus) -> Result<(), ChipError> {
        let place = (self.address, DEVID);
        must_be(bus, NAME, place, "e5", |found| found == IDENTITY)
    }

    fn start(&mut self, bus: &mut dyn Bus, _: &mut dyn Clock) -> Result<(), ChipError> {
        self.identify(bus)?;
        let settings = [
            (DATA_FORMAT, FULL_RESOLUTION_16_G),
            (BW_RATE, RATE_200_HZ),
            (POWER_CTL, MEASURE),
        ];
        write_all(bus, self.address, &settings)
    }

    fn read(&mut self, bus: &mut dyn Bus) -> Result<InertialSample, ChipError> {
        let mut bytes = [0; 6];
        bus.read(self.address, DATAX0, &mut bytes)?;
        let [x, y, z] = little_endian(&bytes);
        let unit_m_s2 = STANDARD_GRAVITY_M_S2 / COUNTS_PER_G;
        Ok(InertialSample {
            raw: [0, 0, 0, x, y, z],
            rate_rad_s: None,
            specific_force_m_s2: Some(scaled([x, y, z], unit_m_s2)),
        })
    }

    fn verify(&mut self, bus: &mut dyn Bus) -> Result<(), ChipError> {
        let set = [(BW_RATE, RATE_200_HZ), (POWER_CTL, MEASURE)];
        compare(bus, NAME, self.address, &set)
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::JumpingClock;
    use super::*;
    use crate::sensor::bus::fake::{FakeBus, Transfer::*};

    #[test]
    fn it_is_told_and_set_to_measure() {
        let mut bus = FakeBus::default();
        bus.set(0x53, 0x00, &[0xE5]);
        let mut accel = Adxl345::new(0x53);
        accel.start(&mut bus, &mut JumpingClock::default()).unwrap();
        let right = [
            Read(0x53, 0x00, 1),
            Write(0x53, 0x31, 0x0B),
            Write(0x53, 0x2C, 0x0B),
            Write(0x53, 0x2D, 0x08),
        ];
        assert_eq!(bus.transfers(), right);
        accel.verify(&mut bus).unwrap();
        assert_eq!(bus.transfers(), [Read(0x53, 0x2C, 2)]);
        // Standby: what it boots in.
        bus.set(0x53, 0x2D, &[0]);
        assert_eq!(
            accel.verify(&mut bus).unwrap_err().code(),
            "configuration_lost"
        );
        bus.set(0x53, 0x00, &[0]);
        assert_eq!(
            accel.identify(&mut bus).unwrap_err().code(),
            "wrong_identity"
        );
    }

    #[test]
    fn six_registers_low_byte_first_are_a_force() {
        let mut bus = FakeBus::default();
        bus.set(0x53, 0x32, &[0x00, 0x01, 0x00, 0xFF, 0x80, 0x00]);
        let motion = Adxl345::new(0x53).read(&mut bus).unwrap();
        assert_eq!(bus.transfers(), [Read(0x53, 0x32, 6)]);
        assert_eq!(motion.raw, [0, 0, 0, 256, -256, 128]);
        let force = motion.specific_force_m_s2.unwrap();
        assert!((force - nalgebra::Vector3::new(9.80665, -9.80665, 4.903325)).norm() < 1e-9);
    }
}
