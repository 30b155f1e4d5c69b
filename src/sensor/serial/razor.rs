//! What text and binary output of the Razor AHRS firmware have in common: raw counts, and what they mean.
//!
//! Razor-AHRS/razor-9dof-ahrs 1.4.2, `Razor_AHRS.ino` and `Sensors.ino`. The firmware turns every chip into
//! the board's body frame (X to the edge with the connector holes, Y right, Z down) before it sends.

use nalgebra::Vector3;

use crate::reading::{Field, Reading};
use crate::sensor::chip::adxl345::ADXL345;
use crate::sensor::chip::itg3200::ITG3200;

/// Largest count of an ADXL345, at 16 g.
const ACCEL_MOST: f64 = 4096.0;
/// Largest count of an ITG-3200: 16 bits.
const GYRO_MOST: f64 = 32768.0;
/// HMC5843 and HMC5883L: 12 bits. An axis that overflowed reads -4096.
const MAG_MOST: f64 = 2048.0;

/// Three axes in counts; `None` is an axis without a number.
pub(super) type RazorCounts = [Option<f64>; 3];

/// Counts of accelerometer, magnetometer and gyro, the order in which the Razor sends them, as far as they were read.
pub(super) type RazorFrame = [Option<RazorCounts>; 3];

/// The frame in our units; its time is 0. The firmware stores gravity, we have specific force.
pub(super) fn reading([accel, mag, gyro]: RazorFrame, counts_per_gauss: f64) -> Reading {
    let whole = |counts: Option<RazorCounts>, most: f64| match counts? {
        [Some(x), Some(y), Some(z)] => Some(Vector3::new(x, y, z)).filter(|n| n.amax() <= most),
        _ => None,
    };
    Reading {
        t_s: 0.0,
        field_mgauss: mag.map(|counts| field(counts, counts_per_gauss)),
        rate_rad_s: whole(gyro, GYRO_MOST).and_then(|counts| ITG3200.rate_rad_s(counts)),
        specific_force_m_s2: whole(accel, ACCEL_MOST)
            .and_then(|counts| ADXL345.specific_force_m_s2(-counts)),
    }
}

/// On boards SEN-10183 and SEN-10321 the firmware reads negative counts of one axis as if they had no sign.
fn field(counts: RazorCounts, counts_per_gauss: f64) -> Field {
    counts.map(|axis| {
        let count = axis.map(|n| if n >= 32768.0 { n - 65536.0 } else { n })?;
        (count.abs() <= MAG_MOST).then_some(count * 1000.0 / counts_per_gauss)
    })
}
