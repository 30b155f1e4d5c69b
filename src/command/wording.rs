//! Words for what several commands print.

use crate::advice::next_step;
use crate::frame::to_tenths;

/// Length of a bar of text, characters.
const BAR: usize = 20;

/// A heading to steer by, as text: the true one where it is known, with its uncertainty, one standard deviation.
pub fn heading_text(
    true_deg: Option<f64>,
    magnetic_deg: Option<f64>,
    sd_deg: Option<f64>,
) -> Option<String> {
    let (degrees, north) = match true_deg {
        Some(degrees) => (degrees, "true"),
        None => (magnetic_deg?, "magnetic"),
    };
    let sd = sd_deg.map_or(String::new(), |sd| format!(" ± {sd:.1}°"));
    Some(format!("{:05.1}° {north}{sd}", to_tenths(degrees)))
}

/// A condition or a verdict as text.
pub fn plain_text(word: &str, reason: &str, message: &str) -> String {
    format!("{word} ({reason}): {message}")
}

/// The same with what to do.
pub fn reason_text(word: &str, reason: &str, message: &str) -> String {
    let advice = next_step(reason).map(|advice| format!("\nwhat to do: {advice}"));
    plain_text(word, reason, message) + &advice.unwrap_or_default()
}

/// A time span in two units.
pub fn span(seconds: u64) -> String {
    let (minutes, hours, days) = (seconds / 60, seconds / 3600, seconds / 86_400);
    match (days, hours, minutes) {
        (0, 0, 0) => format!("{seconds} s"),
        (0, 0, _) => format!("{minutes} min {} s", seconds % 60),
        (0, _, _) => format!("{hours} h {} min", minutes % 60),
        _ => format!("{days} d {} h", hours % 24),
    }
}

/// How much is done, 0 to 1, as text.
pub fn bar(share: f64) -> String {
    let done = ((share * BAR as f64) as usize).min(BAR);
    format!("[{}{}]", "#".repeat(done), ".".repeat(BAR - done))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spans_have_the_units_that_matter() {
        for (seconds, text) in [
            (0, "0 s"),
            (61, "1 min 1 s"),
            (7_260, "2 h 1 min"),
            (200_000, "2 d 7 h"),
        ] {
            assert_eq!(span(seconds), text);
        }
    }
}
