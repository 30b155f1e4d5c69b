//! Readings at the gyro's full scale: the board turned faster than they say.

use nalgebra::Vector3;

/// A reading within this part of a full scale that is known is taken as clipped.
const NEAR: f64 = 0.005;
/// An unknown full scale is recognised when an axis repeats its largest value exactly, this many times in a row.
const SAME: u32 = 3;
/// A full scale is larger than this, degrees per second. Gyros have 250 or more; some are set to less.
const LEAST_RANGE_DEG_S: f64 = 100.0;

/// Detects readings at the full scale, and finds the full scale if it is not configured.
#[derive(Default)]
pub(super) struct ClipWatch {
    range_deg_s: Option<f64>,
    /// Whether the full scale is configured.
    configured: bool,
    largest: f64,
    newest: Vector3<f64>,
    /// How often in a row each axis has read the same.
    same: [u32; 3],
    /// Whether the newest reading is at the full scale.
    pub(super) clipped: bool,
}

impl ClipWatch {
    pub(super) fn new(range_deg_s: Option<f64>) -> Self {
        Self {
            range_deg_s,
            configured: range_deg_s.is_some(),
            same: [1; 3],
            ..Self::default()
        }
    }

    /// Takes a reading in chip axes; `true` when it is the first good one after clipped ones.
    pub(super) fn take(&mut self, rate: &Vector3<f64>) -> bool {
        if !self.configured {
            self.seek_range(rate);
        }
        let was = self.clipped;
        self.clipped = self
            .range_deg_s
            .is_some_and(|range| rate.amax().to_degrees() >= range * (1.0 - NEAR));
        was && !self.clipped
    }

    /// An axis beyond its full scale repeats its reading, while the others vary.
    fn seek_range(&mut self, rate: &Vector3<f64>) {
        let constant = *rate == self.newest;
        for axis in 0..3 {
            self.same[axis] = if rate[axis] == self.newest[axis] {
                self.same[axis] + 1
            } else {
                1
            };
        }
        self.newest = *rate;
        if rate.amax() > self.largest {
            self.largest = rate.amax();
            // A larger rate shows a larger full scale.
            self.range_deg_s = None;
        }
        let at_largest = |axis: usize| self.same[axis] >= SAME && rate[axis].abs() >= self.largest;
        if !constant && self.largest.to_degrees() > LEAST_RANGE_DEG_S && (0..3).any(at_largest) {
            self.range_deg_s = Some(self.largest.to_degrees());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_full_scale_is_known_or_found_until_a_larger_rate_shows_it_wrong() {
        let at = |deg: f64| Vector3::new(0.0, -deg.to_radians(), 0.0);
        let mut known = ClipWatch::new(Some(300.0));
        assert!(!known.take(&at(250.0)) && !known.clipped);
        assert!(!known.take(&at(299.0)) && known.clipped);
        assert!(known.take(&at(100.0)));

        // 250 °/s is passed at full speed, 300 °/s is where this one ends.
        let mut found = ClipWatch::new(None);
        let rates = [
            250.0, 280.0, 300.0, 300.0, 300.0, 300.0, 260.0, 300.0, 310.0, 300.0,
        ];
        let clipped: Vec<bool> = rates
            .iter()
            .enumerate()
            .map(|(i, deg)| {
                found.take(&(at(*deg) + Vector3::x() * i as f64 * 0.01));
                found.clipped
            })
            .collect();
        assert_eq!(
            clipped,
            [
                false, false, false, false, true, true, false, true, false, false
            ]
        );
        // A gyro that reads the same on all axes tells nothing.
        let mut frozen = ClipWatch::new(None);
        assert!((0..20).all(|_| !frozen.take(&at(300.0)) && !frozen.clipped));
    }
}
