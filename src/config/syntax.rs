//! Says what the TOML parser found wrong in the words of a user, and on which line and in which column.

use std::ops::Range;

/// Says the parser's message about this part of the text in the words of a user; one that is clear stays as it is.
pub(super) fn explain(message: &str, text: &str, span: Range<usize>) -> String {
    let line_start = text[..span.start].rfind('\n').map_or(0, |end| end + 1);
    let before = text[line_start..span.start].trim();
    // A stray control character must not reach a terminal.
    let word = &word(&text[span.start..]).replace(char::is_control, "?");
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
    let line = text[line_start..].lines().next().unwrap_or_default();
    if let Some((key, value)) = line.split_once(':')
        && (message.starts_with("invalid unquoted key") || message.starts_with("key with no value"))
        && !key.contains(['=', '"', '#'])
    {
        let right = format!("{} = {}", key.trim(), value.trim());
        return format!(
            "found a colon after the key: write {}",
            right.replace(char::is_control, "?")
        );
    }
    let whole = before.rsplit(['=', ' ']).next().unwrap_or_default();
    let tail = text[span.start..].strip_prefix(',').map(self::word);
    if let Some(tail) = tail
        && whole.ends_with(|c: char| c.is_ascii_digit())
        && tail.starts_with(|c: char| c.is_ascii_digit())
        && let Ok(_) = format!("{whole}.{tail}").parse::<f64>()
    {
        return format!("{whole},{tail}: decimals need a point: {whole}.{tail}");
    }
    let is_bare = message.starts_with("string values must be quoted")
        || (before.ends_with('=') && word.starts_with(char::is_alphabetic));
    if !is_bare {
        return message.to_owned();
    }
    let digits = word.trim_end_matches(|c: char| !c.is_ascii_digit());
    match word.as_str() {
        "" => "there is no value after the =".to_owned(),
        "True" | "False" => format!("{word}: write true and false in small letters"),
        _ if digits.parse::<f64>().is_ok() => format!(
            "more follows the number {digits}: write it alone, without a unit, or text in quotes"
        ),
        word if word.starts_with(['“', '„', '”', '‘', '’']) => {
            format!("{word} has typographic quotes: use straight ones, \"…\"")
        }
        word => {
            format!("{word} is neither a number nor true or false: put text in quotes: \"{word}\"")
        }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_control_character_of_a_file_reaches_the_terminal() {
        for (text, message, at) in [
            ("bus = \u{1b}[2J", "string values must be quoted", 6),
            ("bus: \u{1b}[2J", "invalid unquoted key", 3),
        ] {
            let sentence = explain(message, text, at..at + 1);
            assert!(sentence.contains("?[2J"), "{sentence}");
            assert!(!sentence.contains('\u{1b}'), "{sentence:?}");
        }
    }

    #[test]
    fn a_trailing_comma_and_the_colon_of_a_remark_are_told_as_the_parser_tells_them() {
        let message = "key with no value, expected `=`";
        for (text, at) in [("rate_hz = 1,", 11), ("bus # note: 1", 4)] {
            assert_eq!(explain(message, text, at..at + 1), message);
        }
    }
}
