//! Shows the progress of commands that take longer than a second, on standard error. Unless that is a terminal, indicatif
//! shows nothing.

use std::time::Duration;

use indicatif::{ProgressBar, ProgressFinish, ProgressStyle};

/// Parts into which all of the work is divided.
const PARTS: u64 = 1000;

/// A bar with a sentence behind it, for work that waits for somebody.
pub const WITH_MESSAGE: &str = "[{bar:20}] {msg}";

/// A bar, from nothing to all of the work. Dropped, it is removed.
pub fn bar(template: &str) -> ProgressBar {
    let style = ProgressStyle::with_template(template);
    let style = style.unwrap_or_else(|_| ProgressStyle::default_bar());
    ProgressBar::new(PARTS)
        .with_style(style.progress_chars("#>."))
        .with_finish(ProgressFinish::AndClear)
}

/// Sets how much is done, 0 to 1.
pub fn set(bar: &ProgressBar, share: f64) {
    bar.set_position((PARTS as f64 * share) as u64);
}

/// A sign of life for work of unknown length. Dropped, it is removed.
pub fn spinner(message: &'static str) -> ProgressBar {
    let bar = ProgressBar::new_spinner()
        .with_message(message)
        .with_finish(ProgressFinish::AndClear);
    bar.enable_steady_tick(Duration::from_millis(200));
    bar
}
