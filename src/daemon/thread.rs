//! Threads for whose outcome the runtime can wait.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::Builder;
use std::time::Duration;

use tokio::sync::oneshot;
use tokio::time::timeout;

use super::DaemonError;

/// What a thread and the daemon both see.
pub(super) type Shared<T> = Arc<Mutex<T>>;

pub(super) fn lock<T>(shared: &Mutex<T>) -> MutexGuard<'_, T> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

pub(super) struct Thread<T = ()> {
    name: &'static str,
    /// Its other end is dropped without an outcome when the work panics.
    outcome: oneshot::Receiver<T>,
}

impl<T: Send + 'static> Thread<T> {
    pub(super) fn start(
        name: &'static str,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> Result<Self, DaemonError> {
        let (sender, outcome) = oneshot::channel();
        // An outcome that nobody waits for is dropped here.
        let spawned = Builder::new()
            .name(name.to_owned())
            .spawn(move || drop(sender.send(work())));
        spawned
            .map(|_| Self { name, outcome })
            .map_err(|source| DaemonError::Thread { name, source })
    }

    /// Waits for the outcome; `None` if the work panicked. Nothing is lost when the wait is given up.
    pub(super) async fn outcome(&mut self) -> Option<T> {
        (&mut self.outcome).await.ok()
    }

    /// Waits up to `patience` for the outcome. `None` if the work hangs or panicked, which is logged.
    pub(super) async fn end(mut self, patience: Duration) -> Option<T> {
        let name = self.name;
        let Ok(outcome) = timeout(patience, self.outcome()).await else {
            tracing::warn!("the thread of the {name} hangs; ending without it");
            return None;
        };
        if outcome.is_none() {
            tracing::error!("the thread of the {name} panicked");
        }
        outcome
    }
}
