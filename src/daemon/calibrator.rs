//! Calibrates on a thread of its own, one calibration at a time.

use std::future::pending;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use tokio::time::timeout_at;

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
    /// The calibration is given up at this time: a reload waits for its end.
    deadline: Option<Instant>,
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
            deadline: None,
            failed,
        });
    }

    /// Gives up the calibration under way, if there is one: its outcome comes soon.
    pub(super) fn cancel(&mut self) {
        if let Some(running) = &self.running {
            running.cancelled.store(true, Ordering::Relaxed);
        }
    }

    /// Somebody waits for the end of the calibration under way, and no longer than until the deadline.
    pub(super) fn hurry(&mut self, deadline: Instant) {
        if let Some(running) = &mut self.running
            && !running.cancelled.load(Ordering::Relaxed)
        {
            running.deadline = Some(deadline);
        }
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
        let outcome = match (&mut running.thread, running.deadline) {
            (Some(thread), Some(deadline)) => {
                match timeout_at(deadline.into(), thread.outcome()).await {
                    Ok(outcome) => outcome,
                    Err(_) => {
                        tracing::warn!(
                            "the calibration under way takes too long, and is given up: turn the board again"
                        );
                        running.deadline = None;
                        running.cancelled.store(true, Ordering::Relaxed);
                        thread.outcome().await
                    }
                }
            }
            (Some(thread), None) => thread.outcome().await,
            (None, _) => None,
        };
        let outcome = outcome.unwrap_or_else(|| running.failed.clone());
        self.running = None;
        outcome
    }
}
