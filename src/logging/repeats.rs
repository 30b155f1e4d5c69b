//! Limits how many lines a call site may log for one reason, and says how many were left out.

use std::collections::HashMap;
use std::fmt::{Debug, Write};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use tracing::callsite::Identifier;
use tracing::field::{Field, Visit};
use tracing::{Event, Level, Subscriber};
use tracing_subscriber::Layer;
use tracing_subscriber::layer::Context;

use super::CHANGES;

/// A call site may log this many lines of one `reason` …
const MOST: u32 = 5;

/// … in this time; the rest are counted.
pub(super) const WINDOW: Duration = Duration::from_secs(10);

/// A call site and the field `reason` of its line, which is empty if it has none.
type Place = (Identifier, String);

/// For each place, how many lines it has logged of late, and how many were left out and not reported yet. Reasons are codes, so there are
/// few.
#[derive(Clone, Debug, Default)]
pub(super) struct LeftOut(Arc<Mutex<HashMap<Place, CallSite>>>);

impl LeftOut {
    fn places(&self) -> MutexGuard<'_, HashMap<Place, CallSite>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Tells what is due at this time.
    pub(super) fn tell(&self, now: Instant) {
        // Without the lock: these come back to the layer.
        for CallSite {
            level,
            left_out,
            last,
            ..
        } in self.over(now)
        {
            if level <= Level::WARN {
                tracing::warn!("{left_out} more such lines were left out, the last: {last}");
            } else {
                tracing::info!("{left_out} more such lines were left out, the last: {last}");
            }
        }
    }

    /// Tells all, as at the end.
    pub(super) fn tell_all(&self) {
        self.tell(Instant::now() + WINDOW);
    }

    /// Whether this is to be heard.
    fn hear(&self, place: Place, level: Level, words: &str, now: Instant) -> bool {
        let mut places = self.places();
        let place = places.entry(place).or_insert_with(|| CallSite {
            since: now,
            level,
            heard: 0,
            left_out: 0,
            last: String::new(),
        });
        if place.heard == MOST {
            place.left_out += 1;
            place.last.clear();
            place.last.push_str(words);
            return false;
        }
        place.heard += 1;
        true
    }

    /// Forgets the places whose time is over, and gives those that left anything out.
    fn over(&self, now: Instant) -> Vec<CallSite> {
        self.places()
            .extract_if(|_, place| now >= place.since + WINDOW)
            .map(|(_, place)| place)
            .filter(|place| place.left_out > 0)
            .collect()
    }
}

impl<S: Subscriber> Layer<S> for LeftOut {
    /// Whether any layer hears of it.
    fn event_enabled(&self, event: &Event<'_>, _: Context<'_, S>) -> bool {
        let metadata = event.metadata();
        if [module_path!(), CHANGES].contains(&metadata.target()) {
            return true;
        }
        let mut words = Words::default();
        event.record(&mut words);
        let now = Instant::now();
        self.tell(now);
        let place = (metadata.callsite(), words.reason);
        self.hear(place, *metadata.level(), &words.message, now)
    }
}

/// Message and reason of an event.
#[derive(Default)]
struct Words {
    message: String,
    reason: String,
}

impl Visit for Words {
    fn record_debug(&mut self, field: &Field, value: &dyn Debug) {
        let text = match field.name() {
            "message" => &mut self.message,
            "reason" => &mut self.reason,
            _ => return,
        };
        // Writing to a String does not fail.
        let _ = write!(text, "{value:?}");
    }
}

#[derive(Debug)]
struct CallSite {
    since: Instant,
    level: Level,
    heard: u32,
    left_out: u32,
    /// What was left out last.
    last: String,
}

#[cfg(test)]
mod tests {
    use std::io;

    use tracing::Callsite;
    use tracing_subscriber::prelude::*;

    use super::*;

    fn here() -> Place {
        struct Here;
        impl Callsite for Here {
            fn set_interest(&self, _: tracing::subscriber::Interest) {}
            fn metadata(&self) -> &tracing::Metadata<'_> {
                unimplemented!("nobody asks")
            }
        }
        (Identifier(&Here), String::new())
    }

    #[test]
    fn a_flood_is_heard_five_times_in_its_time_and_counted() {
        let left_out = LeftOut::default();
        let begun = Instant::now();
        let mut heard = Vec::new();
        let mut over = Vec::new();
        for s in 0..24 {
            let now = begun + Duration::from_secs(s);
            over.extend(left_out.over(now));
            if left_out.hear(here(), Level::WARN, &format!("gone {s}"), now) {
                heard.push(s);
            }
        }
        assert_eq!(heard, [0, 1, 2, 3, 4, 10, 11, 12, 13, 14, 20, 21, 22, 23]);
        let told: Vec<_> = over
            .iter()
            .map(|place| (place.level, place.left_out, place.last.as_str()))
            .collect();
        assert_eq!(
            told,
            [(Level::WARN, 5, "gone 9"), (Level::WARN, 5, "gone 19")]
        );
    }

    #[derive(Clone, Default)]
    struct Paper(Arc<Mutex<Vec<u8>>>);

    impl io::Write for Paper {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.0.lock().unwrap().extend_from_slice(bytes);
            Ok(bytes.len())
        }
        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn a_flood_does_not_pass_the_real_layers_and_is_told_at_the_end() {
        let paper = Paper::default();
        let writer = paper.clone();
        let lines = tracing_subscriber::fmt::layer().with_writer(move || writer.clone());
        let left_out = LeftOut::default();
        let log = tracing_subscriber::registry()
            .with(lines)
            .with(left_out.clone());
        tracing::subscriber::with_default(log, || {
            for t_s in 0..1000 {
                tracing::warn!(t_s, "the board has gone");
            }
            tracing::info!("another thing");
            for reason in ["disturbed", "good", "unplugged"] {
                for _ in 0..5 {
                    tracing::warn!(reason, "{reason}");
                }
            }
            for number in 0..20 {
                tracing::info!(target: CHANGES, "asked for rollback {number}");
            }
            for _ in 0..2 {
                left_out.tell_all();
            }
        });
        let text = String::from_utf8(paper.0.lock().unwrap().clone()).unwrap();
        assert_eq!(text.lines().count(), 42, "{text}");
        let last = "995 more such lines were left out, the last: the board has gone\n";
        assert!(text.ends_with(last), "{text}");
    }
}
