//! Evenly thinned sequences: a log of a day takes no more room than one of a minute.

/// Keeps at most `most` items, evenly: whenever it is full, it drops every second one, and takes only half as many from then on.
#[derive(Clone, Debug, Default)]
pub(super) struct Thin<T> {
    pub(super) kept: Vec<T>,
    most: usize,
    every: usize,
    skipped: usize,
}

impl<T> Thin<T> {
    pub(super) fn to(most: usize) -> Self {
        Self {
            kept: Vec::new(),
            most,
            every: 1,
            skipped: 0,
        }
    }

    pub(super) fn push(&mut self, item: T) {
        if self.skipped > 0 {
            self.skipped -= 1;
            return;
        }
        if self.kept.len() == self.most {
            let mut odd = false;
            self.kept.retain(|_| {
                odd = !odd;
                odd
            });
            self.every *= 2;
        }
        self.kept.push(item);
        self.skipped = self.every - 1;
    }
}

/// At most so many of these, evenly.
pub(super) fn some<T>(items: &[T], most: usize) -> Vec<&T> {
    let step = items.len().div_ceil(most).max(1);
    items.iter().step_by(step).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_kept_is_even_and_never_more_than_wanted() {
        let mut thin = Thin::to(8);
        for i in 0..100 {
            thin.push(i);
            assert!(thin.kept.len() <= 8);
        }
        let steps: Vec<i32> = thin.kept.windows(2).map(|two| two[1] - two[0]).collect();
        assert!(
            thin.kept[0] == 0 && steps.iter().all(|step| *step == 16),
            "{thin:?}"
        );
        assert_eq!(some(&[1, 2, 3, 4, 5], 3), [&1, &3, &5]);
        assert!(some::<i32>(&[], 3).is_empty());
    }
}
