//! Says what a deserialiser found wrong in the words of a user.

use strsim::levenshtein;

use crate::check::Fault;

/// Says a deserialiser's message about what was `found` at a key in the words of a user.
pub(super) fn explain(key: &str, found: String, message: &str) -> String {
    let wrong = |right: String| Fault::new(key, found, right).to_string();
    if message.starts_with("unknown variant `") {
        // The words in backquotes after "expected".
        let (_, list) = message.rsplit_once(", expected ").unwrap_or_default();
        let choices = list.split('`').skip(1).step_by(2);
        let quoted: Vec<String> = choices.map(|choice| format!("{choice:?}")).collect();
        return wrong(quoted.join(" or "));
    }
    let is_type = ["invalid type: ", "invalid value: ", "invalid length "]
        .iter()
        .any(|start| message.starts_with(start));
    match message.rsplit_once(", expected ") {
        Some((_, expected)) if is_type => wrong(right_type(expected)),
        _ => format!("{key}: {message}"),
    }
}

/// A type's name as a deserialiser gives it, in the words of a user.
fn right_type(expected: &str) -> String {
    match expected {
        "f64" => "a number",
        "u8" => "a whole number, from 0 to 255",
        "u32" => "a whole number, from 0 to 4294967295",
        "u64" | "usize" => "a whole number, 0 or more",
        "a boolean" => "true or false",
        "a string" | "path string" => "a text in quotes",
        other => other,
    }
    .to_owned()
}

/// The largest number of the integer type that the deserialiser expected. It exceeds the range of every setting that is
/// narrower than its type.
pub(super) fn beyond(message: &str) -> Option<&'static str> {
    match message.rsplit_once(", expected ")?.1 {
        "u8" => Some("255"),
        "u32" => Some("4294967295"),
        "u64" | "usize" => Some("9223372036854775807"),
        _ => None,
    }
}

/// A key as it must be written: in quotes, with escapes, unless it is bare.
pub(super) fn quoted(key: &str) -> String {
    let is_bare = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '-');
    match !key.is_empty() && key.chars().all(is_bare) {
        true => key.to_owned(),
        false => format!("{key:?}"),
    }
}

/// What to write in place of an unknown word: the nearest known one, or all of them.
pub(super) fn suggest(unknown: &str, known: &[&str]) -> String {
    let nearest = known
        .iter()
        .map(|word| (levenshtein(unknown, word), word))
        .min()
        .filter(|(far, word)| *far <= 2.max(word.len() / 3));
    match nearest {
        Some((_, word)) => format!("did you mean {word}?"),
        None => format!("known are {}", known.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_that_would_control_a_terminal_is_quoted() {
        for (key, right) in [
            ("rate-hz_2", "rate-hz_2"),
            ("", "\"\""),
            ("\u{1b}[2J", "\"\\u{1b}[2J\""),
        ] {
            assert_eq!(quoted(key), right);
        }
    }

    #[test]
    fn a_far_word_gets_the_whole_list() {
        let known = ["kind", "speed"];
        assert_eq!(suggest("sped", &known), "did you mean speed?");
        assert_eq!(suggest("frequency", &known), "known are kind, speed");
    }
}
