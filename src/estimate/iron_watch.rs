//! Detects a hard-iron estimate that moves further than its covariance allows.
//!
//! While a filter learns a constant, each change stays within the deviation of the estimate before it. A larger change of the hard iron has
//! one of two causes: a magnet was attached to the board, possibly weaker than the unevenness of the field here, or the gyro is wrong and
//! the filter adapts the iron to it. The watch is not reset when a rival becomes active: the iron may jump then too, and the cause is
//! equally open.

use nalgebra::{Matrix3, Vector3};

use super::MEASURED;
use super::filter::Filter;

/// The older of the two kept irons is one to two of these times old, seconds: a magnet must be detected within 5 s.
const KEPT_S: f64 = 2.5;
/// Normalised squared distance beyond which the iron has moved: five deviations.
const MOVED2: f64 = 25.0;

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
    /// Normalised squared distance from the known iron, the larger of both.
    moved2: f64,
}

impl IronWatch {
    /// Takes the filter's hard iron, `period_s` after the last sample.
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
        self.moved2 > MOVED2
    }

    /// Factor on the variance of a heading, at least 1: the normalised squared distance per degree of freedom, of which there are three.
    pub(super) fn excess(&self) -> f64 {
        if self.moved() { self.moved2 / 3.0 } else { 1.0 }
    }
}
