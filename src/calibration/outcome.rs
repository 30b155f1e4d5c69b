//! The outcome of a calibration: the object that `calibrate --json` prints and class `CALIBRATION` carries.

use std::ops::Range;
use std::time::Duration;

use serde::Serialize;

use super::model::{Calibration, Mode, Model, Parameters};
use super::verdict::{Measures, Refusal};
use crate::check::words;
use crate::frame::rows;

words! {
    /// What became of a candidate.
    #[derive(Default)]
    pub enum Verdict {
        /// Good, and active from now on.
        Accepted = "accepted",
        /// Not better than the active calibration, which stays.
        Kept = "kept",
        /// Not to be trusted.
        #[default]
        Rejected = "rejected",
    }
}

/// What is said of a calibration whose outcome nobody wants any more.
pub const CANCELLED: &str =
    "discarded: it was cancelled, or another command arrived while it was computed";

/// Everything that is known about one calibration. Unknown is `None`, and null in JSON. Flat keys come
/// first: some clients stop reading an object at its first array.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Outcome {
    /// Accepted, kept or rejected.
    pub verdict: Verdict,
    /// Why, as a code that a program can read.
    pub reason: &'static str,
    /// Why, as a sentence for a person.
    pub message: String,
    /// `turn`, from a full turn by RIST and the swarm, or `motion`, from the running estimate.
    pub method: &'static str,
    /// Planar or spatial.
    pub mode: Option<Mode>,
    /// Diagonal, symmetric or general.
    pub model: Option<Model>,
    /// The reference field, milligauss; unknown if none was given, and then the scale factors have a mean of 1.
    pub reference_mgauss: Option<f64>,
    /// Spread of the samples about the fit, one standard deviation across the curve, milligauss.
    pub residual_mgauss: Option<f64>,
    /// Predicted uncertainty of a heading, one standard deviation, degrees.
    pub heading_sd_deg: Option<f64>,
    /// Corrected heading against the gyro, cross-validated, RMS, degrees.
    pub gyro_rms_deg: Option<f64>,
    /// Seed of the swarm.
    pub seed: u64,
    /// Planar: the two unit vectors, chip axes, that span the plane.
    pub basis: Option<[[f64; 3]; 2]>,
    /// b of Equation 1, milligauss: along the basis, or chip axes.
    pub bias_mgauss: Option<Vec<f64>>,
    /// The diagonal of A of Equation 1: along the basis, or chip axes.
    pub scale: Option<Vec<f64>>,
    /// A of Equation 1, row by row; symmetric and general models only.
    pub matrix: Option<[f64; 9]>,
    /// Rotation from the gyro's axes to the magnetometer's, a rotation vector in magnetometer chip axes, degrees;
    /// general model only.
    pub alignment_deg: Option<[f64; 3]>,
    /// What the motion did not show, and the calibration therefore says nothing about: `across_plane`, bias and
    /// scale factor across the plane of a planar calibration's turn; `soft_iron`, the off-diagonal entries of A.
    pub unobserved: &'static [&'static str],
    /// How many samples took part.
    pub samples: Samples,
    /// From the first to the last sample that the swarm saw, as indices among all; `end` is the first one outside.
    pub window: Option<Range<usize>>,
    /// What the swarm found, before refinement.
    pub swarm: Option<SwarmReport>,
    /// How long the calibration took, microseconds; unknown in a replay and for what motion has taught.
    pub elapsed_us: Option<u64>,
    /// What was judged, where it came to that.
    #[serde(skip)]
    pub measures: Option<Measures>,
    /// The calibration to make active, if accepted.
    #[serde(skip)]
    pub calibration: Option<Calibration>,
}

impl Outcome {
    /// This outcome of a calibration that took so long.
    pub fn with_elapsed(self, elapsed: Duration) -> Self {
        Self {
            elapsed_us: Some(elapsed.as_micros() as u64),
            ..self
        }
    }

    /// Of a calibration that has only begun, with this seed and so many samples: rejected until it is found to be good.
    pub fn begun(seed: u64, samples: usize) -> Self {
        Self {
            method: "turn",
            seed,
            samples: Samples {
                total: samples,
                ..Samples::default()
            },
            ..Self::default()
        }
    }

    /// The same, refused: its figures stay, its calibration does not.
    pub fn refused(self, refusal: Refusal) -> Self {
        Self {
            verdict: Verdict::Rejected,
            reason: refusal.reason,
            message: refusal.message,
            calibration: None,
            ..self
        }
    }

    /// This outcome, if it was accepted and `turns` was rejected; otherwise `turns`.
    pub fn in_place_of(self, turns: Self) -> Self {
        if (turns.verdict, self.verdict) != (Verdict::Rejected, Verdict::Accepted) {
            return turns;
        }
        Self {
            message: format!(
                "{}; the full turns were refused ({}): {}",
                self.message, turns.reason, turns.message
            ),
            ..self
        }
    }

    /// The outcome of the running estimate; `measured` are the axes whose bias is known. `None` of a planar calibration: the estimate has
    /// three axes.
    pub fn of_motion(calibration: Calibration, measured: [bool; 3]) -> Option<Self> {
        let Parameters::Spatial(spatial) = &calibration.parameters else {
            return None;
        };
        Some(Self {
            verdict: Verdict::Accepted,
            reason: "good",
            message: format!(
                "learnt from motion: headings are certain to {:.1} degrees",
                calibration.heading_sd_deg
            ),
            method: "motion",
            mode: Some(Mode::Spatial),
            model: Some(spatial.model),
            residual_mgauss: Some(calibration.residual_mgauss),
            heading_sd_deg: Some(calibration.heading_sd_deg),
            bias_mgauss: Some(spatial.bias_mgauss.as_slice().to_vec()),
            scale: Some(spatial.matrix.diagonal().as_slice().to_vec()),
            matrix: Some(rows(&spatial.matrix).into()),
            alignment_deg: spatial
                .alignment_rad()
                .map(|turn| turn.map(f64::to_degrees).into()),
            unobserved: if measured.iter().all(|&known| known) {
                &[]
            } else {
                &["across_plane"]
            },
            calibration: Some(calibration),
            ..Self::default()
        })
    }
}

/// Counts of samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Samples {
    /// In the log; live, from the start of the first turn to the end of the last. A value that the source holds counts once.
    pub total: usize,
    /// In the turns; all, without a turn or if the setting `window` is `all`.
    pub turn: usize,
    /// What the swarm saw, by default RIST's windows.
    pub window: usize,
    /// In the refinement, with a weight above 0: outliers are left out.
    pub used: usize,
}

/// What the swarm did and found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SwarmReport {
    /// `paper` or `standard`.
    pub profile: &'static str,
    /// How many particles.
    pub particles: usize,
    /// Iterations until it stopped.
    pub iterations: usize,
    /// What stopped it: `iterations`, `error` or `change`.
    pub stop: &'static str,
    /// Equation 8 at the global best, milligauss².
    pub fit_value: f64,
    /// The same after each iteration.
    #[serde(skip)]
    pub fit_values: Vec<f64>,
    /// The samples that it saw, by default RIST's windows.
    #[serde(skip)]
    pub windows: Vec<Range<usize>>,
    /// The global best's bias, milligauss.
    pub bias_mgauss: Vec<f64>,
    /// The global best's scale factors.
    pub scale: Vec<f64>,
}
