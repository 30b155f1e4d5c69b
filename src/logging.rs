//! The log: fields for the journal under systemd, lines on standard error elsewhere, and no flood.

mod repeats;

use std::env;
use std::io::{self, IsTerminal};
use std::time::Instant;

use rustix::fs::fstat;
use tokio::time::sleep;
use tracing_journald::{Priority, PriorityMappings};
use tracing_subscriber::filter::{LevelFilter, Targets};
use tracing_subscriber::prelude::*;
use tracing_subscriber::{Layer, Registry, fmt, reload};

use repeats::{LeftOut, WINDOW};

/// The target of lines that say what a client has changed: none is ever left out.
pub(crate) const CHANGES: &str = "headingd::changes";

/// The environment variable that takes the place of `log.filter`.
const FILTER_VARIABLE: &str = "RUST_LOG";

#[derive(Clone, Debug)]
pub struct Log {
    /// None if the environment has a filter of its own, which stays.
    filter: Option<reload::Handle<Targets, Registry>>,
    left_out: LeftOut,
}

impl Log {
    /// Starts to log, with this filter unless the environment has another. To be called once.
    pub fn start(filter: &str) -> Self {
        let wanted = env::var(FILTER_VARIABLE)
            .ok()
            .filter(|text| !text.is_empty());
        let own = wanted.as_deref().and_then(parse);
        let from_environment = own.is_some();
        let (chosen, handle) = reload::Layer::new(own.unwrap_or_else(|| targets(filter)));
        let left_out = LeftOut::default();
        tracing_subscriber::registry()
            .with(chosen)
            .with(output())
            .with(left_out.clone())
            .init();
        if let Some(found) = wanted.filter(|_| !from_environment) {
            tracing::warn!("{FILTER_VARIABLE} is {found:?}, but must be {RIGHT}; using {filter:?}");
        }
        Self {
            filter: (!from_environment).then_some(handle),
            left_out,
        }
    }

    /// Does the work, and says meanwhile and at its end how many lines were left out. Needs a runtime.
    pub async fn tell_left_out<T>(&self, work: impl Future<Output = T>) -> T {
        let left_out = self.left_out.clone();
        let regularly = tokio::spawn(async move {
            loop {
                sleep(WINDOW).await;
                left_out.tell(Instant::now());
            }
        });
        let ended = work.await;
        regularly.abort();
        self.left_out.tell_all();
        ended
    }

    /// Takes another filter from the configuration.
    pub fn set(&self, filter: &str) {
        if let Some(handle) = &self.filter
            && let Err(error) = handle.reload(targets(filter))
        {
            tracing::error!("cannot change the log's filter to {filter:?}: {error}");
        }
    }
}

/// What a filter must be.
pub const RIGHT: &str =
    "off, error, warn, info, debug or trace, or several target=level with commas between";

/// Reads levels and `target=level` with commas between them; spaces around them do not count.
pub fn parse(filter: &str) -> Option<Targets> {
    let parts = filter.split(',').map(str::trim);
    let parts: Vec<&str> = parts.filter(|part| !part.is_empty()).collect();
    // `Targets` takes a misspelt level for the name of a target, and then shows nothing else.
    let right = |part: &&str| part.contains('=') || part.parse::<LevelFilter>().is_ok();
    let all_right = !parts.is_empty() && parts.iter().all(right);
    let targets = parts.join(",").parse().ok();
    targets.filter(|_| all_right)
}

/// The filter of the configuration. It has been checked; should it not parse all the same, the level is `info`.
fn targets(filter: &str) -> Targets {
    parse(filter).unwrap_or_else(|| Targets::new().with_default(LevelFilter::INFO))
}

/// Whether standard error goes to the journal: `JOURNAL_STREAM` has its device and inode, as in systemd.exec(5).
pub fn to_journal() -> bool {
    let Ok(found) = fstat(io::stderr()) else {
        return false;
    };
    let of_journal = format!("{}:{}", found.st_dev, found.st_ino);
    env::var("JOURNAL_STREAM").is_ok_and(|stream| stream == of_journal)
}

/// Whether the user wants no colour, on whatever terminal: <https://no-color.org>.
pub fn no_colour() -> bool {
    env::var_os("NO_COLOR").is_some_and(|value| !value.is_empty())
}

fn output() -> Box<dyn Layer<Filtered> + Send + Sync> {
    // A journal that does not answer leaves the lines, which it may take from standard error later.
    if to_journal()
        && let Ok(journal) = tracing_journald::layer()
    {
        let priorities = PriorityMappings {
            info: Priority::Informational,
            debug: Priority::Debug,
            ..PriorityMappings::new()
        };
        return journal
            .with_field_prefix(Some("HEADINGD".to_owned()))
            .with_priority_mappings(priorities)
            .boxed();
    }
    fmt::layer()
        .with_writer(io::stderr)
        .with_ansi(io::stderr().is_terminal() && !no_colour())
        .with_target(false)
        .boxed()
}

type Filtered = tracing_subscriber::layer::Layered<reload::Layer<Targets, Registry>, Registry>;

#[cfg(test)]
mod tests {
    use super::*;
    use tracing::Level;

    #[test]
    fn spaces_and_empty_parts_of_a_filter_do_not_count() {
        let filter = parse("headingd::turn=debug, warn,").unwrap();
        assert!(filter.would_enable("headingd::turn::angle", &Level::DEBUG));
        assert!(filter.would_enable("headingd", &Level::WARN));
        assert!(!filter.would_enable("headingd", &Level::INFO));
    }

    #[test]
    fn a_misspelt_level_is_no_filter() {
        for wrong in ["", ",", "inof", "info,wran", "headingd=inof", "headingd"] {
            assert!(parse(wrong).is_none(), "{wrong}");
        }
    }
}
