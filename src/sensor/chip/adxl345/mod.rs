//! ADXL345: an accelerometer of ±16 g.

mod registers;

use super::{
    ChipError, Companion, Motion, STANDARD_GRAVITY_M_S2, compare, must_be, scaled, write_all,
};
use crate::sensor::bus::Bus;
use crate::sensor::clock::Clock;
use registers::*;

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

    /// Whether that is the chip which answers there (register 0x00, DEVID).
    pub fn identify(&self, bus: &mut dyn Bus) -> Result<(), ChipError> {
        let place = (self.address, DEVID);
        must_be(bus, NAME, place, "e5", |found| found == IDENTITY)
    }
}

impl Companion for Adxl345 {
    fn name(&self) -> &'static str {
        NAME
    }

    fn measures_force(&self) -> bool {
        true
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

    fn read(&mut self, bus: &mut dyn Bus) -> Result<Motion, ChipError> {
        let mut bytes = [0; 6];
        bus.read(self.address, DATAX0, &mut bytes)?;
        // The only one of these chips that sends the low byte first.
        let [x, y, z] = [0, 2, 4].map(|at| i16::from_le_bytes([bytes[at], bytes[at + 1]]));
        let unit_m_s2 = STANDARD_GRAVITY_M_S2 / COUNTS_PER_G;
        Ok(Motion {
            raw: [0, 0, 0, x, y, z],
            rate_rad_s: None,
            specific_force_m_s2: Some(scaled([x, y, z], unit_m_s2)),
        })
    }

    fn verify(&mut self, bus: &mut dyn Bus) -> Result<(), ChipError> {
        let set = [(BW_RATE, RATE_200_HZ), (POWER_CTL, MEASURE)];
        compare(bus, NAME, self.address, set)
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
