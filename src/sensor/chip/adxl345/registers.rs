//! Registers of the ADXL345 (kernel's `adxl345_core.c`).

pub(super) const DEVID: u8 = 0x00;
pub(super) const BW_RATE: u8 = 0x2C;
pub(super) const POWER_CTL: u8 = 0x2D;
pub(super) const DATA_FORMAT: u8 = 0x31;
pub(super) const DATAX0: u8 = 0x32;

pub(super) const IDENTITY: u8 = 0xE5;
/// BW_RATE: 200 Hz: a reading is never older than 5 ms.
pub(super) const RATE_200_HZ: u8 = 0x0B;
/// POWER_CTL: it boots in standby.
pub(super) const MEASURE: u8 = 0x08;
/// DATA_FORMAT: full resolution, ±16 g.
pub(super) const FULL_RESOLUTION_16_G: u8 = 0x0B;
/// At full resolution, in every range.
pub(super) const COUNTS_PER_G: f64 = 256.0;
