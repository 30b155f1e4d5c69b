//! Lines of bounded length out of a byte stream, in one buffer.

use std::io::{self, BufRead, Read};

/// Longest line, its end included. A row of eleven numbers stays below it however they are printed.
const LONGEST_LINE: usize = 4096;

/// After so many bytes without an end of the line nothing more is expected: a device may go on for ever.
const LONGEST_SKIPPED: u64 = 64 << 20;

/// What came next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum LogLine {
    /// A line that ended with LF or CRLF; its text is kept.
    Whole,
    /// The input ended within a line.
    CutOff,
    /// A line longer than [`LONGEST_LINE`]; its rest was thrown away unseen.
    TooLong,
    /// There is nothing more.
    End,
}

#[derive(Debug)]
pub(super) struct LogLines<R> {
    pub(super) input: R,
    /// The line without its end.
    pub(super) text: Vec<u8>,
    /// Its number, from 1.
    pub(super) number: u64,
    /// The rest of the last line is still to be thrown away.
    skipping: bool,
}

impl<R: BufRead> LogLines<R> {
    pub(super) fn new(input: R) -> Self {
        Self {
            input,
            text: Vec::with_capacity(LONGEST_LINE),
            number: 0,
            skipping: false,
        }
    }

    pub(super) fn advance(&mut self) -> io::Result<LogLine> {
        if std::mem::take(&mut self.skipping) {
            self.skip()?;
        }
        self.text.clear();
        let length = (&mut self.input)
            .take(LONGEST_LINE as u64)
            .read_until(b'\n', &mut self.text)?;
        if length == 0 {
            return Ok(LogLine::End);
        }
        self.number += 1;
        if self.text.pop_if(|last| *last == b'\n').is_some() {
            self.text.pop_if(|last| *last == b'\r');
            Ok(LogLine::Whole)
        } else if length == LONGEST_LINE {
            self.skipping = true;
            Ok(LogLine::TooLong)
        } else {
            Ok(LogLine::CutOff)
        }
    }

    /// Throws away the rest of a line.
    fn skip(&mut self) -> io::Result<()> {
        let mut rest = (&mut self.input).take(LONGEST_SKIPPED);
        rest.skip_until(b'\n')?;
        if rest.limit() > 0 {
            return Ok(());
        }
        Err(io::Error::new(
            io::ErrorKind::InvalidData,
            "a line without end is in no log",
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_without_end_takes_no_memory() {
        let endless = io::repeat(b'1').take(50_000_000).chain(&b"\nnext\n"[..]);
        let mut lines = LogLines::new(io::BufReader::new(endless));
        assert_eq!(lines.advance().unwrap(), LogLine::TooLong);
        assert_eq!(lines.text.capacity(), LONGEST_LINE);
        assert_eq!(lines.advance().unwrap(), LogLine::Whole);
        assert_eq!(lines.text, b"next");
        assert_eq!(lines.number, 2);
    }

    #[test]
    fn an_endless_line_is_an_error() {
        let mut lines = LogLines::new(io::BufReader::new(io::repeat(0)));
        assert_eq!(lines.advance().unwrap(), LogLine::TooLong);
        let error = lines.advance().unwrap_err();
        assert_eq!(error.to_string(), "a line without end is in no log");
    }
}
