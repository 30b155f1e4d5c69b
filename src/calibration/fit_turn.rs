//! Fits a turn: from samples to parameters, in two or three dimensions.

use std::sync::atomic::AtomicBool;

use nalgebra::Vector3;

use super::curve::ParameterVector;
use super::fit::{self, Fitted};
use super::model::{Mode, Model};
use super::model_selection::{SoftIron, select_model};
use super::mpsot::Stop;
use super::outcome::{CANCELLED, Outcome, SwarmReport};
use super::plane::{self, Plan};
use super::request::{FieldSample, Request};
use super::verdict::Refusal;
use super::windows::windows;
use super::{coverage, levelling};
use crate::frame::hypot;
use crate::reading::{LEAST_HORIZONTAL_MGAUSS, LEAST_STEPS, SAME_SAMPLES};

/// Smallest swing of the field in a turn, milligauss: a third of that of the weakest horizontal field. A weaker one is refused with the fit,
/// which says how strong it is.
const LEAST_SWING_MGAUSS: f64 = 2.0 * LEAST_HORIZONTAL_MGAUSS / 3.0;

/// A calibration needs at least this many samples.
const LEAST_SAMPLES: usize = 20;
/// A calibration on a turn needs at least this many: steps of more than 15° count as gaps in its coverage.
const LEAST_IN_TURN: usize = 24;

/// Calibrates, unless it is `cancelled`, and fills in the outcome as far as it gets. Returns the message of an acceptance.
///
/// # Errors
///
/// The refusal, if the samples do not allow a fit, or if the fit does not deserve trust.
pub fn calibrate(
    request: &Request,
    cancelled: &AtomicBool,
    outcome: &mut Outcome,
) -> Result<String, Refusal> {
    check_count(request)?;
    let plan = &plan(request)?;
    outcome.mode = Some(plan.mode);
    outcome.model = Some(Model::Diagonal);
    outcome.samples.turn = plan.samples.len();
    let turn = TurnFit {
        request,
        plan,
        cancelled,
    };
    match plan.mode {
        Mode::Planar => {
            outcome.unobserved = &["across_plane", "soft_iron"];
            outcome.basis = Some(plan.basis.map(Into::into));
            let fitted = turn.fit::<2, 4, 5>(outcome)?;
            turn.evaluate(&fitted, outcome)
        }
        Mode::Spatial => {
            let fitted = turn.fit::<3, 6, 7>(outcome)?;
            let found = select_model(&fitted, turn.reference().is_some(), request.settings.model);
            if let SoftIron::Found(fitted) = found {
                return turn.evaluate(&fitted, outcome);
            }
            if let SoftIron::Unseen = found {
                outcome.unobserved = &["soft_iron"];
            }
            turn.evaluate(&fitted, outcome)
        }
    }
}

/// Refuses too few samples.
fn check_count(request: &Request) -> Result<(), Refusal> {
    if request.samples.len() < LEAST_SAMPLES {
        return Err(Refusal::new(
            "too_few_samples",
            match request.samples.len() {
                0 => "there are no magnetometer samples that can be used: connect the magnetometer, name its columns in the log mx, my and mz, or check its unit"
                    .to_owned(),
                count => format!("at least {LEAST_SAMPLES} magnetometer samples are needed, and there are only {count}"),
            },
        ));
    }
    Ok(())
}

/// The plan, if there is a plane where one is needed, and enough samples in a turn.
fn plan(request: &Request) -> Result<Plan, Refusal> {
    let plan = plane::plan(request).ok_or_else(|| {
        let message = "the gyro shows no rotation, so nothing tells the plane of the turn";
        Refusal::new("no_plane", message)
    })?;
    let count = plan.samples.len();
    if !request.turns.is_empty() && count < LEAST_IN_TURN {
        let message = format!(
            "the turn has {count} magnetometer samples; at least {LEAST_IN_TURN} are needed, one each 15 degrees"
        );
        return Err(Refusal::new("too_few_samples", message));
    }
    Ok(plan)
}

/// The samples hardly differ.
fn no_motion() -> Refusal {
    Refusal::new(
        "no_motion",
        "the field hardly changed: the board did not turn, the magnetometer is stuck, or its unit or the gyro's is not the one stated",
    )
}

/// The fit of a turn: what it is asked for, and what was chosen for it.
pub struct TurnFit<'a> {
    pub request: &'a Request,
    pub plan: &'a Plan,
    pub cancelled: &'a AtomicBool,
}

