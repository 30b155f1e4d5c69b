//! Lines of bounded length: out of bytes that arrive in pieces of any size, and out of an input.

use std::io::{self, BufRead, ErrorKind};

/// The longest line that is kept, bytes. No device's line comes near it, nor a row of eleven numbers, however they are printed.
const LONGEST_LINE: usize = 4096;

/// Longest line that is skipped, bytes. An input such as /dev/zero never ends one.
const LONGEST_SKIPPED: usize = 64 << 20;

/// What came next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CutLine {
    /// A line; its text is kept.
    Whole,
    /// A line has become longer than 4 KiB; what follows up to its end is thrown away.
    TooLong,
}

/// Cuts bytes into lines. It keeps one line at most.
#[derive(Debug, Default)]
pub struct LineCutter {
    kept: Vec<u8>,
    /// What is kept has been handed over.
    done: bool,
    skipping: bool,
}

impl LineCutter {
    /// The next line that `bytes` complete. Advances `bytes` past it; past all of them if none is complete.
    pub fn next(&mut self, bytes: &mut &[u8]) -> Option<CutLine> {
        if std::mem::take(&mut self.done) {
            self.kept.clear();
        }
        while !bytes.is_empty() {
            let end = bytes.iter().position(|byte| *byte == b'\n');
            let piece = &bytes[..end.unwrap_or(bytes.len())];
            *bytes = end.map_or(&[], |end| &bytes[end + 1..]);
            if self.skipping {
                self.skipping = end.is_none();
            } else if self.kept.len() + piece.len() > LONGEST_LINE {
                self.skipping = end.is_none();
                self.kept.clear();
                return Some(CutLine::TooLong);
            } else {
                self.kept.extend_from_slice(piece);
                if end.is_some() {
                    self.done = true;
                    return Some(CutLine::Whole);
                }
            }
        }
        None
    }

    /// The last line, without its end: LF or CR LF. One device ends its lines with LF CR, so that the CR begins the next one.
    pub fn text(&self) -> &[u8] {
        let line = self.kept.strip_suffix(b"\r").unwrap_or(&self.kept);
        line.strip_prefix(b"\r").unwrap_or(line)
    }

    /// Nothing more comes: whether that is within a line.
    fn finish(&mut self) -> bool {
        let cut_off = !self.done && !self.kept.is_empty();
        self.done = true;
        cut_off
    }
}

/// What came next out of an input.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum LogLine {
    Cut(CutLine),
    /// The input ended within a line.
    CutOff,
    /// There is nothing more.
    End,
}

#[derive(Debug)]
pub(super) struct LogLines<R> {
    pub(super) input: R,
    cutter: LineCutter,
    /// Number of the last line, from 1.
    pub(super) number: u64,
}

impl<R: BufRead> LogLines<R> {
    pub(super) fn new(input: R) -> Self {
        Self {
            input,
            cutter: LineCutter::default(),
            number: 0,
        }
    }

    /// The last line, without its end.
    pub(super) fn text(&self) -> &[u8] {
        self.cutter.text()
    }

    pub(super) fn advance(&mut self) -> io::Result<LogLine> {
        let mut read = 0;
        while read < LONGEST_SKIPPED {
            let bytes = match self.input.fill_buf() {
                Err(error) if error.kind() == ErrorKind::Interrupted => continue,
                bytes => bytes?,
            };
            if bytes.is_empty() {
                let cut_off = self.cutter.finish();
                self.number += u64::from(cut_off);
                return Ok(if cut_off {
                    LogLine::CutOff
                } else {
                    LogLine::End
                });
            }
            let mut rest = bytes;
            let found = self.cutter.next(&mut rest);
            let used = bytes.len() - rest.len();
            self.input.consume(used);
            read += used;
            if let Some(line) = found {
                self.number += 1;
                return Ok(LogLine::Cut(line));
            }
        }
        Err(io::Error::new(
            ErrorKind::InvalidData,
            "a line has no end within 64 MiB, so this is no log",
        ))
    }
}

#[cfg(test)]
mod tests {
    use std::io::{BufReader, Read};

    use super::*;

    #[test]
    fn a_line_without_end_takes_no_memory_and_spoils_no_other() {
        let endless = io::repeat(b'1').take(50_000_000).chain(&b"\nnext\n"[..]);
        let mut lines = LogLines::new(BufReader::new(endless));
        assert_eq!(lines.advance().unwrap(), LogLine::Cut(CutLine::TooLong));
        assert_eq!(lines.advance().unwrap(), LogLine::Cut(CutLine::Whole));
        assert_eq!((lines.text(), lines.number), (&b"next"[..], 2));
        assert!(lines.cutter.kept.capacity() <= 2 * LONGEST_LINE);
        assert_eq!(lines.advance().unwrap(), LogLine::End);
    }

    #[test]
    fn an_endless_line_is_an_error() {
        let mut lines = LogLines::new(BufReader::new(io::repeat(0)));
        assert_eq!(lines.advance().unwrap(), LogLine::Cut(CutLine::TooLong));
        let error = lines.advance().unwrap_err();
        let right = "a line has no end within 64 MiB, so this is no log";
        assert_eq!(error.to_string(), right);
    }

    #[test]
    fn up_to_the_limit_a_line_is_whole() {
        for (length, right) in [
            (LONGEST_LINE, CutLine::Whole),
            (LONGEST_LINE + 1, CutLine::TooLong),
        ] {
            let line = [&b"x".repeat(length)[..], b"\n"].concat();
            let (mut cutter, (mut begin, mut end)) = (LineCutter::default(), line.split_at(1000));
            assert_eq!(cutter.next(&mut begin), None);
            assert_eq!(cutter.next(&mut end), Some(right));
        }
    }
}
