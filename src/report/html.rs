//! Pieces of HTML: text, and a verdict with the word, the reason and what helps.

use crate::advice::next_step;
use crate::calibration::outcome::{Outcome, Verdict};

/// Text that may stand in HTML.
pub(super) fn escaped(text: &str) -> String {
    // The ampersand first: the others bring one each.
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}

/// The heading of a section on a calibration, with its verdict, and what to do after a refusal.
pub(super) fn verdict(title: &str, outcome: &Outcome) -> String {
    let (class, word) = match outcome.verdict {
        Verdict::Accepted => ("good", "accepted"),
        Verdict::Kept => ("good", "not needed: what was known is more certain"),
        Verdict::Rejected => ("bad", "rejected"),
    };
    let mut out = format!(
        "<h2>{title}</h2>\n<p><b class={class}>{word}</b> ({}): {}</p>\n",
        outcome.reason,
        escaped(&outcome.message)
    );
    if outcome.verdict == Verdict::Rejected
        && let Some(advice) = next_step(outcome.reason)
    {
        out += &format!("<p>What to do: {}.</p>\n", escaped(advice));
    }
    out
}
