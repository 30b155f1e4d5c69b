//! Calibrates on a thread of its own, one calibration at a time.

use std::future::pending;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use super::thread::Thread;
use crate::calibration::outcome::Outcome;
use crate::calibration::{Request, calibrate_unless};

#[derive(Default)]
pub(super) struct Calibrator {
    running: Option<RunningCalibration>,
}

struct RunningCalibration {
    /// None if it could not be started.
    thread: Option<Thread<Outcome>>,
    /// Whether nobody wants the outcome any more.
    cancelled: Arc<AtomicBool>,
    /// The outcome if the thread fails: the pipeline waits for one.
    failed: Outcome,
}

impl Calibrator {
    /// Starts a calibration. The pipeline asks for none while one is under way.
    pub(super) fn start(&mut self, request: Request) {
        let failed = Outcome {
            reason: "internal",
            message: "internal error during calibration: please report it with a log of the turn"
                .to_owned(),
            ..Outcome::begun(request.settings.seed, request.samples.len())
        };
        let cancelled = Arc::new(AtomicBool::new(false));
        let its_own = Arc::clone(&cancelled);
        let work = move || {
            let begun = Instant::now();
            calibrate_unless(&request, &its_own).with_elapsed(begun.elapsed())
        };
        let thread = Thread::start("calibration", work)
            .inspect_err(|error| tracing::error!("{error}"))
            .ok();
        self.running = Some(RunningCalibration {
            thread,
            cancelled,
            failed,
        });
    }

    /// Gives up the calibration under way; returns whether there was one that was not given up before. Its outcome comes soon.
    pub(super) fn cancel(&mut self) -> bool {
        let running = self.running.as_ref();
        running.is_some_and(|running| !running.cancelled.swap(true, Ordering::Relaxed))
    }

    pub(super) fn is_busy(&self) -> bool {
        self.running.is_some()
    }

    /// Waits for the outcome of the calibration under way; for ever, if there is none. Nothing is lost if
    /// the wait is given up.
    pub(super) async fn outcome(&mut self) -> Outcome {
        let Some(running) = &mut self.running else {
            return pending().await;
        };
        let outcome = match &mut running.thread {
            Some(thread) => thread.outcome().await,
            None => None,
        };
        let outcome = outcome.unwrap_or_else(|| running.failed.clone());
        self.running = None;
        outcome
    }
}
