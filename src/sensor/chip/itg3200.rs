//! ITG-3200 and ITG-3205: gyros of ±2000°/s.

use super::big_endian;
use super::companion::CompanionSheet;

// Registers of the ITG-3200 (kernel's `itg3200.h`, data sheet PS-ITG-3200A).
const WHO_AM_I: u8 = 0x00;
const SMPLRT_DIV: u8 = 0x15;
const DLPF_FS: u8 = 0x16;
const GYRO_XOUT_H: u8 = 0x1D;
const PWR_MGM: u8 = 0x3E;

/// PWR_MGM: all registers to their defaults.
const RESET: u8 = 0x80;
/// PWR_MGM: awake, the X gyro's oscillator drives the PLL.
const CLOCK_X: u8 = 0x01;
/// DLPF_FS: ±2000°/s (the only good range), low-pass 42 Hz, 1 kHz inside.
const FULL_SCALE_42_HZ: u8 = 0x1B;
/// SMPLRT_DIV: 1 kHz / (4 + 1), 200 Hz: a reading is never older than 5 ms.
const DIVIDER: u8 = 4;
/// The kernel waits 1.5 ms after a reset.
const RESET_S: f64 = 0.002;

/// A gyro ITG-3200 or ITG-3205, at 0x68 or 0x69.
pub static ITG3200: CompanionSheet = CompanionSheet {
    name: "ITG-3200",
    who_am_i: WHO_AM_I,
    // The lowest bit follows the pin AD0, the highest is reserved.
    identity_mask: 0x7E,
    identity: 0x68,
    identity_right: "68 or 69",
    reset: Some((PWR_MGM, RESET, RESET_S)),
    setup: &[
        (PWR_MGM, CLOCK_X),
        (SMPLRT_DIV, DIVIDER),
        (DLPF_FS, FULL_SCALE_42_HZ),
    ],
    settling_s: 0.05,
    held: &[(SMPLRT_DIV, DIVIDER), (DLPF_FS, FULL_SCALE_42_HZ)],
    data: (GYRO_XOUT_H, 6),
    counts: |bytes| {
        let [x, y, z] = big_endian(bytes);
        [x, y, z, 0, 0, 0]
    },
    counts_per_deg_s: Some(14.375),
    counts_per_g: None,
};

#[cfg(test)]
mod tests {
    use super::super::companion::tests::started;
    use super::*;
    use crate::sensor::bus::fake::{FakeBus, Transfer::*};

    #[test]
    fn it_is_told_reset_and_set_up() {
        let (transfers, takes_s) = started(&ITG3200, 0x69, 0x69);
        assert!((0.051..0.06).contains(&takes_s));
        let right = [
            Read(0x69, 0x00, 1),
            Write(0x69, 0x3E, 0x80),
            Write(0x69, 0x3E, 0x01),
            Write(0x69, 0x15, 4),
            Write(0x69, 0x16, 0x1B),
            Read(0x69, 0x15, 2),
        ];
        assert_eq!(transfers, right);
    }

    #[test]
    fn six_registers_are_a_rate() {
        let mut bus = FakeBus::default();
        // 14375 counts are 1000 degrees a second.
        bus.set(0x68, 0x1D, &[0x38, 0x27, 0xC7, 0xD9, 0xFF, 0xFF]);
        let motion = ITG3200.at(0x68).read(&mut bus).unwrap();
        assert_eq!(bus.transfers(), [Read(0x68, 0x1D, 6)]);
        assert_eq!(motion.raw, [14375, -14375, -1, 0, 0, 0]);
        let rate = motion.rate_rad_s.unwrap().map(f64::to_degrees);
        assert!((rate.x - 1000.0).abs() < 1e-9 && (rate.y + 1000.0).abs() < 1e-9);
        assert!((rate.z.to_radians() + 0.001_214_1).abs() < 1e-6);
    }
}
