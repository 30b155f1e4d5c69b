//! Shows the progress of commands that take longer than a second, on standard error. Unless that is a terminal, indicatif
//! shows nothing.

use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};

use crate::sensor::replay::Replay;

/// Parts into which all of the work is divided.
const PARTS: u64 = 1000;

/// How many rows of a log are read between two looks at how far that is.
const ROWS_A_LOOK: u64 = 8192;

/// A bar, from nothing to all of the work. Dropped, it is removed.
#[derive(Debug)]
pub struct Progress {
    bar: ProgressBar,
    rows: u64,
}

impl Progress {
    /// A bar for work of known length.
    pub fn new() -> Self {
        Self::with("{wide_bar} {percent} % {eta} left")
    }

    /// A bar with a sentence behind it, for work that waits for somebody.
    pub fn with_message() -> Self {
        Self::with("[{bar:20}] {msg}")
    }

    fn with(template: &str) -> Self {
        let style = ProgressStyle::with_template(template);
        let style = style.unwrap_or_else(|_| ProgressStyle::default_bar());
        let bar = ProgressBar::new(PARTS).with_style(style.progress_chars("#>."));
        Self { bar, rows: 0 }
    }

    /// A sign of life for work of unknown length.
    pub fn spinner(message: &'static str) -> Self {
        let bar = ProgressBar::new_spinner().with_message(message);
        bar.enable_steady_tick(Duration::from_millis(200));
        Self { bar, rows: 0 }
    }

    /// Whether somebody sees it.
    pub fn is_shown(&self) -> bool {
        !self.bar.is_hidden()
    }

    pub fn say(&self, message: String) {
        self.bar.set_message(message);
    }

    /// Sets how much is done, 0 to 1.
    pub fn set(&self, share: f64) {
        self.bar.set_position((PARTS as f64 * share) as u64);
    }

    /// Sets how much of a log has been read. To be called for each row.
    pub fn follow(&mut self, log: &Replay) {
        self.rows += 1;
        if self.rows.is_multiple_of(ROWS_A_LOOK) {
            self.set(log.share_read());
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}
