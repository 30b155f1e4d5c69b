//! Chooses the gain: a coarser one after an overflow, a finer one when the field has long been small.

use super::Sample;
use super::kin::Kind;

/// The gain that a chip starts with. Code 0 is never chosen: it gains a fourth in resolution, and loses the room
/// for hard iron.
const FINEST: u8 = 1;
/// The field must have been this far within the finer range, as a share of its 12 bits …
const ROOM: f64 = 0.6;
/// … for this long, seconds.
const QUIET_S: f64 = 10.0;
const LARGEST_COUNT: f64 = 2047.0;

/// The gain in use, and whether it may change.
#[derive(Clone, Debug)]
pub struct Range {
    kind: Kind,
    code: u8,
    automatic: bool,
    small_since_s: Option<f64>,
}

impl Range {
    /// A fixed gain, or an automatic one.
    pub fn new(kind: Kind, fixed: Option<u8>) -> Self {
        Self {
            kind,
            code: fixed.unwrap_or(FINEST),
            automatic: fixed.is_none(),
            small_since_s: None,
        }
    }

    /// The gain's code.
    pub fn code(&self) -> u8 {
        self.code
    }

    /// Takes a sample, and gives the code of a new gain if the chip should change to it.
    pub fn take(&mut self, t_s: f64, sample: &Sample) -> Option<u8> {
        if !self.automatic {
            return None;
        }
        if sample.overflowed() {
            self.small_since_s = None;
            return (self.code < self.kind.coarsest_gain()).then(|| self.change_to(self.code + 1));
        }
        if self.code <= FINEST || !self.is_small(sample) {
            self.small_since_s = None;
            return None;
        }
        let since_s = *self.small_since_s.get_or_insert(t_s);
        (t_s - since_s >= QUIET_S).then(|| self.change_to(self.code - 1))
    }

    fn change_to(&mut self, code: u8) -> u8 {
        self.code = code;
        self.small_since_s = None;
        code
    }

    /// Whether the finer gain would have had ample room for it.
    fn is_small(&self, sample: &Sample) -> bool {
        let gains = self.kind.gains();
        let [now, finer] = [self.code, self.code - 1].map(|code| gains[usize::from(code)]);
        let ratio = finer.counts_per_gauss / now.counts_per_gauss;
        let largest = sample.raw.iter().map(|count| f64::from(*count).abs());
        largest.fold(0.0, f64::max) * ratio < ROOM * LARGEST_COUNT
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(count: i16) -> Sample {
        Sample::new(Kind::Hmc5843, 1, [count, 0, 0])
    }

    #[test]
    fn an_overflow_steps_up_to_the_coarsest_and_no_further() {
        let mut range = Range::new(Kind::Hmc5843, None);
        let steps: Vec<_> = (0..7)
            .map(|i| range.take(i.into(), &sample(-4096)))
            .collect();
        let up = |code| Some(code);
        assert_eq!(steps, [up(2), up(3), up(4), up(5), up(6), None, None]);
    }

    #[test]
    fn it_steps_down_only_after_ten_seconds_of_ample_room() {
        let mut range = Range::new(Kind::Hmc5843, None);
        range.take(0.0, &sample(-4096));
        // 900 counts at gain 2 are 1206 at gain 1: 59 %. A larger one begins the wait anew.
        assert_eq!(range.take(1.0, &sample(900)), None);
        assert_eq!(range.take(10.0, &sample(930)), None);
        assert_eq!(range.take(11.0, &sample(-900)), None);
        assert_eq!(range.take(20.9, &sample(0)), None);
        assert_eq!(range.take(21.0, &sample(0)), Some(1));
        assert_eq!(range.take(50.0, &sample(0)), None);
        assert_eq!(range.code(), 1);
    }

    #[test]
    fn a_fixed_gain_stays() {
        let mut range = Range::new(Kind::Hmc5843, Some(3));
        assert_eq!(range.take(0.0, &sample(-4096)), None);
        assert_eq!(range.code(), 3);
    }
}
