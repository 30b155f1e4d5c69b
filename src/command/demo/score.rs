//! How far headings are from the truth.

use std::collections::HashMap;
use std::fmt;

use crate::sensor::simulator::Simulator;

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
            let error_deg = difference_deg(heading_deg, truth_deg);
            self.count += 1;
            self.sum_of_squares += error_deg * error_deg;
            self.worst_deg = self.worst_deg.max(error_deg.abs());
        }
    }

    /// The root mean square, degrees, unless nothing was counted.
    pub(super) fn rms_deg(&self) -> Option<f64> {
        (self.count > 0).then(|| (self.sum_of_squares / f64::from(self.count)).sqrt())
    }

    /// How many headings were counted.
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

/// The way from one heading to another, −180 to 180 degrees.
fn difference_deg(to_deg: f64, from_deg: f64) -> f64 {
    (to_deg - from_deg + 540.0).rem_euclid(360.0) - 180.0
}

/// The true heading of every magnetometer reading.
pub(super) struct Truth {
    headings_deg: HashMap<i64, f64>,
}

impl Truth {
    pub(super) fn of(simulator: Simulator) -> Self {
        let known = simulator.filter_map(|entry| {
            let truth_deg = entry.heading_truth_rad?.to_degrees();
            Some((micros(entry.reading.t_s), truth_deg))
        });
        Self {
            headings_deg: known.collect(),
        }
    }

    pub(super) fn heading_deg(&self, t_s: f64) -> Option<f64> {
        self.headings_deg.get(&micros(t_s)).copied()
    }
}

/// The socket tells time to the microsecond.
fn micros(t_s: f64) -> i64 {
    (t_s * 1e6).round() as i64
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
