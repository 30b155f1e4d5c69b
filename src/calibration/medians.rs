//! Medians: of many numbers, and of a few neighbours, which are taken for every sample and axis.

/// From the median of absolute deviations to the standard deviation, for Gaussian noise.
pub const MEDIAN_TO_SD: f64 = 1.4826;

/// The median of numbers whose order does not matter; `None` of nothing, or where one is NaN.
pub fn median(values: &mut [f64]) -> Option<f64> {
    if values.is_empty() || values.iter().any(|value| value.is_nan()) {
        return None;
    }
    let middle = values.len() / 2;
    Some(*values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// The median of so many values, an odd number, none of them NaN. Exchanges of neighbours (odd–even transposition sort) have no branches
/// to mispredict: sorting instead makes a calibration a seventh slower.
pub fn median_of<const N: usize>(mut values: [f64; N]) -> f64 {
    for round in 0..N {
        for at in (round % 2..N - 1).step_by(2) {
            let (x, y) = (values[at], values[at + 1]);
            // Not min and max: what those do with NaN takes longer than the rest.
            values[at] = if x < y { x } else { y };
            values[at + 1] = if x < y { y } else { x };
        }
    }
    values[N / 2]
}
