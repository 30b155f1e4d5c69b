//! Table `[log]`: the daemon's own log.

use tracing_subscriber::filter::Targets;

use crate::check::{Fault, settings};

settings! {
    /// What goes to the system's journal.
    #[derive(Eq)]
    pub struct Settings {
        /// A level (`off`, `error`, `warn`, `info`, `debug`, `trace`), or several of the form `target=level`
        /// with commas between them.
        filter: String = "info".to_owned();
    }
    also Settings::check_filter;
}

impl Settings {
    fn check_filter(&self, faults: &mut Vec<Fault>) {
        const LEVELS: [&str; 6] = ["off", "error", "warn", "info", "debug", "trace"];
        // The parser takes a misspelt level for the name of a target, and then shows nothing else.
        let right = |part: &str| match part.contains('=') {
            true => part.parse::<Targets>().is_ok(),
            false => LEVELS.iter().any(|level| level.eq_ignore_ascii_case(part)),
        };
        if self.filter.split(',').map(str::trim).all(right) {
            return;
        }
        let levels = LEVELS.join(", ");
        let right = format!("one of {levels}, or target=level with commas between");
        faults.push(Fault::new("filter", format!("{:?}", self.filter), right));
    }
}
