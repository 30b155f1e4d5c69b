//! Calibration: from raw samples of a turn to parameters and a verdict.
//!
//! `fit_turn` runs it: `plane` chooses samples, mode and plane, and `windows` what the swarm sees (`rist`); `swarm` searches with the
//! `objective` until `mpsot` stops it; `refine` takes the result to maximum likelihood over all samples of the turn (`levelling` levels
//! them, `model_selection` adds soft iron); `evaluate` measures it, against the gyro too (`gyro_agreement`); `verdict` judges it.
//! Everything here is a pure function of its arguments: the same request gives the same outcome.
//!
//! Equations, sections and appendices are those of Ali et al., *Sensors* 2012, 12(9), doi:10.3390/s120912455, "the paper"; docs/paper.md
//! compares its results with ours.

pub mod coverage;
pub mod curve;
pub mod fit;
pub mod gyro_agreement;
pub mod jump;
pub mod model;
pub mod mpsot;
pub mod objective;
pub mod outcome;
pub mod plane;
pub mod policy;
pub mod refine;
pub mod rist;
pub mod settings;
pub mod swarm;
pub(crate) mod thinning;
pub mod verdict;

mod cross_validation;
mod evaluate;
mod fit_turn;
mod levelling;
mod medians;
mod model_selection;
mod request;
mod uncertainty;
mod windows;

use std::sync::atomic::AtomicBool;

use outcome::{Outcome, Verdict};

pub use request::{CompletedTurn, FieldSample, Request, during, last_rest};

/// Calibrates.
pub fn calibrate(request: &Request) -> Outcome {
    calibrate_unless(request, &AtomicBool::new(false))
}

/// Calibrates, and gives up soon after somebody sets `cancelled`. Left alone, it gives what [`calibrate`] does.
pub fn calibrate_unless(request: &Request, cancelled: &AtomicBool) -> Outcome {
    let mut outcome = Outcome::begun(request.settings.seed, request.samples.len());
    match fit_turn::calibrate(request, cancelled, &mut outcome) {
        Ok(message) => {
            outcome.verdict = Verdict::Accepted;
            (outcome.reason, outcome.message) = ("good", message);
        }
        Err(refusal) => outcome = outcome.refused(refusal),
    }
    outcome
}
