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

/// The same, found sooner where it is known to be near `guess`: smaller values are only counted, and the middle is
/// sought among those near the guess. How near matters for the time alone.
pub fn median_near(values: &mut [f64], guess: f64) -> Option<f64> {
    const NEAR: f64 = 0.06;
    let (low, high) = (guess * (1.0 - NEAR), guess * (1.0 + NEAR));
    let mut below = 0;
    // Those about the guess are brought to the front.
    let mut about = 0;
    for index in 0..values.len() {
        let value = values[index];
        below += usize::from(value < low);
        values.swap(about, index);
        about += usize::from(low <= value && value < high);
    }
    match (values.len() / 2).checked_sub(below) {
        Some(rank) if rank < about && values.iter().all(|value| !value.is_nan()) => Some(
            *values[..about]
                .select_nth_unstable_by(rank, f64::total_cmp)
                .1,
        ),
        _ => median(values),
    }
}

/// The median of five values, none of which is NaN, by a network of exchanges (Paeth, Graphics Gems, 1990).
pub fn median_of_5(values: [f64; 5]) -> f64 {
    const NETWORK: [(usize, usize); 7] = [(0, 1), (3, 4), (0, 3), (1, 4), (1, 2), (2, 3), (1, 2)];
    middle(values, NETWORK)
}

/// The median of seven values, none of which is NaN, by such a network.
pub fn median_of_7(values: [f64; 7]) -> f64 {
    const NETWORK: [(usize, usize); 13] = [
        (0, 5),
        (0, 3),
        (1, 6),
        (2, 4),
        (0, 1),
        (3, 5),
        (2, 6),
        (2, 3),
        (3, 6),
        (4, 5),
        (1, 4),
        (1, 3),
        (3, 4),
    ];
    middle(values, NETWORK)
}

/// Each exchange brings the lesser of a pair to the first place; all of them leave the median in the middle.
#[inline(always)]
fn middle<const N: usize, const E: usize>(mut v: [f64; N], network: [(usize, usize); E]) -> f64 {
    for (a, b) in network {
        let (x, y) = (v[a], v[b]);
        // Not min and max: what those do with NaN takes longer than the rest.
        v[a] = if x < y { x } else { y };
        v[b] = if x > y { x } else { y };
    }
    v[N / 2]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Calls `check` with every order of 0 to N − 1 (Heap's algorithm).
    fn permute<const N: usize>(order: &mut [f64; N], n: usize, check: &impl Fn([f64; N])) {
        if n == 1 {
            return check(*order);
        }
        for i in 0..n {
            permute(order, n - 1, check);
            order.swap(if n.is_multiple_of(2) { i } else { 0 }, n - 1);
        }
    }

    #[test]
    fn the_median_is_the_middle_one_in_any_order() {
        permute(&mut [0.0, 1.0, 2.0, 3.0, 4.0], 5, &|order| {
            assert_eq!(median_of_5(order), 2.0, "{order:?}");
        });
        permute(&mut [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0], 7, &|order| {
            assert_eq!(median_of_7(order), 3.0, "{order:?}");
        });
    }
}
