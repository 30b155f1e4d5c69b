//! The time of day of a log's readings, where the log says when it was begun.

use std::time::Duration;

use super::Header;
use crate::date::{LATEST, parse_rfc3339};

/// The key of a header under which the time of the first reading is.
pub const RECORDED_FROM: &str = "recorded_from";

/// Brings the times of a log's readings to the time of day.
#[derive(Clone, Copy, Debug)]
pub struct TimeOfDay {
    begun: Option<Duration>,
    first_s: Option<f64>,
}

impl TimeOfDay {
    /// Of a log with this header.
    pub fn new(header: &Header) -> Self {
        Self {
            begun: header.recorded_from().and_then(parse_rfc3339),
            first_s: None,
        }
    }

    /// The time of day of the reading at `t_s`, since 1970. The first reading has the header's time. `None` without one,
    /// in a new stretch, and after the year 9998, which only a wrong clock gives.
    pub fn at(&mut self, t_s: f64) -> Option<Duration> {
        let first_s = *self.first_s.get_or_insert(t_s);
        let since = Duration::try_from_secs_f64(t_s - first_s).ok()?;
        self.begun?.checked_add(since).filter(|time| *time < LATEST)
    }

    /// The times of the readings that follow have nothing to do with those before.
    pub fn begin_stretch(&mut self) {
        self.begun = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::date::rfc3339;

    #[test]
    fn the_first_reading_is_of_the_time_in_the_header_until_the_time_jumps() {
        let header = |text: &str| Header {
            truth: vec![(RECORDED_FROM.to_owned(), text.to_owned())],
            ..Header::default()
        };
        let mut of_log = TimeOfDay::new(&header("2026-11-21T10:00:00.500Z"));
        assert_eq!(
            [7.25, 7.5, 67.25].map(|t_s| of_log.at(t_s).map(rfc3339).unwrap()),
            [
                "2026-11-21T10:00:00.500Z",
                "2026-11-21T10:00:00.750Z",
                "2026-11-21T10:01:00.500Z"
            ]
        );
        // 1e12 is the latest time of a row: some 30,000 years.
        for late_s in [1e12, 1e300] {
            assert_eq!(of_log.at(late_s), None);
        }
        of_log.begin_stretch();
        assert_eq!(of_log.at(0.0), None);
        assert_eq!(TimeOfDay::new(&header("yesterday")).at(0.0), None);
        assert_eq!(TimeOfDay::new(&Header::default()).at(0.0), None);
    }
}
