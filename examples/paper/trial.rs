//! One of the paper's tests, run with its own swarm and with ours.

use std::time::Instant;

use super::log::request;
use super::published::{PLANAR, Published, SPATIAL};
use headingd::calibration::calibrate;
use headingd::calibration::model::Mode;
use headingd::calibration::outcome::Outcome;
use headingd::calibration::settings::{
    ModeChoice, ModelChoice, Profile, Settings, StopChoice, WindowChoice,
};

/// What one run came to.
#[derive(Clone, Debug, PartialEq)]
pub struct TrialRun {
    /// Samples that the swarm saw.
    pub samples: usize,
    /// Its iterations.
    pub iterations: usize,
    /// What stopped it.
    pub stop: &'static str,
    /// How often a residual was worked out: particles, iterations and samples multiplied.
    pub residuals: u64,
    /// How long it took, milliseconds.
    pub elapsed_ms: f64,
    /// Scale factors.
    pub scale: Vec<f64>,
    /// Biases, milligauss.
    pub bias_mgauss: Vec<f64>,
}

/// One test.
#[derive(Clone, Debug)]
pub struct Trial {
    /// As the paper calls it.
    pub name: &'static str,
    /// Planar or spatial.
    pub mode: Mode,
    /// Samples in the log.
    pub total: usize,
    /// Profile `paper`, all samples, all iterations: Tables 1 and 3, "All".
    pub all: TrialRun,
    /// Profile `paper`, RIST, all iterations: "RIST", and "PSO" in Tables 2 and 4.
    pub rist: TrialRun,
    /// Profile `paper`, RIST and MPSOT: Tables 2 and 4, "MPSOT".
    pub mpsot: TrialRun,
    /// Profile `standard`, with its refinement.
    pub standard: TrialRun,
    /// The paper's own columns.
    pub published: Published,
}

impl Trial {
    /// Time of RIST's samples by that of all, as a share.
    pub fn rist_time_share(&self) -> f64 {
        self.rist.elapsed_ms / self.all.elapsed_ms
    }

    /// Time of MPSOT by that of the basic swarm on the same samples, as a share.
    pub fn mpsot_time_share(&self) -> f64 {
        self.mpsot.elapsed_ms / self.rist.elapsed_ms
    }

    /// How many axes it calibrates.
    pub fn axes(&self) -> usize {
        match self.mode {
            Mode::Planar => 2,
            Mode::Spatial => 3,
        }
    }
}

/// All tests of the paper with this seed, planar ones first. Says why if one cannot be calibrated.
///
/// # Errors
///
/// A calibration of one of them fails.
pub fn trials(seed: u64) -> Result<Vec<Trial>, String> {
    let planar = PLANAR.iter().map(|test| (Mode::Planar, test));
    let spatial = SPATIAL.iter().map(|test| (Mode::Spatial, test));
    planar
        .chain(spatial)
        .map(|(mode, test)| trial(mode, test, seed))
        .collect()
}

/// Runs one test.
///
/// # Errors
///
/// A calibration of it fails.
pub fn trial(mode: Mode, published: &Published, seed: u64) -> Result<Trial, String> {
    let run = |profile, window, stop| {
        let settings = Settings {
            mode: match mode {
                Mode::Planar => ModeChoice::Planar,
                Mode::Spatial => ModeChoice::Spatial,
            },
            model: ModelChoice::Diagonal,
            profile,
            window,
            stop,
            seed,
            ..Settings::default()
        };
        let request = request(mode, &published.all, seed, &settings);
        let begun = Instant::now();
        let outcome = calibrate(&request);
        (outcome, 1000.0 * begun.elapsed().as_secs_f64())
    };
    let fault = |outcome: &Outcome| format!("{}: {}", published.name, outcome.message);
    let paper = |window, stop| {
        let (outcome, elapsed_ms) = run(Profile::Paper, window, stop);
        let swarm = outcome.swarm.clone().ok_or_else(|| fault(&outcome))?;
        Ok::<TrialRun, String>(of(&outcome, elapsed_ms, swarm.scale, swarm.bias_mgauss))
    };
    let (standard, elapsed_ms) = run(Profile::Standard, WindowChoice::Rist, StopChoice::Mpsot);
    let refined = standard.scale.clone().zip(standard.bias_mgauss.clone());
    let (scale, bias_mgauss) = refined.ok_or_else(|| fault(&standard))?;
    Ok(Trial {
        name: published.name,
        mode,
        total: standard.samples.total,
        all: paper(WindowChoice::All, StopChoice::Basic)?,
        rist: paper(WindowChoice::Rist, StopChoice::Basic)?,
        mpsot: paper(WindowChoice::Rist, StopChoice::Mpsot)?,
        standard: of(&standard, elapsed_ms, scale, bias_mgauss),
        published: *published,
    })
}

fn of(outcome: &Outcome, elapsed_ms: f64, scale: Vec<f64>, bias_mgauss: Vec<f64>) -> TrialRun {
    let (particles, iterations, stop) = outcome
        .swarm
        .as_ref()
        .map_or((0, 0, ""), |s| (s.particles, s.iterations, s.stop));
    let samples = outcome.samples.window;
    TrialRun {
        samples,
        iterations,
        stop,
        residuals: (particles * iterations * samples) as u64,
        elapsed_ms,
        scale,
        bias_mgauss,
    }
}
