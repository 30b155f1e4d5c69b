//! MPU-6050: gyro (±1000°/s) and accelerometer (±8 g) in one, with a bus of its own behind it.
//!
//! A magnetometer on that bus answers only while the bypass is on, so this chip is set up before it.

use super::big_endian;
use super::companion::CompanionSheet;

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

/// An MPU-6050, at 0x68 or 0x69.
pub static MPU6050: CompanionSheet = CompanionSheet {
    name: "MPU-6050",
    who_am_i: WHO_AM_I,
    identity_mask: 0xFF,
    identity: 0x68,
    identity_right: "68",
    reset: Some((PWR_MGMT_1, RESET, 0.1)),
    setup: &[
        (PWR_MGMT_1, CLOCK_X),
        (SMPLRT_DIV, DIVIDER),
        (CONFIG, LOW_PASS_43_HZ),
        (GYRO_CONFIG, GYRO_1000_DEG_S),
        (ACCEL_CONFIG, ACCEL_8_G),
        (USER_CTRL, NO_MASTER),
        (INT_PIN_CFG, BYPASS),
    ],
    // The gyros settle on the new clock.
    settling_s: 0.05,
    held: &[
        (SMPLRT_DIV, DIVIDER),
        (CONFIG, LOW_PASS_43_HZ),
        (GYRO_CONFIG, GYRO_1000_DEG_S),
        (ACCEL_CONFIG, ACCEL_8_G),
    ],
    // Accelerometer, temperature and gyro.
    data: (ACCEL_XOUT_H, 14),
    counts: |bytes| {
        let [[ax, ay, az], [gx, gy, gz]] = [big_endian(bytes), big_endian(&bytes[8..])];
        [gx, gy, gz, ax, ay, az]
    },
    counts_per_deg_s: Some(32.8),
    counts_per_g: Some(4096.0),
};

#[cfg(test)]
mod tests {
    use super::super::companion::tests::started;
    use super::*;
    use crate::sensor::bus::fake::{FakeBus, Transfer::*};

    #[test]
    fn it_is_told_reset_set_up_and_opened_to_the_bus_behind() {
        let (transfers, takes_s) = started(&MPU6050, 0x68, 0x68);
        assert!(takes_s >= 0.15);
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
            Read(0x68, 0x19, 4),
        ];
        assert_eq!(transfers, right);
    }

    #[test]
    fn fourteen_registers_are_force_temperature_and_rate() {
        let mut bus = FakeBus::default();
        let bytes = [
            0x10, 0x00, 0xF0, 0x00, 0x00, 0x00, 0x12, 0x34, 0x01, 0x48, 0xFE, 0xB8, 0x00, 0x00,
        ];
        bus.set(0x68, 0x3B, &bytes);
        let motion = MPU6050.at(0x68).read(&mut bus).unwrap();
        assert_eq!(bus.transfers(), [Read(0x68, 0x3B, 14)]);
        let rate = motion.rate_rad_s.unwrap().map(f64::to_degrees);
        let force = motion.specific_force_m_s2.unwrap();
        assert!((rate - nalgebra::Vector3::new(10.0, -10.0, 0.0)).norm() < 1e-9);
        assert!((force - nalgebra::Vector3::new(9.80665, -9.80665, 0.0)).norm() < 1e-9);
    }
}
