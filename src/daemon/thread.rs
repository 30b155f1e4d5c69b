//! Threads whose end the runtime can wait for.

use std::thread::{Builder, JoinHandle};
use std::time::Duration;

use tokio::sync::oneshot;
use tokio::time::timeout;

use super::DaemonError;

pub(super) struct Thread {
    name: &'static str,
    handle: JoinHandle<()>,
    /// Its other end is dropped when the work is done.
    ended: oneshot::Receiver<()>,
}

impl Thread {
    pub(super) fn start(
        name: &'static str,
        work: impl FnOnce() + Send + 'static,
    ) -> Result<Self, DaemonError> {
        let (running, ended) = oneshot::channel();
        let spawned = Builder::new().name(name.to_owned()).spawn(move || {
            let _running = running;
            work();
        });
        spawned
            .map(|handle| Self {
                name,
                handle,
                ended,
            })
            .map_err(|source| DaemonError::Thread { name, source })
    }

    /// Waits up to `patience` for the work to end, and returns whether it did.
    pub(super) async fn end(self, patience: Duration) -> bool {
        let name = self.name;
        if timeout(patience, self.ended).await.is_err() {
            tracing::warn!("the thread of the {name} hangs; ending without it");
            return false;
        }
        // Its work is done, so this takes no time.
        if self.handle.join().is_err() {
            tracing::error!("the thread of the {name} panicked");
        }
        true
    }
}
