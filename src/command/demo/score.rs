//! How far headings are from the truth.

use std::fmt;

use crate::frame::wrap_pi;

/// Angles between headings and the truth.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Score {
    count: u32,
    sum_of_squares: f64,
    worst_deg: f64,
}

impl Score {
    /// Counts a heading, if there is one.
    pub(super) fn count(&mut self, heading_deg: Option<f64>, truth_deg: f64) {
        if let Some(heading_deg) = heading_deg {
            let error_deg = wrap_pi((heading_deg - truth_deg).to_radians()).to_degrees();
            self.count += 1;
            self.sum_of_squares += error_deg * error_deg;
            self.worst_deg = self.worst_deg.max(error_deg.abs());
        }
    }

    /// The root mean square, degrees, unless nothing was counted.
    pub(super) fn rms_deg(&self) -> Option<f64> {
        (self.count > 0).then(|| (self.sum_of_squares / f64::from(self.count)).sqrt())
    }

    pub(super) fn headings(&self) -> u32 {
        self.count
    }
}

impl fmt::Display for Score {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.rms_deg() {
            Some(rms_deg) => write!(f, "{rms_deg:5.2}° RMS, {:5.2}° at worst", self.worst_deg),
            None => f.write_str("none was published"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_go_the_short_way_round() {
        let mut score = Score::default();
        assert_eq!(score.rms_deg(), None);
        score.count(Some(1.0), 358.0);
        score.count(Some(356.0), 0.0);
        score.count(None, 90.0);
        assert_eq!(score.headings(), 2);
        assert!((score.rms_deg().unwrap() - 12.5f64.sqrt()).abs() < 1e-12);
        assert_eq!(score.to_string(), " 3.54° RMS,  4.00° at worst");
    }
}
