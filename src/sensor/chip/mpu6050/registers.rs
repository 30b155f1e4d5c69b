//! Registers of the MPU-6050 (kernel's `inv_mpu_iio.h`).

pub(super) const SMPLRT_DIV: u8 = 0x19;
pub(super) const CONFIG: u8 = 0x1A;
pub(super) const GYRO_CONFIG: u8 = 0x1B;
pub(super) const ACCEL_CONFIG: u8 = 0x1C;
pub(super) const INT_PIN_CFG: u8 = 0x37;
pub(super) const ACCEL_XOUT_H: u8 = 0x3B;
pub(super) const USER_CTRL: u8 = 0x6A;
pub(super) const PWR_MGMT_1: u8 = 0x6B;
pub(super) const WHO_AM_I: u8 = 0x75;

pub(super) const IDENTITY: u8 = 0x68;
/// PWR_MGMT_1: all registers to their defaults.
pub(super) const RESET: u8 = 0x80;
/// PWR_MGMT_1: awake, the X gyro's oscillator drives the PLL.
pub(super) const CLOCK_X: u8 = 0x01;
/// SMPLRT_DIV: 1 kHz / (4 + 1), 200 Hz: a reading is never older than 5 ms.
pub(super) const DIVIDER: u8 = 4;
/// CONFIG: low-pass of about 43 Hz, 1 kHz inside.
pub(super) const LOW_PASS_43_HZ: u8 = 0x03;
/// GYRO_CONFIG: ±1000°/s.
pub(super) const GYRO_1000_DEG_S: u8 = 0x10;
/// ACCEL_CONFIG: ±8 g.
pub(super) const ACCEL_8_G: u8 = 0x10;
/// USER_CTRL: the chip is no master of the bus behind it …
pub(super) const NO_MASTER: u8 = 0x00;
/// … INT_PIN_CFG: and joins it to the one before it, so that the magnetometer there answers.
pub(super) const BYPASS: u8 = 0x02;
pub(super) const COUNTS_PER_DEG_S: f64 = 32.8;
pub(super) const COUNTS_PER_G: f64 = 4096.0;
