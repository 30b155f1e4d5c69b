//! How much a sample tells of the hard iron, the matrix and the gyro's bias: less if its innovation repeats the one before.
//!
//! Innovations are white where the model holds. What the model leaves out makes them alike: a hum, an acceleration that tilts the frame. If
//! each of them counts as new evidence, a hum of 20 mG at 2 Hz teaches a robot twice its field within minutes, and headings that are wrong
//! by 27° at a deviation of 1.4°.
//!
//! N samples of noise with the correlation ρ from one to the next tell as much as N (1 − ρ) / (1 + ρ) white ones (Bayley & Hammersley,
//! J. R. Stat. Soc. Suppl. 8, 1946, for AR(1)). Here ρ is what exceeds the usual correlation. A sample reduces the variance by that share of
//! what it otherwise would.

use nalgebra::Vector3;

/// The correlation is averaged over this time in motion, seconds, which is about that of a turn. With 15 s accelerations in a car's turns
/// have no effect; with 2.5 s cars have their first heading a quarter later.
const MEAN_S: f64 = 5.0;
/// Largest weight of one sample in the mean, for long periods.
const MOST_WEIGHT: f64 = 0.5;
/// Correlation that needs no cause: recorded chips have up to 0.15 in motion, those that a hand shakes up to 0.3; a hum of 20 mG has 0.5 to 0.7.
/// With 0.2 a hand that shakes and swings the board has headings that are off by more than 2.5° in 26 instead of 23 % of the logs.
const USUAL: f64 = 0.3;
/// Mean normalised square of an innovation on three axes.
const EXPECTED: f64 = 3.0;

/// Follows the innovations of one filter.
#[derive(Clone, Copy)]
pub(super) struct Whiteness {
    last: Option<Vector3<f64>>,
    /// Means of the products of an innovation with the one before and with itself, by the inverse of its covariance.
    product: f64,
    square: f64,
}

/// As though white innovations had come before: a filter's first ones are alike, since it has yet to learn everything.
impl Default for Whiteness {
    fn default() -> Self {
        Self {
            last: None,
            product: 0.0,
            square: EXPECTED,
        }
    }
}

impl Whiteness {
    /// Takes an innovation, the same multiplied by the inverse of its covariance, and the time since the one before, seconds.
    pub(super) fn take(
        &mut self,
        innovation: &Vector3<f64>,
        weighted: &Vector3<f64>,
        period_s: f64,
    ) {
        let Some(last) = self.last.replace(*innovation) else {
            return;
        };
        let weight = (period_s / MEAN_S).min(MOST_WEIGHT);
        self.product += weight * (last.dot(weighted) - self.product);
        self.square += weight * (innovation.dot(weighted) - self.square);
    }

    /// The next innovation does not follow on the last: the board is still, or a sample was left out.
    pub(super) fn interrupt(&mut self) {
        self.last = None;
    }

    /// The share, 0 to 1, of a correction that is taken back: √(2ρ / (1 + ρ)), since covariances take back its square.
    pub(super) fn held(&self) -> f64 {
        if self.product <= USUAL * self.square {
            return 0.0;
        }
        // A correlation is at most 1; while innovations fade, the quotient of the two means may be more.
        let correlation = (self.product / self.square - USUAL).min(1.0 - USUAL);
        (2.0 * correlation / (1.0 + correlation)).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;

    /// The share that is held after a minute of these innovations along X, by number, at 25 Hz.
    fn held_after(innovation: impl Fn(u32) -> f64) -> f64 {
        let mut whiteness = Whiteness::default();
        for index in 0..1500 {
            let along = Vector3::x() * innovation(index);
            whiteness.take(&along, &along, 0.04);
        }
        whiteness.held()
    }

    #[test]
    fn a_hum_holds_the_parameters_and_noise_does_not() {
        let hum = |hz: f64| held_after(|index| (TAU * hz * 0.04 * f64::from(index)).sin());
        // ρ is the cosine of the step, 0.876 at 2 Hz.
        let expected = |correlation: f64| (2.0 * correlation / (1.0 + correlation)).sqrt();
        assert!(
            (hum(2.0) - expected(0.876 - USUAL)).abs() < 0.02,
            "{}",
            hum(2.0)
        );
        assert!(hum(0.1) > 0.8, "{}", hum(0.1));
        // A quarter of a period in each step, and more.
        assert_eq!(hum(6.25), 0.0);
        assert_eq!(hum(10.0), 0.0);
        let noise = |index: u32| {
            f64::from(index.wrapping_mul(2_654_435_761) >> 8) / f64::from(1 << 23) - 1.0
        };
        assert_eq!(held_after(noise), 0.0);
        assert_eq!(held_after(|_| 0.0), 0.0);
    }

    #[test]
    fn what_does_not_follow_on_is_not_compared() {
        let mut whiteness = Whiteness::default();
        for _ in 0..100 {
            whiteness.take(&Vector3::x(), &Vector3::x(), 0.04);
            whiteness.interrupt();
        }
        assert_eq!(whiteness.held(), 0.0);
    }
}
