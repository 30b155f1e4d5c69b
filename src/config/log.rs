//! Table `[log]`: the daemon's own log.

use crate::check::{Fault, settings};
use crate::logging;

settings! {
    /// What goes to the system's journal.
    #[derive(Eq)]
    pub struct Settings {
        /// A level (`off`, `error`, `warn`, `info`, `debug`, `trace`), or several of the form `target=level`
        /// with commas between them.
        filter: String = "info".to_owned() => |key, filter| {
            let wrong = logging::parse(filter).is_none();
            wrong.then(|| Fault::new(key, format!("{filter:?}"), logging::RIGHT))
        };
    }
}
