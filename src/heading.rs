//! What is published for each magnetometer reading.

use crate::check::words;
use crate::condition::Condition;

/// One published heading, the content of one `ATT` object. Unknown is `None`, never 0.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Heading {
    /// Counts the magnetometer readings from 1.
    pub seq: u64,
    /// Time of the magnetometer reading on the source's clock, seconds.
    pub t_s: f64,
    /// The condition in which it was made.
    pub condition: Condition,
    /// Fused magnetic heading, degrees clockwise from magnetic north, [0, 360).
    pub fused_deg: Option<f64>,
    /// Instantaneous magnetic heading from this reading alone, degrees.
    pub instantaneous_deg: Option<f64>,
    /// Heading from the uncorrected field, degrees.
    pub raw_deg: Option<f64>,
    /// One standard deviation of the published heading, degrees.
    pub sd_deg: Option<f64>,
    /// How far magnetic north is east of true north here, degrees; where it is known.
    pub declination_deg: Option<f64>,
    /// Nose up, degrees.
    pub pitch_deg: Option<f64>,
    /// Right wing down, degrees.
    pub roll_deg: Option<f64>,
    /// Rate of turn about the vertical, degrees a minute, clockwise as seen from above.
    pub turn_deg_min: Option<f64>,
    /// Angular rate freed of the gyro's bias, body axes, degrees a second.
    pub rate_deg_s: Option<[f64; 3]>,
    /// Specific force, body axes, m/s².
    pub specific_force_m_s2: Option<[f64; 3]>,
    /// How far the corrected field points below the horizontal, degrees.
    pub dip_deg: Option<f64>,
    /// Corrected field, body axes, milligauss; Z is unknown under a planar calibration.
    pub field_mgauss: Option<[Option<f64>; 3]>,
    /// Strength of the corrected field, milligauss: of what the calibration measures (planar: in its plane).
    pub strength_mgauss: Option<f64>,
    /// gpsd's `mag_st`.
    pub mag_status: MagStatus,
}

impl Heading {
    /// The magnetic heading that may be steered by: the fused one, or else that of this reading alone.
    pub fn magnetic_deg(&self) -> Option<f64> {
        let known = |angle: Option<f64>| angle.filter(|degrees| degrees.is_finite());
        known(self.fused_deg)
            .or(known(self.instantaneous_deg))
            .filter(|_| self.condition.may_steer())
    }

    /// The true heading, degrees, not wrapped: it may be below 0 or above 360.
    pub fn true_deg(&self) -> Option<f64> {
        Some(self.magnetic_deg()? + self.declination_deg?)
    }
}

words! {
    /// gpsd's status of the magnetometer (`mag_st`), of which we use four letters.
    #[derive(Default)]
    pub enum MagStatus {
        /// Normal.
        #[default]
        Normal = "N",
        /// Calibration alarm: uncalibrated, or a fault.
        Calibration = "C",
        /// Field strength above what the calibration expects, or beyond the chip's range.
        HighField = "P",
        /// Field strength below what the calibration expects.
        LowField = "L",
    }
}
