//! The lines of each heading that is due.

use std::sync::Arc;

use tokio::sync::broadcast::Receiver;
use tokio::sync::broadcast::error::RecvError;

use super::Format;
use crate::publish::feed::{Broadcast, Feed};
use crate::publish::rate_limit::RateLimit;
use crate::publish::signalk;

/// Headings in a format, as often as is set.
pub(super) struct HeadingLines {
    format: Format,
    feed: Arc<Feed>,
    ring: Receiver<Broadcast>,
    pace: RateLimit,
}

impl HeadingLines {
    pub(super) fn new(feed: Arc<Feed>, format: Format) -> Self {
        Self {
            format,
            ring: feed.subscribe(),
            pace: RateLimit::new(Some(feed.nmea_rate_hz())),
            feed,
        }
    }

    /// Waits for the next heading that may be steered by; its lines. `None` after the last. Nothing is lost when the
    /// wait is given up.
    pub(super) async fn next(&mut self) -> Option<String> {
        loop {
            match self.ring.recv().await {
                Ok(Broadcast::Heading(heading)) => {
                    let taken = heading.taken;
                    if self.feed.is_stale(taken) || !self.pace.admits(taken) {
                        continue;
                    }
                    let text = match self.format {
                        Format::Nmea => self.feed.nmea(&heading).to_owned(),
                        Format::SignalK => {
                            signalk::delta(&heading.heading, heading.time.as_deref())
                        }
                    };
                    if !text.is_empty() {
                        return Some(text);
                    }
                }
                Ok(_) => {}
                // A client that could not keep up goes on with what comes from now on.
                Err(RecvError::Lagged(_)) => self.ring = self.ring.resubscribe(),
                Err(RecvError::Closed) => return None,
            }
        }
    }
}
