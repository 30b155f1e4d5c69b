//! ADXL345: an accelerometer of ±16 g.

use super::companion::CompanionSheet;
use super::little_endian;

// Registers of the ADXL345 (kernel's `adxl345_core.c`).
const DEVID: u8 = 0x00;
const BW_RATE: u8 = 0x2C;
const POWER_CTL: u8 = 0x2D;
const DATA_FORMAT: u8 = 0x31;
const DATAX0: u8 = 0x32;

/// BW_RATE: 200 Hz: a reading is never older than 5 ms.
const RATE_200_HZ: u8 = 0x0B;
/// POWER_CTL: it boots in standby.
const MEASURE: u8 = 0x08;
/// DATA_FORMAT: full resolution, ±16 g.
const FULL_RESOLUTION_16_G: u8 = 0x0B;

/// An accelerometer ADXL345, at 0x53 or 0x1D.
pub static ADXL345: CompanionSheet = CompanionSheet {
    name: "ADXL345",
    who_am_i: DEVID,
    identity_mask: 0xFF,
    identity: 0xE5,
    identity_right: "e5",
    reset: None,
    setup: &[
        (DATA_FORMAT, FULL_RESOLUTION_16_G),
        (BW_RATE, RATE_200_HZ),
        (POWER_CTL, MEASURE),
    ],
    settling_s: 0.0,
    held: &[(BW_RATE, RATE_200_HZ), (POWER_CTL, MEASURE)],
    data: (DATAX0, 6),
    counts: |bytes| {
        let [x, y, z] = little_endian(bytes);
        [0, 0, 0, x, y, z]
    },
    counts_per_deg_s: None,
    // At full resolution, in every range.
    counts_per_g: Some(256.0),
};

#[cfg(test)]
mod tests {
    use super::super::companion::tests::started;
    use super::*;
    use crate::sensor::bus::fake::{FakeBus, Transfer::*};

    #[test]
    fn it_is_told_and_set_to_measure() {
        let (transfers, _) = started(&ADXL345, 0x53, 0xE5);
        let right = [
            Read(0x53, 0x00, 1),
            Write(0x53, 0x31, 0x0B),
            Write(0x53, 0x2C, 0x0B),
            Write(0x53, 0x2D, 0x08),
            Read(0x53, 0x2C, 2),
        ];
        assert_eq!(transfers, right);
    }

    #[test]
    fn six_registers_low_byte_first_are_a_force() {
        let mut bus = FakeBus::default();
        bus.set(0x53, 0x32, &[0x00, 0x01, 0x00, 0xFF, 0x80, 0x00]);
        let motion = ADXL345.at(0x53).read(&mut bus).unwrap();
        assert_eq!(bus.transfers(), [Read(0x53, 0x32, 6)]);
        assert_eq!(motion.raw, [0, 0, 0, 256, -256, 128]);
        let force = motion.specific_force_m_s2.unwrap();
        assert!((force - nalgebra::Vector3::new(9.80665, -9.80665, 4.903325)).norm() < 1e-9);
    }
}
