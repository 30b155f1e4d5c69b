//! MPU-6050: gyro (±1000°/s) and accelerometer (±8 g) in one, with a bus of its own behind it.
//!
//! A magnetometer on that bus answers only while the bypass is on, so this chip is set up before it.

use super::{
    ChipError, Companion, InertialSample, STANDARD_GRAVITY_M_S2, big_endian, compare, must_be,
    pause, scaled, write_all,
};
use crate::sensor::bus::Bus;
use crate::sensor::clock::Clock;

// Registers of the MPU-6050 (kernel's `inv_mpu_iio.h`).
const SMPLRT_DIV: u8 = 0x19;
const CONFIG: u8 = 0x1A;
const GYRO_CONFIG: u8 = 0x1B;
const ACCEL_CONFIG: u8 = 0x1C;
const INT_PIN_CFG: u8 = 0x37;
const ACCEL_XOUT_H: u8 = 0x3B;
const USER_CTRL: u8 = 0x6A;
const PWR_MGMT_1: u8 = 0x6B;
const WHO_AM_I: u8 = 0x75;

const IDENTITY: u8 = 0x68;
/// PWR_MGMT_1: all registers to their defaults.
const RESET: u8 = 0x80;
/// PWR_MGMT_1: awake, the X gyro's oscillator drives the PLL.
const CLOCK_X: u8 = 0x01;
/// SMPLRT_DIV: 1 kHz / (4 + 1), 200 Hz: a reading is never older than 5 ms.
const DIVIDER: u8 = 4;
/// CONFIG: low-pass of about 43 Hz, 1 kHz inside.
const LOW_PASS_43_HZ: u8 = 0x03;
/// GYRO_CONFIG: ±1000°/s.
const GYRO_1000_DEG_S: u8 = 0x10;
/// ACCEL_CONFIG: ±8 g.
const ACCEL_8_G: u8 = 0x10;
/// USER_CTRL: the chip is no master of the bus behind it …
const NO_MASTER: u8 = 0x00;
/// … INT_PIN_CFG: and joins it to the one before it, so that the magnetometer there answers.
const BYPASS: u8 = 0x02;
const COUNTS_PER_DEG_S: f64 = 32.8;
const COUNTS_PER_G: f64 = 4096.0;

const NAME: &str = "MPU-6050";
const RESET_S: f64 = 0.1;
/// Until the gyros have settled on the new clock.
const SETTLING_S: f64 = 0.05;

/// An MPU-6050, at 0x68 or 0x69.
#[derive(Clone, Debug)]
pub struct Mpu6050 {
    address: u8,
}

impl Mpu6050 {
    /// The chip at this address.
    pub fn new(address: u8) -> Self {
        Self { address }
    }
}

impl Companion for Mpu6050 {
    fn name(&self) -> &'static str {
        NAME
    }

    fn measures_force(&self) -> bool {
        true
    }

    /// By register 0x75, WHO_AM_I.
    fn identify(&self, bus: &mut dyn Bus) -> Result<(), ChipError> {
        let place = (self.address, WHO_AM_I);
        must_be(bus, NAME, place, "68", |found| found == IDENTITY)
    }

    fn start(&mut self, bus: &mut dyn Bus, clock: &mut dyn Clock) -> Result<(), ChipError> {
        self.identify(bus)?;
        bus.write(self.address, PWR_MGMT_1, RESET)?;
        pause(clock, RESET_S)?;
        let settings = [
            (PWR_MGMT_1, CLOCK_X),
            (SMPLRT_DIV, DIVIDER),
            (CONFIG, LOW_PASS_43_HZ),
            (GYRO_CONFIG, GYRO_1000_DEG_S),
            (ACCEL_CONFIG, ACCEL_8_G),
            (USER_CTRL, NO_MASTER),
            (INT_PIN_CFG, BYPASS),
        ];
        write_all(bus, self.address, &settings)?;
        pause(clock, SETTLING_S)
    }

    /// Accelerometer, temperature and gyro, in one transfer.
    fn read(&mut self, bus: &mut dyn Bus) -> Result<InertialSample, ChipError> {
        let mut bytes = [0; 14];
        bus.read(self.address, ACCEL_XOUT_H, &mut bytes)?;
        let [a, b, c, d, e, f, _, _, gyro @ ..] = bytes;
        let accel = big_endian(&[a, b, c, d, e, f]);
        let gyro = big_endian(&gyro);
        let [[gx, gy, gz], [ax, ay, az]] = [gyro, accel];
        Ok(InertialSample {
            raw: [gx, gy, gz, ax, ay, az],
            rate_rad_s: Some(scaled(gyro, (1.0 / COUNTS_PER_DEG_S).to_radians())),
            specific_force_m_s2: Some(scaled(accel, STANDARD_GRAVITY_M_S2 / COUNTS_PER_G)),
        })
    }

    fn verify(&mut self, bus: &mut dyn Bus) -> Result<(), ChipError> {
        let set = [
            (SMPLRT_DIV, DIVIDER),
            (CONFIG, LOW_PASS_43_HZ),
            (GYRO_CONFIG, GYRO_1000_DEG_S),
            (ACCEL_CONFIG, ACCEL_8_G),
        ];
        compare(bus, NAME, self.address, &set)
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::JumpingClock;
    use super::*;
    use crate::sensor::bus::fake::{FakeBus, Transfer::*};

    #[test]
    fn it_is_told_reset_set_up_and_opened_to_the_bus_behind() {
        let mut bus = FakeBus::default();
        bus.set(0x68, 0x75, &[0x68]);
        let mut clock = JumpingClock::default();
        let mut chip = Mpu6050::new(0x68);
        chip.start(&mut bus, &mut clock).unwrap();
        assert!(clock.now_s >= 0.15);
        let right = [
            Read(0x68, 0x75, 1),
            Write(0x68, 0x6B, 0x80),
            Write(0x68, 0x6B, 0x01),
            Write(0x68, 0x19, 4),
            Write(0x68, 0x1A, 0x03),
            Write(0x68, 0x1B, 0x10),
            Write(0x68, 0x1C, 0x10),
            Write(0x68, 0x6A, 0x00),
            Write(0x68, 0x37, 0x02),
        ];
        assert_eq!(bus.transfers(), right);
        chip.verify(&mut bus).unwrap();
        assert_eq!(bus.transfers(), [Read(0x68, 0x19, 4)]);
        bus.set(0x68, 0x19, &[0; 4]);
        assert_eq!(
            chip.verify(&mut bus).unwrap_err().code(),
            "configuration_lost"
        );
    }

    #[test]
    fn fourteen_registers_are_force_temperature_and_rate() {
        let mut bus = FakeBus::default();
        let bytes = [
            0x10, 0x00, 0xF0, 0x00, 0x00, 0x00, 0x12, 0x34, 0x01, 0x48, 0xFE, 0xB8, 0x00, 0x00,
        ];
        bus.set(0x68, 0x3B, &bytes);
        let motion = Mpu6050::new(0x68).read(&mut bus).unwrap();
        assert_eq!(bus.transfers(), [Read(0x68, 0x3B, 14)]);
        let rate = motion.rate_rad_s.unwrap().map(f64::to_degrees);
        let force = motion.specific_force_m_s2.unwrap();
        assert!((rate - nalgebra::Vector3::new(10.0, -10.0, 0.0)).norm() < 1e-9);
        assert!((force - nalgebra::Vector3::new(9.80665, -9.80665, 0.0)).norm() < 1e-9);
    }
}
