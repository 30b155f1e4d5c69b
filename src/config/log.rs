//! Table `[log]`: the daemon's own log.

use crate::check::{Fault, settings};
use crate::logging;

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
        if logging::parse(&self.filter).is_none() {
            faults.push(Fault::new(
                "filter",
                format!("{:?}", self.filter),
                logging::RIGHT,
            ));
        }
    }
}
