//! The vertical field that a tilt lets into the plane of a planar calibration, learnt while the board is used.
//!
//! A level turn says nothing about the vertical field Z, and at a dip of 70° each degree of tilt turns
//! the heading by up to 3°. But Z shows as soon as the board tilts a little this way and that: the strength
//! of the field in the plane changes by Z times the tilt towards it. Z is the answer to a regression with one
//! unknown, and its uncertainty goes into that of the heading.

/// What Z may be before anything is known, one standard deviation, milligauss: 2.5 times the horizontal field
/// of middle latitudes, a dip of 68°.
const USUAL_MGAUSS: f64 = 400.0;

/// Samples are not independent, and a plane is never quite that of the turn: their noise counts this
/// much more.
const CAUTION: f64 = 5.0;

/// What was learnt fades over this time, seconds, since the board may be carried to another place.
const FADE_S: f64 = 120.0;

/// The regression.
#[derive(Clone, Copy, Debug)]
pub struct VerticalField {
    noise_mgauss: f64,
    xx: f64,
    xe: f64,
}

impl VerticalField {
    /// Nothing known yet; `noise_mgauss` is that of a sample.
    pub fn new(noise_mgauss: f64) -> Self {
        Self {
            noise_mgauss: CAUTION * noise_mgauss.max(0.1),
            xx: 0.0,
            xe: 0.0,
        }
    }

    /// A sample: the tilt towards the field in the plane (a sine), by how much the strength is off, and the
    /// time since the sample before. One that no vertical field on earth explains teaches nothing.
    pub fn learn(&mut self, tilt: f64, off_mgauss: f64, period_s: f64) {
        if off_mgauss.abs() > 2.0 * USUAL_MGAUSS * tilt.abs() + self.noise_mgauss {
            return;
        }
        let fade = (-period_s.clamp(0.0, FADE_S) / FADE_S).exp();
        self.xx = self.xx * fade + tilt * tilt;
        self.xe = self.xe * fade + tilt * off_mgauss;
    }

    fn prior(&self) -> f64 {
        (self.noise_mgauss / USUAL_MGAUSS).powi(2)
    }

    /// Z, milligauss, positive down; 0 until something is known.
    pub fn mgauss(&self) -> f64 {
        self.xe / (self.xx + self.prior())
    }

    /// One standard deviation of Z, milligauss.
    pub fn sd_mgauss(&self) -> f64 {
        self.noise_mgauss / (self.xx + self.prior()).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_is_known_before_a_tilt() {
        let mut vertical = VerticalField::new(2.0);
        for _ in 0..1000 {
            vertical.learn(0.0, 1.0, 0.025);
        }
        assert_eq!(vertical.mgauss(), 0.0);
        assert!((vertical.sd_mgauss() - USUAL_MGAUSS).abs() < 1e-9);
    }

    #[test]
    fn a_small_wobble_tells_it() {
        let mut vertical = VerticalField::new(2.0);
        for i in 0..400 {
            let tilt = 0.05 * (f64::from(i) * 0.05).sin();
            vertical.learn(tilt, 527.0 * tilt, 0.025);
        }
        assert!((vertical.mgauss() - 527.0).abs() < 3.0 * vertical.sd_mgauss());
        assert!(vertical.sd_mgauss() < 20.0, "{}", vertical.sd_mgauss());
    }

    #[test]
    fn a_magnet_is_not_taken_for_it() {
        let mut vertical = VerticalField::new(2.0);
        for _ in 0..400 {
            vertical.learn(0.01, 150.0, 0.025);
        }
        assert_eq!(vertical.mgauss(), 0.0);
    }
}