impl TurnFit<'_> {
    /// The reference field that was given for this mode.
    pub fn reference(&self) -> Option<f64> {
        match self.plan.mode {
            Mode::Planar => self.request.settings.horizontal_mgauss,
            Mode::Spatial => self.request.settings.total_mgauss,
        }
    }

    /// Window, swarm and refinement under the diagonal model.
    fn fit<const D: usize, const P: usize, const F: usize>(
        &self,
        outcome: &mut Outcome,
    ) -> Result<Fitted<D, P>, Refusal> {
        let reference = self.reference();
        let points = self.moving_points::<D>()?;
        let windows = windows::<D>(self.request, self.plan);
        let seen = windows
            .iter()
            .flat_map(|window| &self.request.samples[window.clone()]);
        let seen: Vec<[f64; D]> = seen.map(|one| self.plan.project(one)).collect();
        let ends = windows.first().zip(windows.last());
        outcome.window = ends.map(|(first, last)| first.start..last.end);
        outcome.samples.window = seen.len();

        let settings = &self.request.settings;
        let seen = fit::without_spikes(&seen);
        let bounds = fit::bounds(&seen, reference).ok_or_else(no_motion)?;
        let swarm = fit::swarm::<D, P, F>(&seen, &bounds, settings, self.cancelled);
        let swarm = swarm.ok_or_else(no_motion)?;
        if swarm.stop == Stop::Cancelled {
            return Err(Refusal::new("cancelled", CANCELLED));
        }
        outcome.swarm = Some(SwarmReport {
            profile: settings.profile.word(),
            particles: settings.particles,
            iterations: swarm.fit_values.len(),
            stop: swarm.stop.word(),
            fit_value: swarm.fit_value,
            fit_values: swarm.fit_values,
            windows,
            bias_mgauss: swarm.position[..D].to_vec(),
            scale: swarm.position[D..].to_vec(),
        });
        self.refine(points, &swarm.position, bounds.reference_mgauss, reference.is_some())
            .ok_or_else(|| {
                let message = "no ellipse fits the samples: they show too little of the curve, or no curve at all";
                Refusal::new("no_fit", message)
            })
    }

    /// The plan's samples along the calibrated axes, if the field swings in them and no axis is stuck.
    fn moving_points<const D: usize>(&self) -> Result<Vec<[f64; D]>, Refusal> {
        let samples = &self.request.samples[self.plan.samples.clone()];
        let points: Vec<[f64; D]> = samples.iter().map(|one| self.plan.project(one)).collect();
        let swing = coverage::swing(&points);
        if swing < LEAST_SWING_MGAUSS {
            return Err(no_motion());
        }
        if let Some(axis) = self.stuck_axis(samples, &points, swing) {
            let name = ["X", "Y", "Z"][axis];
            let message = format!(
                "chip axis {name} read the same number while the field turned: it is stuck, or at the end of its range"
            );
            return Err(Refusal::new("stuck_axis", message));
        }
        Ok(points)
    }

    /// Finds a chip axis in the plane of the turn that is stuck or clipped: it reads the same number over an arc in which a working axis
    /// changes by at least two of its steps, even around its extreme. With a gyro, `saturation` has left such samples out already. In space
    /// this proves nothing: a roll about an axis leaves the axis as it is.
    fn stuck_axis<const D: usize>(
        &self,
        samples: &[FieldSample],
        points: &[[f64; D]],
        swing: f64,
    ) -> Option<usize> {
        if self.plan.mode == Mode::Spatial {
            return None;
        }
        (0..3).find(|&axis| {
            let [e1, e2] = self.plan.basis;
            if hypot(e1[axis], e2[axis]) <= 0.7 {
                return false;
            }
            let step = smallest_step(samples.iter().map(|sample| sample.field_mgauss[axis]));
            let mut from = 0;
            samples
                .chunk_by(|a, b| a.field_mgauss[axis] == b.field_mgauss[axis])
                .any(|run| {
                    let here = &points[from..from + run.len()];
                    from += run.len();
                    // A log may repeat a sample until there is a new one.
                    if here.chunk_by(|a, b| a == b).count() < SAME_SAMPLES {
                        return false;
                    }
                    // A spike or a gap in the log moves the other axes too.
                    let sine = (coverage::swing(&fit::without_spikes(here)) / swing).min(1.0);
                    let least_change = 0.5 * swing * (1.0 - (1.0 - sine * sine).sqrt());
                    least_change > LEAST_STEPS * step
                })
        })
    }

    /// Refines the swarm's answer `start`; in the plane, with the samples levelled as far as the tilt is known.
    fn refine<const D: usize, const P: usize>(
        &self,
        points: Vec<[f64; D]>,
        start: &ParameterVector<P>,
        reference_mgauss: f64,
        reference_given: bool,
    ) -> Option<Fitted<D, P>> {
        const ROUNDS: usize = 5;
        let fit = |points: &[[f64; D]], start: &ParameterVector<P>, reference| {
            fit::refine_and_normalize(points, start, reference, reference_given)
        };
        let mut fitted = fit(&points, start, reference_mgauss)?;
        let down = match self.plan.mode {
            Mode::Planar => self.down(),
            Mode::Spatial => Vec::new(),
        };
        let mean = levelling::mean(&down);
        let Some(tilt) = levelling::uneven_tilt(&down, mean) else {
            return Some(Fitted {
                points,
                level: mean,
                best: fitted,
            });
        };
        let mut level = points.clone();
        let mut vertical_mgauss = 0.0;
        for _ in 0..ROUNDS {
            vertical_mgauss += levelling::vertical_mgauss(&level, &tilt, &fitted);
            level = levelling::levelled(&points, &tilt, &fitted.position, vertical_mgauss);
            fitted = fit(&level, &fitted.position, fitted.reference_mgauss)?;
        }
        Some(Fitted {
            points: level,
            level: mean,
            best: fitted,
        })
    }

    /// Down during the plan's samples, along the calibrated axes, where the tilt is known.
    fn down<const D: usize>(&self) -> Vec<Option<[f64; D]>> {
        let down = |sample: &FieldSample| {
            let pose = sample.pose.filter(|pose| pose.vertical_known)?;
            let down = pose.orientation.inverse_transform_vector(&-Vector3::z());
            let down = self.request.mounting.to_chip(down);
            Some(std::array::from_fn(|axis| self.plan.basis[axis].dot(&down)))
        };
        self.request.samples[self.plan.samples.clone()]
            .iter()
            .map(down)
            .collect()
    }
}

/// Smallest non-zero step between consecutive values, milligauss: one count of the chip. At least 1, the noise of good chips.
fn smallest_step(values: impl Iterator<Item = f64> + Clone) -> f64 {
    let next = values.clone().skip(1);
    let steps = values.zip(next).map(|(value, next)| (next - value).abs());
    let smallest = steps.filter(|step| *step > 0.0).reduce(f64::min);
    smallest.unwrap_or_default().max(1.0)
}
