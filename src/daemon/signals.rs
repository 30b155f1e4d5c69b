//! The signals that end the daemon.

use std::future::poll_fn;
use std::io;
use std::task::Poll;

use tokio::signal::unix::{Signal, SignalKind, signal};

/// Signals that are caught from now on.
pub struct Signals {
    caught: Vec<(SignalKind, Signal)>,
}

impl Signals {
    /// Catches these signals, to which the system's own answer would be to kill the process. Needs a runtime.
    pub fn catch(kinds: &[SignalKind]) -> io::Result<Self> {
        let caught = kinds.iter().map(|&kind| Ok((kind, signal(kind)?)));
        Ok(Self {
            caught: caught.collect::<io::Result<_>>()?,
        })
    }

    /// Waits for one of them.
    pub async fn received(&mut self) -> SignalKind {
        poll_fn(|context| {
            for (kind, signal) in &mut self.caught {
                if signal.poll_recv(context).is_ready() {
                    return Poll::Ready(*kind);
                }
            }
            Poll::Pending
        })
        .await
    }
}
