//! Chooses the gain: a coarser one after an overflow, a finer one when the field has long been small.

use crate::sensor::chip::magnetometer::{DataSheet, Measurement};

/// The field must have been this far within the finer range, as a share of its largest count …
const ROOM: f64 = 0.6;
/// … for this long, seconds.
const QUIET_S: f64 = 10.0;

/// The gain in use, and whether it may change.
#[derive(Clone, Debug)]
pub(super) struct AutoRange {
    sheet: &'static DataSheet,
    code: u8,
    automatic: bool,
    small_since_s: Option<f64>,
}

impl AutoRange {
    /// A fixed gain, or an automatic one. A chip that does not have the fixed one has its coarsest.
    pub(super) fn new(sheet: &'static DataSheet, fixed: Option<u8>) -> Self {
        let coarsest = sheet.gains.len() as u8 - 1;
        Self {
            sheet,
            code: fixed.unwrap_or(sheet.automatic_gains.0).min(coarsest),
            automatic: fixed.is_none(),
            small_since_s: None,
        }
    }

    pub(super) fn code(&self) -> u8 {
        self.code
    }

    /// Takes a sample, and returns the code of a new gain if the chip should change to it.
    pub(super) fn take(&mut self, t_s: f64, sample: &Measurement) -> Option<u8> {
        if !self.automatic {
            return None;
        }
        let (finest, coarsest) = self.sheet.automatic_gains;
        if sample.overflowed() {
            self.small_since_s = None;
            return (self.code < coarsest).then(|| self.change_to(self.code + 1));
        }
        if self.code <= finest || !self.is_small(sample) {
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
    fn is_small(&self, sample: &Measurement) -> bool {
        let [now, finer] = [self.code, self.code - 1].map(|code| self.sheet.gain(code));
        let ratio = finer.counts_per_gauss / now.counts_per_gauss;
        let largest = sample.raw.iter().map(|count| f64::from(*count).abs());
        largest.fold(0.0, f64::max) * ratio < ROOM * f64::from(self.sheet.counts.1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor::chip::drivers::magnetometer;

    fn sheet() -> &'static DataSheet {
        magnetometer("hmc5843").unwrap().sheet()
    }

    fn sample(count: i16) -> Measurement {
        Measurement::new(sheet(), 1, [count, 0, 0])
    }

    #[test]
    fn an_overflow_steps_up_to_the_coarsest_and_no_further() {
        let mut range = AutoRange::new(sheet(), None);
        let steps: Vec<_> = (0..7)
            .map(|i| range.take(i.into(), &sample(-4096)))
            .collect();
        let up = |code| Some(code);
        assert_eq!(steps, [up(2), up(3), up(4), up(5), up(6), None, None]);
    }

    #[test]
    fn it_steps_down_only_after_ten_seconds_of_ample_room() {
        let mut range = AutoRange::new(sheet(), None);
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
        let mut range = AutoRange::new(sheet(), Some(3));
        assert_eq!(range.take(0.0, &sample(-4096)), None);
        assert_eq!(range.code(), 3);
    }

    #[test]
    fn a_gain_that_the_chip_does_not_have_is_its_coarsest() {
        let sheet = magnetometer("qmc5883l").unwrap().sheet();
        assert_eq!(AutoRange::new(sheet, Some(5)).code(), 1);
        assert_eq!(AutoRange::new(sheet, None).code(), 0);
    }
}
