//! Which directions a turning board has shown.

/// Sectors of the circle.
pub(super) const SECTORS: usize = 16;

/// Their names, clockwise from north.
const NAMES: [&str; SECTORS] = [
    "N", "NNE", "NE", "ENE", "E", "ESE", "SE", "SSE", "S", "SSW", "SW", "WSW", "W", "WNW", "NW",
    "NNW",
];

/// A longer time between two headings is a hole, in which the board may have turned unseen, seconds.
const LONGEST_STEP_S: f64 = 1.0;

/// The directions shown since the last calibration, or since a turn began. Before there is a heading they are counted by
/// the gyro, from wherever the raw heading was at first: a raw heading alone may never come round.
#[derive(Clone, Debug, Default)]
pub(super) struct Directions {
    seen: [bool; SECTORS],
    last: Option<(f64, f64)>,
}

impl Directions {
    /// Begins anew.
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

    /// The names of those that have not.
    pub(super) fn missing(&self) -> Vec<&'static str> {
        let pairs = NAMES.iter().zip(self.seen);
        pairs
            .filter_map(|(name, seen)| (!seen).then_some(*name))
            .collect()
    }
}

fn sector(degrees: f64) -> usize {
    let width = 360.0 / SECTORS as f64;
    ((degrees / width).round().rem_euclid(SECTORS as f64)) as usize % SECTORS
}
