//! RIST, the range of interest selection technique (section 4.2, Appendix 1): the stretch of samples
//! in which an axis swings from one extreme to the other, and half of that distance on either side.

use std::ops::Range;

/// Appendix 1 for one axis, on samples counted from 0. Empty input gives an empty range.
///
/// The pseudo-code clamps the end only; the start is clamped to the first sample as well, since
/// half a window before an early extreme lies before the log.
pub fn window(values: impl IntoIterator<Item = f64>) -> Range<usize> {
    let mut count = 0;
    let (mut ind_max, mut ind_min) = (0, 0);
    let (mut val_max, mut val_min) = (f64::NEG_INFINITY, f64::INFINITY);
    for (index, value) in values.into_iter().enumerate() {
        if value > val_max {
            (val_max, ind_max) = (value, index);
        }
        if value < val_min {
            (val_min, ind_min) = (value, index);
        }
        count = index + 1;
    }
    let (first, last) = if ind_max < ind_min {
        (ind_max, ind_min)
    } else {
        (ind_min, ind_max)
    };
    // floor(first − w) and floor(last + w) with w = (last − first)/2, which may end in a half.
    let distance = last - first;
    let start = first.saturating_sub(distance.div_ceil(2));
    let end = last + distance / 2;
    start..count.min(end + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Zeros with one maximum and one minimum.
    fn values(count: usize, ind_max: usize, ind_min: usize) -> Vec<f64> {
        let mut values = vec![0.0; count];
        values[ind_max] = 1.0;
        values[ind_min] = -1.0;
        values
    }

    #[test]
    fn the_window_is_half_the_distance_longer_at_both_ends_and_within_the_log() {
        let a_hundred = |ind_max, ind_min| window(values(100, ind_max, ind_min));
        // w = 20/2: 30 − 10 .. 50 + 10, both inside.
        assert_eq!(a_hundred(30, 50), 20..61);
        assert_eq!(a_hundred(50, 30), 20..61);
        // w = 10.5: floor(19.5) = 19, floor(61.5) − the pseudo-code's floor(51 + 10.5) = 61.
        assert_eq!(a_hundred(30, 51), 19..62);
        // floor(90 + 20) = 110 ≥ 100; floor(79 + 20) = 99 is the last sample; 10 − 20 lies before the first.
        assert_eq!(a_hundred(50, 90), 30..100);
        assert_eq!(a_hundred(39, 79), 19..100);
        assert_eq!(a_hundred(10, 50), 0..71);
    }

    #[test]
    fn a_constant_axis_chooses_its_first_sample() {
        assert_eq!(window([5.0; 10]), 0..1);
        assert_eq!(window([]), 0..0);
    }
}
