//! Whether the hard iron moves further than its deviation allows.
//!
//! A filter that learns a constant moves it within the deviation it had, and less and less. If the hard iron moves further, a magnet
//! has come onto the board, even one that is weaker than the field is uneven here, or the gyro has gone wrong, and the filter
//! changes the iron to agree with it. Another filter that becomes the active one moves the iron too: until it has settled, nobody
//! knows which of both it is.

use nalgebra::{Matrix3, Vector3};

use super::MEASURED;
use super::filter::Filter;

/// What was known is kept for one to two of these times, seconds: a magnet is to be told within 5 s.
const KEPT_S: f64 = 2.5;
/// The iron has moved when the squared distance, over the covariance it had, is beyond this: five deviations.
const MOVED: f64 = 25.0;

/// The hard iron as it was known, and the inverse of its covariance.
#[derive(Clone, Copy, Debug)]
struct KnownIron {
    bias_mgauss: Vector3<f64>,
    information: Matrix3<f64>,
}

/// Compares the hard iron with what was known of it before.
#[derive(Clone, Debug, Default)]
pub(super) struct IronWatch {
    /// The older one first.
    before: [Option<KnownIron>; 2],
    age_s: f64,
    /// Squared distance from what was known, in deviations.
    moved2: f64,
}

impl IronWatch {
    /// Takes what the filter knows, `period_s` after the last time.
    pub(super) fn take(&mut self, filter: &Filter, period_s: f64) {
        let iron = filter.bias_mgauss();
        self.age_s += period_s;
        if self.age_s > KEPT_S {
            self.age_s = 0.0;
            // Before it is measured, the iron moves as it is learnt.
            let known = filter.iron_known_within(MEASURED * filter.strength_mgauss());
            let inverse = filter.bias_covariance().try_inverse();
            let now = inverse.filter(|_| known).map(|information| KnownIron {
                bias_mgauss: iron,
                information,
            });
            self.before = [self.before[1], now];
        }
        let distances = self.before.iter().flatten().map(|known| {
            let moved = iron - known.bias_mgauss;
            moved.dot(&(known.information * moved))
        });
        self.moved2 = distances.fold(0.0, f64::max);
    }

    /// Whether the iron has moved lately.
    pub(super) fn moved(&self) -> bool {
        self.moved2 > MOVED
    }

    /// What the variance of a heading has to be multiplied with: what is known is known less well than it seems. Of three degrees of
    /// freedom.
    pub(super) fn excess(&self) -> f64 {
        if self.moved() { self.moved2 / 3.0 } else { 1.0 }
    }
}
