//! What is asked of a candidate.

use super::Measures;
use crate::check::settings;

settings! {
    /// What is asked of a candidate.
    pub struct Limits {
        /// Planar: how much of the circle the samples must cover, degrees. Below about 225° the
        /// parameters become several times less certain.
        coverage_deg: f64 = 240.0, 90.0..=360.0, "degrees";
        /// Spatial: smallest eigenvalue of the covariance of the field's directions. A level turn has almost none across its plane; 0.005
        /// is a swing of 4° RMS.
        direction_spread: f64 = 0.005, 0.0..=0.33, "";
        /// Largest share of samples that may be outliers.
        outlier_share: f64 = 0.1, 0.0..=0.5, "";
        /// Largest residual, as a share of the field's strength. Real boards leave 2 % under
        /// the diagonal model.
        residual_share: f64 = 0.06, 0.001..=0.5, "";
        /// Largest ratio of two axes' scale factors.
        axis_ratio: f64 = 2.0, 1.0..=10.0, "";
        /// Smallest scale factor where a reference field was given.
        scale_min: f64 = 0.2, 0.01..=1.0, "";
        /// Largest scale factor where a reference field was given.
        scale_max: f64 = 5.0, 1.0..=100.0, "";
        /// Largest predicted uncertainty of a heading, RMS over all headings, degrees. Real boards reach
        /// 0.6 to 0.8 under the diagonal model. In a turn the largest error is two to three times as much, and at 1.5
        /// a car that passed went through with an error of 4.4°.
        heading_sd_deg: f64 = 1.0, 0.01..=20.0, "degrees";
        /// Largest disagreement of corrected heading and gyro, RMS, degrees. A wobbling hand and a
        /// magnetometer that is 3° askew on its board make 7°.
        gyro_rms_deg: f64 = 10.0, 0.5..=45.0, "degrees";
        /// Largest difference between the angle turned by the field and by the gyro, as a share.
        gyro_angle_share: f64 = 0.12, 0.01..=0.5, "";
        /// Planar: largest jump of the corrected field in the gyro's frame, within a moment or a second, over the
        /// median of such changes. In 14,000 clean turns noise makes 4.8 at most in 999 of 1000, a real
        /// board's misfit 4.2. Every magnet that cost more than 1.2° of heading made 13 and more, in 2000 logs. Of
        /// 1000 logs of two turns with a car none was accepted at 6, of 1000 of a single turn 9, and six of those
        /// were 2.3 to 4.4° off: a swell as long as a quarter of the turn looks like a real board's misfit.
        jump_planar: f64 = 6.0, 3.0..=1000.0, "";
        /// The same in space, where one turn is not like the other and a real board's misfit makes 8.4. Of 1000 logs
        /// with a car none was accepted at 10 with a heading error above 1.8°.
        jump_spatial: f64 = 10.0, 3.0..=1000.0, "";
        /// Spatial: largest change of the dip with attitude, RMS, degrees.
        dip_spread_deg: f64 = 6.0, 0.5..=45.0, "degrees";
    }
}

impl Limits {
    /// The largest jump that a turn with these measures may show, times the usual.
    pub fn largest_jump(&self, m: &Measures) -> f64 {
        match m.coverage_deg {
            Some(_) => self.jump_planar,
            None => self.jump_spatial,
        }
    }
}
