//! The samples of a log of any length, in bounded memory: when they become too many, those between turns are thinned
//! out first, evenly over the whole log.

use super::FieldSample;
use crate::turn::Turn;

/// The most samples that are kept: 87 minutes at 50 Hz.
pub const MOST: usize = 1 << 18;
/// Thinning leaves at most `MOST` divided by this, so that it is seldom needed.
const LEAVES_ONE_IN: usize = 2;

/// Samples in order of time.
#[derive(Clone, Debug)]
pub struct Thinned {
    most: usize,
    /// Each with its number in the log.
    samples: Vec<(u64, FieldSample)>,
    taken: u64,
    /// One in this many is kept between turns, and within them.
    between: u64,
    within: u64,
}

impl Default for Thinned {
    fn default() -> Self {
        Self::of(MOST)
    }
}

impl Thinned {
    fn of(most: usize) -> Self {
        Self {
            most,
            samples: Vec::new(),
            taken: 0,
            between: 1,
            within: 1,
        }
    }

    /// Takes the next sample. `turns` are those found so far; one that is not complete yet has begun no earlier than
    /// `open_s` before it.
    pub fn push(&mut self, sample: FieldSample, turns: &[Turn], open_s: f64) {
        self.samples.push((self.taken, sample));
        self.taken += 1;
        if self.samples.len() >= self.most {
            self.thin(turns, sample.t_s - open_s);
        }
    }

    /// Whether not all samples are kept.
    pub fn is_thinned(&self) -> bool {
        self.between > 1
    }

    /// How many are kept.
    pub fn len(&self) -> usize {
        self.samples.len()
    }

    /// The samples.
    pub fn into_samples(self) -> Vec<FieldSample> {
        self.samples.into_iter().map(|(_, sample)| sample).collect()
    }

    fn thin(&mut self, turns: &[Turn], open_from_s: f64) {
        let mut inside = self.keep(turns, open_from_s);
        while self.samples.len() > self.most / LEAVES_ONE_IN {
            if inside > self.most / (2 * LEAVES_ONE_IN) {
                self.within *= 2;
                self.between = self.between.max(self.within);
            } else {
                self.between *= 2;
            }
            inside = self.keep(turns, open_from_s);
        }
    }

    /// Thins once; returns how many of the rest are in turns, or may still be.
    fn keep(&mut self, turns: &[Turn], open_from_s: f64) -> usize {
        let mut inside = 0;
        let (between, within) = (self.between, self.within);
        let mut ahead = turns.iter().peekable();
        self.samples.retain(|(number, sample)| {
            let t_s = sample.t_s;
            while ahead.next_if(|turn| turn.end_s < t_s).is_some() {}
            let in_turn =
                t_s >= open_from_s || ahead.peek().is_some_and(|turn| turn.start_s <= t_s);
            let kept = number.is_multiple_of(if in_turn { within } else { between });
            inside += usize::from(kept && in_turn);
            kept
        });
        inside
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;

    fn sample(t_s: f64) -> FieldSample {
        FieldSample {
            t_s,
            field_mgauss: Vector3::zeros(),
            pose: None,
        }
    }

    fn turn(start_s: f64, end_s: f64) -> Turn {
        Turn {
            start_s,
            end_s,
            axis_body: Vector3::z(),
            from_vertical_deg: None,
        }
    }

    #[test]
    fn as_long_as_they_are_few_all_are_kept() {
        let mut thinned = Thinned::of(1000);
        (0..999).for_each(|i| thinned.push(sample(f64::from(i)), &[], 10.0));
        assert!(!thinned.is_thinned());
        let times: Vec<f64> = thinned.into_samples().iter().map(|s| s.t_s).collect();
        assert!(times.iter().copied().eq((0..999).map(f64::from)));
    }

    #[test]
    fn turns_are_kept_whole_and_the_rest_is_thinned_evenly() {
        let mut thinned = Thinned::of(16_384);
        let (mut turns, period_s) = (Vec::new(), 0.02);
        for i in 0..400_000u32 {
            let t_s = f64::from(i) * period_s;
            for end_s in [1010.0, 6010.0] {
                if (t_s - end_s).abs() < 1e-9 {
                    turns.push(turn(end_s - 10.0, end_s));
                }
            }
            thinned.push(sample(t_s), &turns, 20.0);
            assert!(thinned.len() <= 16_384);
        }
        assert!(thinned.is_thinned());
        let samples = thinned.into_samples();
        let between = |from_s: f64, to_s: f64| {
            let inside = samples.iter().filter(|s| (from_s..to_s).contains(&s.t_s));
            inside.count()
        };
        for start_s in [1000.0, 6000.0] {
            assert!(between(start_s, start_s + 10.0) >= 499);
        }
        let counts: Vec<usize> = [0, 1, 2, 3, 4, 6]
            .into_iter()
            .map(|k| between(1100.0 * f64::from(k) + 50.0, 1100.0 * f64::from(k) + 900.0))
            .collect();
        let (least, most) = (counts.iter().min().unwrap(), counts.iter().max().unwrap());
        assert!(*least > 50 && most - least <= 2, "{counts:?}");
    }

    #[test]
    fn nothing_but_turns_is_bounded_too() {
        let mut thinned = Thinned::of(4096);
        let mut turns = Vec::new();
        for i in 0..200_000u32 {
            let t_s = f64::from(i) * 0.01;
            if i % 700 == 699 {
                turns.push(turn(t_s - 6.99, t_s));
            }
            thinned.push(sample(t_s), &turns, 7.0);
            assert!(thinned.len() <= 4096);
        }
        let samples = thinned.into_samples();
        assert!(samples.windows(2).all(|pair| pair[0].t_s < pair[1].t_s));
        assert!(samples.len() > 1000);
    }
}
