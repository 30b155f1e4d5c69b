//! Registers of the ITG-3200 (kernel's `itg3200.h`, data sheet PS-ITG-3200A).

pub(super) const WHO_AM_I: u8 = 0x00;
pub(super) const SMPLRT_DIV: u8 = 0x15;
pub(super) const DLPF_FS: u8 = 0x16;
pub(super) const GYRO_XOUT_H: u8 = 0x1D;
pub(super) const PWR_MGM: u8 = 0x3E;

/// WHO_AM_I without the lowest bit, which follows the pin AD0, and the highest.
pub(super) const IDENTITY: u8 = 0x34;
/// PWR_MGM: all registers to their defaults.
pub(super) const RESET: u8 = 0x80;
/// PWR_MGM: awake, the X gyro's oscillator drives the PLL.
pub(super) const CLOCK_X: u8 = 0x01;
/// DLPF_FS: ±2000°/s (the only good range), low-pass 42 Hz, 1 kHz inside.
pub(super) const FULL_SCALE_42_HZ: u8 = 0x1B;
/// SMPLRT_DIV: 1 kHz / (4 + 1), 200 Hz: a reading is never older than 5 ms.
pub(super) const DIVIDER: u8 = 4;
/// Counts for one degree a second.
pub(super) const COUNTS_PER_DEG_S: f64 = 14.375;
