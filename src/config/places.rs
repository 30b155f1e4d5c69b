//! Lines and columns of a text.

/// Where the lines of a text begin: a file with many faults asks for it often.
pub(super) struct LineIndex {
    begins: Vec<usize>,
}

impl LineIndex {
    pub(super) fn of(text: &str) -> Self {
        let ends = text.bytes().enumerate().filter(|(_, byte)| *byte == b'\n');
        let begins = std::iter::once(0).chain(ends.map(|(at, _)| at + 1));
        Self {
            begins: begins.collect(),
        }
    }

    /// The line in which this byte is, from 1.
    pub(super) fn line(&self, at: usize) -> usize {
        self.begins.partition_point(|begin| *begin <= at)
    }
}

/// The column of this byte, from 1, in characters.
pub(super) fn column(text: &str, at: usize) -> usize {
    let before = text.get(..at).unwrap_or(text);
    let start = before.rfind('\n').map_or(0, |end| end + 1);
    1 + before[start..].chars().count()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_counted_from_1() {
        let places = LineIndex::of("a\n\nbc\n");
        let lines: Vec<usize> = (0..6).map(|at| places.line(at)).collect();
        assert_eq!(lines, [1, 1, 2, 3, 3, 3]);
    }
}
