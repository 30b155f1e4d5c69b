//! Medians of a few neighbours, by networks of exchanges (Paeth, Graphics Gems, 1990): they are taken for every sample and axis.

/// The median of five values, none of which is NaN.
pub fn median_of_5(values: [f64; 5]) -> f64 {
    const NETWORK: [(usize, usize); 7] = [(0, 1), (3, 4), (0, 3), (1, 4), (1, 2), (2, 3), (1, 2)];
    middle(values, NETWORK)
}

/// The median of seven values, none of which is NaN.
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
