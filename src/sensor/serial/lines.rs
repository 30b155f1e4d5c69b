//! Lines of bounded length out of bytes that arrive in pieces of any size.

/// The longest line that is kept, bytes. No device's line and no row of a log comes near it.
pub(super) const LONGEST_LINE: usize = 4096;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum SerialLine<'a> {
    /// A line, without its end (LF, CR LF or LF CR).
    Whole(&'a [u8]),
    /// A line has become longer than [`LONGEST_LINE`]; what follows up to its end is thrown away.
    TooLong,
}

/// Cuts bytes into lines. It keeps at most one unfinished line.
#[derive(Debug, Default)]
pub(super) struct SerialLines {
    pending: Vec<u8>,
    skipping: bool,
}

impl SerialLines {
    /// Hands over the lines that `bytes` complete, in order.
    pub(super) fn feed(&mut self, bytes: &[u8], mut line: impl FnMut(SerialLine<'_>)) {
        for piece in bytes.split_inclusive(|byte| *byte == b'\n') {
            let (text, ends) = match piece.split_last() {
                Some((b'\n', text)) => (text, true),
                _ => (piece, false),
            };
            if !self.skipping && self.pending.len() + text.len() > LONGEST_LINE {
                self.skipping = true;
                self.pending.clear();
                line(SerialLine::TooLong);
            }
            if !self.skipping {
                self.pending.extend_from_slice(text);
                if ends {
                    line(SerialLine::Whole(trim_cr(&self.pending)));
                }
            }
            if ends {
                self.skipping = false;
                self.pending.clear();
            }
        }
    }
}

/// One device ends its lines with LF CR, so that the CR opens the next one.
fn trim_cr(line: &[u8]) -> &[u8] {
    let line = line.strip_suffix(b"\r").unwrap_or(line);
    line.strip_prefix(b"\r").unwrap_or(line)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cut(pieces: &[&[u8]]) -> (Vec<String>, usize) {
        let (mut found, mut lines) = (Vec::new(), SerialLines::default());
        for piece in pieces {
            lines.feed(piece, |line| {
                found.push(match line {
                    SerialLine::Whole(text) => String::from_utf8_lossy(text).into_owned(),
                    SerialLine::TooLong => "too long".to_owned(),
                });
            });
        }
        (found, lines.pending.capacity())
    }

    #[test]
    fn lines_come_whole_from_whatever_pieces() {
        let text = b"a\r\nbc\n\n\rd\n\re\r\n";
        let right = ["a", "bc", "", "d", "e"];
        assert_eq!(cut(&[text]).0, right);
        for at in 0..text.len() {
            assert_eq!(cut(&[&text[..at], &text[at..]]).0, right);
        }
    }

    #[test]
    fn a_line_of_a_megabyte_takes_no_memory_and_spoils_no_other() {
        let long = vec![b'x'; 1 << 20];
        let (found, kept) = cut(&[b"a\n", &long, &long, b"\nb\n"]);
        assert_eq!(found, ["a", "too long", "b"]);
        assert!(kept <= 2 * LONGEST_LINE, "{kept}");
        // Up to the limit a line is one, and not beyond.
        let most = [&long[..LONGEST_LINE], b"\n"].concat();
        assert_eq!(cut(&[&most]).0[0].len(), LONGEST_LINE);
        let more = [&long[..=LONGEST_LINE], b"\n"].concat();
        assert_eq!(cut(&[&more]).0, ["too long"]);
    }
}
