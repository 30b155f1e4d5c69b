//! Chooses the gain: a coarser one after an overflow, a finer one when the field has long been small.

use crate::sensor::chip::magnetometer::{DataSheet, Measurement};

/// The field must have been this far within the finer range, as a share of its largest count …
const ROOM: f64 = 0.6;
/// … for this long, seconds.
const QUIET_S: f64 = 10.0;

/// Since when the field has been small.
#[derive(Default)]
pub(super) struct AutoRange {
    small_since_s: Option<f64>,
}

impl AutoRange {
    /// Takes a sample with this gain, and returns the code of a new gain if the chip should change to it.
    pub(super) fn take(
        &mut self,
        sheet: &DataSheet,
        gain: u8,
        t_s: f64,
        sample: &Measurement,
    ) -> Option<u8> {
        let (finest, coarsest) = sheet.automatic_gains;
        if sample.overflowed() || gain <= finest || !is_small(sheet, gain, sample) {
            self.small_since_s = None;
            return (sample.overflowed() && gain < coarsest).then(|| gain + 1);
        }
        let since_s = *self.small_since_s.get_or_insert(t_s);
        if t_s - since_s < QUIET_S {
            return None;
        }
        self.small_since_s = None;
        Some(gain - 1)
    }
}

/// Whether the finer gain would have had ample room for it.
fn is_small(sheet: &DataSheet, gain: u8, sample: &Measurement) -> bool {
    let ratio = sheet.gain(gain - 1) / sheet.gain(gain);
    let largest = sample.raw.iter().map(|count| f64::from(*count).abs());
    largest.fold(0.0, f64::max) * ratio < ROOM * f64::from(sheet.counts.1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor::chip::drivers::magnetometer;

    /// The gains after samples at these times with these counts on one axis, from gain 1 on.
    fn gains(samples: &[(f64, i16)]) -> Vec<u8> {
        let sheet = magnetometer("hmc5843").unwrap().sheet();
        let (mut range, mut gain) = (AutoRange::default(), 1);
        let mut after = |(t_s, count): &(f64, i16)| {
            let sample = Measurement::new(sheet, gain, [*count, 0, 0]);
            gain = range.take(sheet, gain, *t_s, &sample).unwrap_or(gain);
            gain
        };
        samples.iter().map(&mut after).collect()
    }

    #[test]
    fn an_overflow_steps_up_to_the_coarsest_and_no_further() {
        let overflows: Vec<_> = (0..7).map(|i| (f64::from(i), -4096)).collect();
        assert_eq!(gains(&overflows), [2, 3, 4, 5, 6, 6, 6]);
    }

    #[test]
    fn it_steps_down_only_after_ten_seconds_of_ample_room() {
        let samples = [
            (0.0, -4096),
            // 900 counts at gain 2 are 1206 at gain 1: 59 %. A larger one begins the wait anew.
            (1.0, 900),
            (10.0, 930),
            (11.0, -900),
            (20.9, 0),
            (21.0, 0),
            (50.0, 0),
        ];
        assert_eq!(gains(&samples), [2, 2, 2, 2, 2, 1, 1]);
    }
}
