//! Single-threaded tokio runtime and signal handling.

use std::future::pending;

use tokio::runtime::{Builder, Runtime};
use tokio::signal::unix::{SignalKind, signal};
use tokio::sync::mpsc;

use super::{Failure, OrFail};

/// A runtime of one thread for everything that waits.
pub(super) fn runtime() -> Result<Runtime, Failure> {
    let built = Builder::new_current_thread().enable_all().build();
    built.or_fail(Failure::SYSTEM, "cannot start")
}

/// The signals that end a command.
pub(super) const ENDS: [SignalKind; 3] = [
    SignalKind::terminate(),
    SignalKind::interrupt(),
    SignalKind::hangup(),
];

/// Makes a write beyond the limit on file sizes (`ulimit -f`) an error, as on a full disk, instead of the end of the process.
/// Needs a runtime.
pub(super) fn outlive_file_limits() -> Result<(), Failure> {
    let kind = SignalKind::from_raw(libc::SIGXFSZ);
    // Once caught it stays so, whether or not anybody listens.
    signal(kind)
        .map(drop)
        .or_fail(Failure::SYSTEM, "cannot catch signals")
}

/// Signals that are caught from now on.
pub(super) struct Signals {
    caught: mpsc::Receiver<SignalKind>,
}

impl Signals {
    /// Catches these signals, which would end the process otherwise. Needs a runtime.
    ///
    /// Each signal has a task that feeds one queue: the main loop, which wakes a hundred times a second, polls the queue
    /// instead of every signal.
    pub fn catch(kinds: &[SignalKind]) -> Result<Self, Failure> {
        let (sender, caught) = mpsc::channel(kinds.len().max(1));
        for &kind in kinds {
            let mut signal = signal(kind).or_fail(Failure::SYSTEM, "cannot catch signals")?;
            let sender = sender.clone();
            tokio::spawn(async move {
                while signal.recv().await.is_some() && sender.send(kind).await.is_ok() {}
            });
        }
        Ok(Self { caught })
    }

    /// Waits for one of them. Nothing is lost when the wait is given up.
    pub async fn received(&mut self) -> SignalKind {
        match self.caught.recv().await {
            Some(kind) => kind,
            // The runtime is at its end.
            None => pending().await,
        }
    }
}
