//! ITG-3200 and ITG-3205: gyros of ±2000°/s.

use super::{
    ChipError, Companion, InertialSample, big_endian, compare, must_be, pause, scaled, write_all,
};
use crate::sensor::bus::Bus;
use crate::sensor::clock::Clock;

// Registers of the ITG-3200 (kernel's `itg3200.h`, data sheet PS-ITG-3200A).
const WHO_AM_I: u8 = 0x00;
const SMPLRT_DIV: u8 = 0x15;
const DLPF_FS: u8 = 0x16;
const GYRO_XOUT_H: u8 = 0x1D;
const PWR_MGM: u8 = 0x3E;

/// WHO_AM_I without the lowest bit, which follows the pin AD0, and the highest.
const IDENTITY: u8 = 0x34;
/// PWR_MGM: all registers to their defaults.
const RESET: u8 = 0x80;
/// PWR_MGM: awake, the X gyro's oscillator drives the PLL.
const CLOCK_X: u8 = 0x01;
/// DLPF_FS: ±2000°/s (the only good range), low-pass 42 Hz, 1 kHz inside.
const FULL_SCALE_42_HZ: u8 = 0x1B;
/// SMPLRT_DIV: 1 kHz / (4 + 1), 200 Hz: a reading is never older than 5 ms.
const DIVIDER: u8 = 4;
/// Counts for one degree a second.
const COUNTS_PER_DEG_S: f64 = 14.375;

const NAME: &str = "ITG-3200";
/// The kernel waits 1.5 ms after a reset.
const RESET_S: f64 = 0.002;
/// Until the gyros have settled.
const SETTLING_S: f64 = 0.05;

/// A gyro ITG-3200 or ITG-3205, at 0x68 or 0x69.
#[derive(Clone, Debug)]
pub struct Itg3200 {
    address: u8,
}

impl Itg3200 {
    /// The gyro at this address.
    pub fn new(address: u8) -> Self {
        Self { address }
    }
}

impl Companion for Itg3200 {
    fn name(&self) -> &'static str {
        NAME
    }

    fn measures_force(&self) -> bool {
        false
    }

    /// By register 0x00, WHO_AM_I.
    fn identify(&self, bus: &mut dyn Bus) -> Result<(), ChipError> {
        let place = (self.address, WHO_AM_I);
        must_be(bus, NAME, place, "68 or 69", |found| {
            (found >> 1) & 0x3F == IDENTITY
        })
    }

    fn start(&mut self, bus: &mut dyn Bus, clock: &mut dyn Clock) -> Result<(), ChipError> {
        self.identify(bus)?;
        bus.write(self.address, PWR_MGM, RESET)?;
        pause(clock, RESET_S)?;
        let settings = [
            (PWR_MGM, CLOCK_X),
            (SMPLRT_DIV, DIVIDER),
            (DLPF_FS, FULL_SCALE_42_HZ),
        ];
        write_all(bus, self.address, &settings)?;
        pause(clock, SETTLING_S)
    }

    fn read(&mut self, bus: &mut dyn Bus) -> Result<InertialSample, ChipError> {
        let mut bytes = [0; 6];
        bus.read(self.address, GYRO_XOUT_H, &mut bytes)?;
        let [x, y, z] = big_endian(&bytes);
        let unit_rad_s = (1.0 / COUNTS_PER_DEG_S).to_radians();
        Ok(InertialSample {
            raw: [x, y, z, 0, 0, 0],
            rate_rad_s: Some(scaled([x, y, z], unit_rad_s)),
            specific_force_m_s2: None,
        })
    }

    fn verify(&mut self, bus: &mut dyn Bus) -> Result<(), ChipError> {
        let set = [(SMPLRT_DIV, DIVIDER), (DLPF_FS, FULL_SCALE_42_HZ)];
        compare(bus, NAME, self.address, &set)
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::JumpingClock;
    use super::*;
    use crate::sensor::bus::fake::{FakeBus, Transfer::*};

    #[test]
    fn it_is_told_reset_and_set_up() {
        let mut bus = FakeBus::default();
        bus.set(0x69, 0x00, &[0x69]);
        let mut clock = JumpingClock::default();
        let mut gyro = Itg3200::new(0x69);
        gyro.start(&mut bus, &mut clock).unwrap();
        assert!((0.051..0.06).contains(&clock.now_s));
        let right = [
            Read(0x69, 0x00, 1),
            Write(0x69, 0x3E, 0x80),
            Write(0x69, 0x3E, 0x01),
            Write(0x69, 0x15, 4),
            Write(0x69, 0x16, 0x1B),
        ];
        assert_eq!(bus.transfers(), right);
        gyro.verify(&mut bus).unwrap();
        assert_eq!(bus.transfers(), [Read(0x69, 0x15, 2)]);
        // The defaults after a reset.
        bus.set(0x69, 0x15, &[0, 0]);
        assert_eq!(
            gyro.verify(&mut bus).unwrap_err().code(),
            "configuration_lost"
        );
    }

    #[test]
    fn six_registers_are_a_rate() {
        let mut bus = FakeBus::default();
        // 14375 counts are 1000 degrees a second.
        bus.set(0x68, 0x1D, &[0x38, 0x27, 0xC7, 0xD9, 0xFF, 0xFF]);
        let motion = Itg3200::new(0x68).read(&mut bus).unwrap();
        assert_eq!(bus.transfers(), [Read(0x68, 0x1D, 6)]);
        assert_eq!(motion.raw, [14375, -14375, -1, 0, 0, 0]);
        let rate = motion.rate_rad_s.unwrap().map(f64::to_degrees);
        assert!((rate.x - 1000.0).abs() < 1e-9 && (rate.y + 1000.0).abs() < 1e-9);
        assert!((rate.z.to_radians() + 0.001_214_1).abs() < 1e-6);
    }

    #[test]
    fn another_chip_is_refused() {
        let mut bus = FakeBus::default();
        // An L3G4200D.
        bus.set(0x69, 0x00, &[0xD3]);
        let error = Itg3200::new(0x69).identify(&mut bus).unwrap_err();
        assert_eq!(error.code(), "wrong_identity");
        assert!(error.to_string().contains("[d3]"), "{error}");
    }
}
