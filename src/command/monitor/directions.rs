//! Which directions a turning board has shown.

pub(super) const SECTORS: usize = 16;

/// Their names, clockwise from north.
const NAMES: [&str; SECTORS] = [
    "N", "NNE", "NE", "ENE", "E", "ESE", "SE", "SSE", "S", "SSW", "SW", "WSW", "W", "WNW", "NW",
    "NNW",
];

/// A longer time between two headings is a gap, in which the board may have turned unseen, seconds.
const LONGEST_STEP_S: f64 = 1.0;

/// The directions shown since the last calibration, or since a turn began. Before there is a heading they are counted by
/// the gyro, from wherever the raw heading was at first: a raw heading alone may never come round.
#[derive(Clone, Debug, Default)]
pub(super) struct Directions {
    seen: [bool; SECTORS],
    last: Option<(f64, f64)>,
}

impl Directions {
    pub(super) fn clear(&mut self) {
        self.seen = [false; SECTORS];
    }

    /// Takes a heading's time, the heading or else the raw one, whether it is to be trusted, and the rate of turn.
    pub(super) fn take(&mut self, t_s: f64, degrees: f64, trusted: bool, rate_deg_s: Option<f64>) {
        let direction = match (self.last, rate_deg_s) {
            (Some((last_s, last)), Some(rate)) if !trusted => {
                let step_s = t_s - last_s;
                if (0.0..LONGEST_STEP_S).contains(&step_s) {
                    last + rate * step_s
                } else {
                    degrees
                }
            }
            _ => degrees,
        };
        self.last = Some((t_s, direction));
        self.seen[sector(direction)] = true;
    }

    /// Whether this direction, degrees, has been shown.
    pub(super) fn has(&self, degrees: f64) -> bool {
        self.seen[sector(degrees)]
    }

    /// The names of those that have not, clockwise, neighbours together: `E to SW, NW`.
    pub(super) fn missing(&self) -> String {
        let Some(begin) = self.seen.iter().position(|seen| *seen) else {
            return "all".to_owned();
        };
        let mut runs: Vec<Vec<&str>> = vec![Vec::new()];
        for sector in (0..SECTORS).map(|i| (begin + i) % SECTORS) {
            match runs.last_mut() {
                Some(run) if !self.seen[sector] => run.push(NAMES[sector]),
                _ => runs.push(Vec::new()),
            }
        }
        let words = runs.iter().filter_map(|run| match run.as_slice() {
            [] => None,
            [one] => Some((*one).to_owned()),
            [first, .., last] => Some(format!("{first} to {last}")),
        });
        words.collect::<Vec<_>>().join(", ")
    }
}

fn sector(degrees: f64) -> usize {
    let width = 360.0 / SECTORS as f64;
    ((degrees / width).round().rem_euclid(SECTORS as f64)) as usize % SECTORS
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_missing_is_told_with_neighbours_together() {
        let missing = |shown: &[usize]| {
            let mut directions = Directions::default();
            for sector in shown {
                directions.seen[*sector] = true;
            }
            directions.missing()
        };
        assert_eq!(missing(&[]), "all");
        assert_eq!(missing(&[1]), "NE to N");
        assert_eq!(missing(&[0, 1, 2, 3, 11, 13]), "E to SW, W, NW to NNW");
        assert_eq!(
            missing(&[1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14]),
            "NNW to N"
        );
        assert_eq!(missing(&(0..SECTORS).collect::<Vec<_>>()), "");
    }
}
