//! What is asked of a candidate, and why each default is what it is.

use serde::{Deserialize, Serialize};

use crate::check::{Check, Fault, within};

/// What is asked of a candidate.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Limits {
    /// Planar: how much of the circle the samples must cover, degrees, 90 to 360. Below about 225° the
    /// parameters become several times less certain.
    pub coverage_deg: f64,
    /// Spatial: smallest eigenvalue of the covariance of the field's directions, 0 to 0.33. A level turn
    /// has almost none across its plane.
    pub direction_spread: f64,
    /// Largest share of samples that may be outliers, 0 to 0.5.
    pub outlier_share: f64,
    /// Largest residual, as a share of the field's strength, 0.001 to 0.5. Real boards leave 2 % under
    /// the diagonal model.
    pub residual_share: f64,
    /// Largest ratio of two axes' scale factors, 1 to 10.
    pub axis_ratio: f64,
    /// Smallest scale factor where a reference field was given, 0.01 to 1.
    pub scale_min: f64,
    /// Largest scale factor where a reference field was given, 1 to 100.
    pub scale_max: f64,
    /// Largest predicted uncertainty of a heading, RMS over all headings, degrees, 0.01 to 20. Real boards reach
    /// 0.6 to 0.8 under the diagonal model. In a turn the largest error is two to three times as much, and at 1.5
    /// a car that passed went through with an error of 4.4°.
    pub heading_sd_deg: f64,
    /// Largest disagreement of corrected heading and gyro, RMS, degrees, 0.5 to 45. A wobbling hand and a
    /// magnetometer that is 3° askew on its board make 7°.
    pub gyro_rms_deg: f64,
    /// Largest difference between the angle turned by the field and by the gyro, as a share, 0.01 to 0.5.
    pub gyro_angle_share: f64,
    /// Planar: largest jump of the corrected field in the gyro's frame, within a moment or a second, over the
    /// median of such changes, 3 to 1000. In 14,000 clean turns noise makes 4.8 at most in 999 of 1000, a real
    /// board's misfit 4.2. Every magnet that cost more than 1.2° of heading made 13 and more, in 2000 logs. Of
    /// 1000 logs of two turns with a car none was accepted at 6, of 1000 of a single turn 9, and six of those
    /// were 2.3 to 4.4° off: a swell as long as a quarter of the turn looks like a real board's misfit.
    pub jump_planar: f64,
    /// The same in space, where one turn is not like the other and a real board's misfit makes 8.4. Of 1000 logs
    /// with a car none was accepted at 10 with a heading error above 1.8°.
    pub jump_spatial: f64,
    /// Spatial: largest change of the dip with attitude, RMS, degrees, 0.5 to 45.
    pub dip_spread_deg: f64,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            coverage_deg: 240.0,
            direction_spread: 0.005,
            outlier_share: 0.1,
            residual_share: 0.06,
            axis_ratio: 2.0,
            scale_min: 0.2,
            scale_max: 5.0,
            heading_sd_deg: 1.0,
            gyro_rms_deg: 10.0,
            gyro_angle_share: 0.12,
            jump_planar: 6.0,
            jump_spatial: 10.0,
            dip_spread_deg: 6.0,
        }
    }
}

impl Check for Limits {
    fn check(&self) -> Vec<Fault> {
        let mut faults = Vec::new();
        let f = &mut faults;
        within(
            f,
            "coverage_deg",
            self.coverage_deg,
            90.0..=360.0,
            "degrees",
        );
        within(f, "direction_spread", self.direction_spread, 0.0..=0.33, "");
        within(f, "outlier_share", self.outlier_share, 0.0..=0.5, "");
        within(f, "residual_share", self.residual_share, 0.001..=0.5, "");
        within(f, "axis_ratio", self.axis_ratio, 1.0..=10.0, "");
        within(f, "scale_min", self.scale_min, 0.01..=1.0, "");
        within(f, "scale_max", self.scale_max, 1.0..=100.0, "");
        within(
            f,
            "heading_sd_deg",
            self.heading_sd_deg,
            0.01..=20.0,
            "degrees",
        );
        within(f, "gyro_rms_deg", self.gyro_rms_deg, 0.5..=45.0, "degrees");
        within(f, "gyro_angle_share", self.gyro_angle_share, 0.01..=0.5, "");
        within(f, "jump_planar", self.jump_planar, 3.0..=1000.0, "");
        within(f, "jump_spatial", self.jump_spatial, 3.0..=1000.0, "");
        within(
            f,
            "dip_spread_deg",
            self.dip_spread_deg,
            0.5..=45.0,
            "degrees",
        );
        faults
    }
}
