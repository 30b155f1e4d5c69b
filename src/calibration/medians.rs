//! Medians of a few neighbours, by networks of exchanges (Paeth, Graphics Gems, 1990), some at once: they
//! are taken for every sample and axis.

/// How many medians are found at once: as many as lie beside each other in the registers of most processors.
const LANES: usize = 2;

/// The median of every five that follow each other; none of these is NaN.
pub fn medians_of_5(values: Vec<f64>) -> Vec<f64> {
    medians::<5>(values, |v| {
        v.exchange(&[(0, 1), (3, 4), (0, 3)]);
        v.exchange(&[(1, 4), (1, 2), (2, 3), (1, 2)]);
    })
}

/// The median of every seven that follow each other; none of these is NaN.
pub fn medians_of_7(values: Vec<f64>) -> Vec<f64> {
    medians::<7>(values, |v| {
        v.exchange(&[(0, 5), (0, 3), (1, 6), (2, 4)]);
        v.exchange(&[(0, 1), (3, 5), (2, 6)]);
        v.exchange(&[(2, 3), (3, 6), (4, 5)]);
        v.exchange(&[(1, 4), (1, 3), (3, 4)]);
    })
}

/// N neighbours, in each lane others.
struct Lanes<const N: usize>([[f64; LANES]; N]);

impl<const N: usize> Lanes<N> {
    /// Brings the lesser of each pair to the first place. In short pieces, so that the compiler unrolls them and
    /// all values stay in registers.
    #[inline(always)]
    fn exchange<const E: usize>(&mut self, pairs: &[(usize, usize); E]) {
        let v = &mut self.0;
        for &(a, b) in pairs {
            for lane in 0..LANES {
                let (x, y) = (v[a][lane], v[b][lane]);
                // Not min and max: what those do with NaN takes longer than the rest.
                v[a][lane] = if x < y { x } else { y };
                v[b][lane] = if x > y { x } else { y };
            }
        }
    }
}

/// The exchanges of `network` leave the median of N in the middle.
#[inline(always)]
fn medians<const N: usize>(mut values: Vec<f64>, network: impl Fn(&mut Lanes<N>)) -> Vec<f64> {
    let count = (values.len() + 1).saturating_sub(N);
    let mut medians = vec![0.0; count.next_multiple_of(LANES)];
    values.resize(values.len() + LANES, 0.0);
    for (block, found) in medians.chunks_exact_mut(LANES).enumerate() {
        let seen = &values[block * LANES..][..LANES + N - 1];
        let mut v = Lanes(std::array::from_fn(|k| {
            std::array::from_fn(|lane| seen[k + lane])
        }));
        network(&mut v);
        found.copy_from_slice(&v.0[N / 2]);
    }
    medians.truncate(count);
    medians
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Calls `check` with every order of 0 to N − 1 (Heap's algorithm).
    fn permute<const N: usize>(order: &mut [f64; N], n: usize, check: &impl Fn(&[f64; N])) {
        if n == 1 {
            return check(order);
        }
        for i in 0..n {
            permute(order, n - 1, check);
            order.swap(if n.is_multiple_of(2) { i } else { 0 }, n - 1);
        }
    }

    #[test]
    fn the_median_is_the_middle_one_in_any_order() {
        permute(&mut [0.0, 1.0, 2.0, 3.0, 4.0], 5, &|order| {
            assert_eq!(medians_of_5(order.to_vec()), [2.0], "{order:?}");
        });
        permute(&mut [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0], 7, &|order| {
            assert_eq!(medians_of_7(order.to_vec()), [3.0], "{order:?}");
        });
    }

    #[test]
    fn each_median_is_of_those_that_follow_each_other() {
        for length in 0..30 {
            let rising: Vec<f64> = (0..length).map(f64::from).collect();
            let within = |edge: usize| rising.get(edge..rising.len() - edge.min(rising.len()));
            assert_eq!(medians_of_5(rising.clone()), within(2).unwrap_or_default());
            assert_eq!(medians_of_7(rising.clone()), within(3).unwrap_or_default());
        }
    }
}
