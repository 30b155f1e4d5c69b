//! Says what the TOML parser found wrong in the words of a user, and on which line and in which column.

use std::ops::Range;

/// Says the parser's message about this part of the text in the words of a user; one that is clear stays as it is.
pub(super) fn explain(message: &str, text: &str, span: Range<usize>) -> String {
    let line_start = text[..span.start].rfind('\n').map_or(0, |end| end + 1);
    let before = text[line_start..span.start].trim();
    let word = word(&text[span.start..]);
    if message == "duplicate key" {
        let name = text.get(span).unwrap_or(word);
        return match before.starts_with('[') {
            true => format!("table [{name}] appears twice: merge the two"),
            false => format!("{name} appears twice in its table: keep one of them"),
        };
    }
    if message.starts_with("unexpected leading zero") {
        let key = before.trim_end_matches(['=', ' ', '\t', '+', '-']);
        return match key.rsplit('.').next() {
            Some("mode") => format!(
                "{word} is a number with a leading zero: permissions are octal in quotes, \"{word}\""
            ),
            _ => format!("{word} is a number with a leading zero: leave the zero out"),
        };
    }
    let is_bare = message.starts_with("string values must be quoted")
        || (before.ends_with('=') && word.starts_with(char::is_alphabetic));
    match (is_bare, word) {
        (true, "") => "there is no value after the =".to_owned(),
        (true, "True" | "False") => format!("{word}: write true and false in small letters"),
        (true, number) if number.parse::<f64>().is_ok() => {
            format!(
                "more follows the number {number}: write it alone, without a unit, or text in quotes"
            )
        }
        (true, word) if word.starts_with(['“', '„', '”', '‘', '’']) => {
            format!("{word} has typographic quotes: use straight ones, \"…\"")
        }
        (true, word) => {
            format!("{word} is neither a number nor true or false: put text in quotes: \"{word}\"")
        }
        _ => message.to_owned(),
    }
}

/// The beginning of the text, up to the end of a value.
fn word(text: &str) -> &str {
    let end = text.find(|c: char| c.is_whitespace() || matches!(c, ',' | ']' | '}' | '#'));
    &text[..end.unwrap_or(text.len())]
}

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
