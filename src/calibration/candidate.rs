//! One candidate from samples to verdict, in two or three dimensions.

use std::ops::Range;
use std::time::Duration;

use nalgebra::{SMatrix, SVector, Vector2, Vector3};

use super::agreement::{self, Agreement, Sighting};
use super::coverage::{
    self, centre_inside, coverage_deg, direction, direction_spread, sphere_share,
};
use super::fit::{self, Fit, Normalised};
use super::jump::largest_jump;
use super::model::{Calibration, Mode, Model, Parameters, Planar, Spatial};
use super::objective::Position;
use super::outcome::{Outcome, SwarmReport, Window};
use super::plane::{self, Plan};
use super::refine::{median, refine, residual};
use super::rist;
use super::settings::WindowChoice;
use super::verdict::{self, Measures, Refusal, Standing};
use super::{Request, Sample, wobble};

/// Below this many samples nothing is tried.
const LEAST_SAMPLES: usize = 20;

/// Parts in a cross-validation: each is judged by a fit to the other three.
const FOLDS: usize = 4;

/// Dip assumed for the predicted uncertainty of a heading where the vertical is not known, degrees:
/// between those of Rome and of Oslo.
const USUAL_DIP_DEG: f64 = 68.0;

/// A stopwatch over a clock that may not know the time.
pub struct Clock<'a> {
    clock: &'a dyn Fn() -> Option<Duration>,
    start: Option<Duration>,
}

impl<'a> Clock<'a> {
    pub fn start(clock: &'a dyn Fn() -> Option<Duration>) -> Self {
        Self {
            clock,
            start: clock(),
        }
    }

    pub fn elapsed_us(&self) -> Option<u64> {
        let elapsed = (self.clock)()?.checked_sub(self.start?)?;
        Some(u64::try_from(elapsed.as_micros()).unwrap_or(u64::MAX))
    }
}

/// Calibrates and fills in the outcome as far as it gets. The sentence of an acceptance, or a refusal.
pub fn calibrate(
    request: &Request,
    clock: &dyn Fn() -> Option<Duration>,
    outcome: &mut Outcome,
) -> Result<String, Refusal> {
    if request.samples.len() < LEAST_SAMPLES {
        return Err(Refusal::new(
            "too_few_samples",
            format!(
                "there are {} magnetometer samples; at least {LEAST_SAMPLES} are needed",
                request.samples.len()
            ),
        ));
    }
    let usable = |s: &Sample| {
        let field = || s.field_mgauss.iter();
        let pose = s
            .pose
            .iter()
            .flat_map(|pose| pose.orientation.coords.iter());
        s.t_s.is_finite()
            && field().all(|b| b.abs() < 1e6)
            && pose.into_iter().all(|q| q.is_finite())
    };
    if !request.samples.iter().all(usable) {
        return Err(Refusal::new(
            "bad_samples",
            "a sample is not a finite number of milligauss, or its time or pose is none",
        ));
    }
    let plan = plane::plan(request).ok_or_else(|| {
        Refusal::new(
            "no_plane",
            "the gyro shows no rotation, so nothing tells the plane of the turn",
        )
    })?;
    outcome.mode = Some(plan.mode);
    outcome.model = Some(Model::Diagonal);
    outcome.samples.turn = plan.stretch.len();
    match plan.mode {
        Mode::Planar => {
            outcome.basis = Some(plan.basis.map(Into::into));
            let [e1, e2] = plan.basis;
            let project = |s: &Sample| [e1.dot(&s.field_mgauss), e2.dot(&s.field_mgauss)];
            Work::<2, 4> {
                request,
                plan: &plan,
                project: &project,
            }
            .run::<5>(clock, outcome)
        }
        Mode::Spatial => {
            let project = |s: &Sample| s.field_mgauss.into();
            Work::<3, 6> {
                request,
                plan: &plan,
                project: &project,
            }
            .run::<7>(clock, outcome)
        }
    }
}

/// A calibration under way.
struct Work<'a, const D: usize, const P: usize> {
    request: &'a Request,
    plan: &'a Plan,
    /// A sample's components along the axes that are calibrated.
    project: &'a dyn Fn(&Sample) -> [f64; D],
}

impl<const D: usize, const P: usize> Work<'_, D, P> {
    fn run<const F: usize>(
        &self,
        clock: &dyn Fn() -> Option<Duration>,
        outcome: &mut Outcome,
    ) -> Result<String, Refusal> {
        let settings = &self.request.settings;
        let reference = match self.plan.mode {
            Mode::Planar => settings.horizontal_mgauss,
            Mode::Spatial => settings.total_mgauss,
        };
        if reference.is_some_and(|reference| !(reference > 0.0 && reference.is_finite())) {
            return Err(Refusal::new(
                "bad_reference",
                "the reference field is not a strength above 0",
            ));
        }
        let stretch = &self.request.samples[self.plan.stretch.clone()];
        let points: Vec<[f64; D]> = stretch.iter().map(self.project).collect();
        if let Some(axis) = self.stuck_axis(stretch, &points) {
            let name = ["X", "Y", "Z"][axis];
            return Err(Refusal::new(
                "stuck_axis",
                format!(
                    "chip axis {name} told the same number while the field turned: it is stuck, or at the end of its range"
                ),
            ));
        }

        let watch = Clock::start(clock);
        let windows = self.windows();
        outcome.elapsed_us.rist = watch.elapsed_us();
        let hull = rist::join(windows.iter().cloned());
        outcome.window = Some(Window {
            start: hull.start,
            end: hull.end,
        });
        outcome.samples.window = windows.iter().map(Range::len).sum();

        let watch = Clock::start(clock);
        let seen: Vec<[f64; D]> = windows
            .iter()
            .flat_map(|window| {
                self.request.samples[window.clone()]
                    .iter()
                    .map(self.project)
            })
            .collect();
        let seen = fit::without_spikes(&seen);
        let swarm = fit::swarm::<D, P, F>(&seen, reference, settings).ok_or_else(|| {
            Refusal::new(
                "no_motion",
                "the field hardly changed: the board did not turn, or the magnetometer is stuck",
            )
        })?;
        outcome.elapsed_us.swarm = watch.elapsed_us();
        outcome.swarm = Some(SwarmReport {
            profile: settings.profile.word(),
            particles: settings.particles,
            iterations: swarm.found.iterations,
            stop: swarm.found.stop.word(),
            fit_value: swarm.found.fit_value,
            bias_mgauss: swarm.found.position[..D].to_vec(),
            scale: swarm.found.position[D..].to_vec(),
        });

        let watch = Clock::start(clock);
        let (points, fitted) = self.refine(points, &swarm, reference.is_some()).ok_or_else(|| {
            Refusal::new("no_fit", "no ellipse fits the samples: they show too little of the curve, or no curve at all")
        })?;
        outcome.elapsed_us.refine = watch.elapsed_us();

        let watch = Clock::start(clock);
        let result = self.judge(&points, &fitted, reference, outcome);
        outcome.elapsed_us.verdict = watch.elapsed_us();
        result
    }

    /// A chip axis in the plane of the turn that stood still while the field moved by half of its swing. In space
    /// this proves nothing: a roll about an axis leaves the axis as it is.
    fn stuck_axis(&self, samples: &[Sample], points: &[[f64; D]]) -> Option<usize> {
        const LEAST_STILL: usize = 10;
        if self.plan.mode == Mode::Spatial {
            return None;
        }
        let swing = coverage::swing(points);
        (0..3).find(|&axis| {
            let [e1, e2] = self.plan.basis;
            let in_plane = e1[axis].hypot(e2[axis]) > 0.7;
            let mut from = 0;
            in_plane
                && samples
                    .chunk_by(|a, b| a.field_mgauss[axis] == b.field_mgauss[axis])
                    .any(|run| {
                        let here = &points[from..from + run.len()];
                        from += run.len();
                        // A spike or a hole in the log moves the other axes too.
                        run.len() >= LEAST_STILL
                            && coverage::swing(&fit::without_spikes(here)) > 0.5 * swing
                    })
        })
    }

    /// Refines the swarm's answer; in the plane, with the samples levelled as far as the tilt is known.
    fn refine(
        &self,
        points: Vec<[f64; D]>,
        swarm: &Fit<D, P>,
        reference_given: bool,
    ) -> Option<(Vec<[f64; D]>, Normalised<P>)> {
        const ROUNDS: usize = 5;
        let start = &swarm.found.position;
        let fit = |points: &[[f64; D]], start: &Position<P>, reference| {
            fit::refined(points, start, reference, reference_given)
        };
        let mut fitted = fit(&points, start, swarm.reference_mgauss)?;
        let Some(wobble) = self.wobble() else {
            return Some((points, fitted));
        };
        let mut level = points.clone();
        let mut vertical_mgauss = 0.0;
        for _ in 0..ROUNDS {
            let Normalised {
                refined,
                reference_mgauss,
            } = fitted;
            vertical_mgauss += wobble::vertical_mgauss(&level, &wobble, &refined, reference_mgauss);
            level = wobble::levelled(&points, &wobble, &refined.position, vertical_mgauss);
            fitted = fit(&level, &refined.position, reference_mgauss)?;
        }
        Some((level, fitted))
    }

    /// How the board wobbled about its mean tilt during the stretch. A sample whose tilt is unknown, as
    /// after a hole in the gyro's account, is taken to have the mean.
    fn wobble(&self) -> Option<Vec<[f64; D]>> {
        if self.plan.mode == Mode::Spatial {
            return None;
        }
        let down = self.request.samples[self.plan.stretch.clone()]
            .iter()
            .map(|sample| {
                let pose = sample.pose.filter(|pose| pose.vertical_known)?;
                let down = pose.orientation.inverse_transform_vector(&-Vector3::z());
                let down = self.request.mounting.to_chip(down);
                Some(std::array::from_fn(|axis| self.plan.basis[axis].dot(&down)))
            });
        wobble::wobble(down.collect())
    }

    /// The swarm's windows: RIST for each axis, inside one full turn. In the plane that is the first
    /// turn; in space, for each axis the turn in which it swings most. Windows that overlap are joined.
    fn windows(&self) -> Vec<Range<usize>> {
        let turns: Vec<Range<usize>> = self
            .request
            .turns
            .iter()
            .map(|turn| turn.samples.clone())
            .collect();
        let whole = self.plan.stretch.clone();
        if self.request.settings.window != WindowChoice::Rist {
            return vec![whole];
        }
        let turns = match self.plan.mode {
            Mode::Planar => turns.into_iter().take(1).collect(),
            Mode::Spatial => turns,
        };
        let turns = if turns.is_empty() { vec![whole] } else { turns };
        let values = |turn: &Range<usize>, axis: usize| -> Vec<f64> {
            self.request.samples[turn.clone()]
                .iter()
                .map(|s| (self.project)(s)[axis])
                .collect()
        };
        let swing = |turn: &Range<usize>, axis: usize| {
            let values = values(turn, axis);
            let high = values.iter().copied().fold(f64::MIN, f64::max);
            high - values.iter().copied().fold(f64::MAX, f64::min)
        };
        let mut windows: Vec<Range<usize>> = (0..D)
            .filter_map(|axis| {
                let turn = turns
                    .iter()
                    .max_by(|a, b| swing(a, axis).total_cmp(&swing(b, axis)))?;
                let window = rist::window(values(turn, axis));
                Some(turn.start + window.start..turn.start + window.end)
            })
            .collect();
        windows.sort_by_key(|window| window.start);
        windows.dedup_by(|next, last| {
            let overlap = next.start <= last.end;
            if overlap {
                last.end = last.end.max(next.end);
            }
            overlap
        });
        windows
    }

    fn judge(
        &self,
        points: &[[f64; D]],
        fitted: &Normalised<P>,
        reference: Option<f64>,
        outcome: &mut Outcome,
    ) -> Result<String, Refusal> {
        let Normalised {
            refined,
            reference_mgauss,
        } = fitted;
        let position = &refined.position;
        let parameters = self
            .parameters(position)
            .ok_or_else(|| Refusal::new("no_fit", "the fitted scale factors cannot be inverted"))?;
        let sightings = self.sightings(
            points,
            |_| *position,
            *reference_mgauss,
            refined.cutoff_mgauss,
        );
        let dip = agreement::mean_dip_rad(&sightings).unwrap_or(USUAL_DIP_DEG.to_radians());
        let heading_sd_deg = self.correlation(points, position, *reference_mgauss).sqrt()
            * self.heading_sd_deg(position, &refined.covariance, *reference_mgauss, dip);
        let gyro = self.cross_validated(points, fitted);
        let mean_scale = position[D..].iter().sum::<f64>() / D as f64;

        outcome.samples.used = refined.used;
        outcome.reference_mgauss = reference;
        outcome.residual_mgauss = Some(refined.residual_mgauss);
        outcome.heading_sd_deg = Some(heading_sd_deg);
        outcome.gyro_rms_deg = gyro.map(|gyro| gyro.rms_deg);
        outcome.bias_mgauss = Some(position[..D].to_vec());
        outcome.scale = Some(position[D..].to_vec());
        outcome.calibration = Some(Calibration {
            parameters,
            reference_mgauss: reference,
            strength_mgauss: *reference_mgauss,
            residual_mgauss: refined.residual_mgauss,
            heading_sd_deg,
        });

        let directions: Vec<SVector<f64, D>> = points
            .iter()
            .map(|point| direction(point, position))
            .collect();
        let planar = self.plan.mode == Mode::Planar;
        let measures = Measures {
            coverage_deg: planar.then(|| coverage_deg(&directions)),
            sphere_share: (!planar && self.request.turns.is_empty()).then(|| {
                sphere_share(
                    directions
                        .iter()
                        .map(|u| Vector3::new(u[0], u[1], u[D - 1])),
                )
            }),
            direction_spread: (!planar).then(|| direction_spread(&directions)),
            outlier_share: 1.0 - refined.used as f64 / points.len() as f64,
            end_outlier_share: self.end_outlier_share(points, fitted),
            residual_share: refined.residual_mgauss / (reference_mgauss * mean_scale),
            scale: position[D..].to_vec(),
            reference_given: reference.is_some(),
            centre_inside: centre_inside(points, position),
            heading_sd_deg,
            gyro,
            jump: largest_jump(&self.sightings(
                points,
                |_| *position,
                *reference_mgauss,
                f64::INFINITY,
            )),
            dip_spread_deg: if planar {
                None
            } else {
                agreement::dip_spread_deg(&sightings)
            },
        };
        verdict::judge(&measures, &self.request.limits)?;
        self.beats_the_one_in_force(&parameters, heading_sd_deg)?;

        let against_gyro = match gyro {
            Some(gyro) => format!("agrees with the gyro within {:.1} degrees", gyro.rms_deg),
            None => "no gyro to compare with".to_owned(),
        };
        Ok(format!(
            "{} samples fit within {:.1} milligauss, headings are certain to {:.2} degrees, {against_gyro}",
            refined.used, refined.residual_mgauss, heading_sd_deg
        ))
    }

    /// The share of outliers among the last samples.
    fn end_outlier_share(&self, points: &[[f64; D]], fitted: &Normalised<P>) -> f64 {
        const LAST: usize = 16;
        let last = &points[points.len().saturating_sub(LAST)..];
        let Normalised {
            refined,
            reference_mgauss,
        } = fitted;
        let off = |point: &&[f64; D]| {
            residual(point, &refined.position, *reference_mgauss).abs() >= refined.cutoff_mgauss
        };
        last.iter().filter(off).count() as f64 / last.len() as f64
    }

    fn parameters(&self, position: &Position<P>) -> Option<Parameters> {
        match self.plan.mode {
            Mode::Planar => Some(Parameters::Planar(Planar {
                basis: self.plan.basis,
                bias_mgauss: Vector2::new(position[0], position[1]),
                scale: Vector2::new(position[D], position[D + 1]),
            })),
            Mode::Spatial => Spatial::diagonal(
                Vector3::from_column_slice(&position[..3]),
                Vector3::from_column_slice(&position[D..D + 3]),
            )
            .map(Parameters::Spatial),
        }
    }

    /// The samples with a pose and without outliers, corrected by the position that holds for each.
    fn sightings(
        &self,
        points: &[[f64; D]],
        position_of: impl Fn(usize) -> Position<P>,
        reference_mgauss: f64,
        cutoff_mgauss: f64,
    ) -> Vec<Sighting> {
        let samples = &self.request.samples[self.plan.stretch.clone()];
        let mut sightings = Vec::with_capacity(points.len());
        for (index, (sample, point)) in samples.iter().zip(points).enumerate() {
            let Some(pose) = sample.pose else { continue };
            let position = position_of(index);
            if residual(point, &position, reference_mgauss).abs() >= cutoff_mgauss {
                continue;
            }
            let h: [f64; D] =
                std::array::from_fn(|axis| (point[axis] - position[axis]) / position[D + axis]);
            let field = match self.plan.mode {
                Mode::Planar => self.plan.basis[0] * h[0] + self.plan.basis[1] * h[1],
                Mode::Spatial => Vector3::from_column_slice(&h[..3]),
            };
            sightings.push(Sighting {
                t_s: sample.t_s,
                pose,
                field_body: self.request.mounting.to_body(field),
            });
        }
        sightings
    }

    fn agreement(&self, sightings: &[Sighting]) -> Option<Agreement> {
        match self.plan.mode {
            Mode::Planar => agreement::planar(sightings, &self.normal_body()),
            Mode::Spatial => agreement::spatial(sightings),
        }
    }

    fn normal_body(&self) -> Vector3<f64> {
        let [e1, e2] = self.plan.basis;
        self.request.mounting.to_body(e1.cross(&e2))
    }

    /// Each part of the samples is corrected by a fit to the other parts.
    fn cross_validated(&self, points: &[[f64; D]], fitted: &Normalised<P>) -> Option<Agreement> {
        if !self
            .request
            .samples
            .iter()
            .any(|sample| sample.pose.is_some())
        {
            return None;
        }
        let reference = fitted.reference_mgauss;
        let part = points.len().div_ceil(FOLDS);
        let positions: Vec<Position<P>> = (0..FOLDS)
            .map(|fold| {
                let first = (fold * part).min(points.len());
                let others = [
                    &points[..first],
                    &points[(first + part).min(points.len())..],
                ]
                .concat();
                refine(&others, &fitted.refined.position, reference)
                    .map_or(fitted.refined.position, |refined| refined.position)
            })
            .collect();
        let cutoff = fitted.refined.cutoff_mgauss;
        self.agreement(&self.sightings(points, |index| positions[index / part], reference, cutoff))
    }

    /// How many samples one independent sample takes: 1 for white noise, more where the residuals are
    /// those of a model that does not quite fit. Their autocorrelation, summed up to where it is lost in
    /// noise (Geyer's initial sequence, Statistical Science 7, 1992).
    fn correlation(
        &self,
        points: &[[f64; D]],
        position: &Position<P>,
        reference_mgauss: f64,
    ) -> f64 {
        let residuals: Vec<f64> = points
            .iter()
            .map(|point| residual(point, position, reference_mgauss))
            .collect();
        let variance: f64 = residuals.iter().map(|e| e * e).sum();
        let noise = 2.0 / (residuals.len() as f64).sqrt();
        let mut sum = 1.0;
        for lag in 1..residuals.len() / 4 {
            let products = residuals.iter().zip(&residuals[lag..]).map(|(a, b)| a * b);
            let correlation = products.sum::<f64>() / variance;
            if correlation < noise || correlation.is_nan() {
                break;
            }
            sum += 2.0 * correlation;
        }
        sum
    }

    /// One standard deviation of a level board's heading, RMS over all headings, from the parameters'
    /// covariance.
    fn heading_sd_deg(
        &self,
        position: &Position<P>,
        covariance: &SMatrix<f64, P, P>,
        reference_mgauss: f64,
        dip_rad: f64,
    ) -> f64 {
        const HEADINGS: usize = 36;
        let mut variance = 0.0;
        for k in 0..HEADINGS {
            let (sin, cos) = (std::f64::consts::TAU * k as f64 / HEADINGS as f64).sin_cos();
            // The field of strength 1 along the calibrated axes, and how its azimuth changes with them.
            let (h, azimuth): ([f64; D], [f64; D]) = match self.plan.mode {
                Mode::Planar => (
                    std::array::from_fn(|i| [cos, sin][i]),
                    std::array::from_fn(|i| [-sin, cos][i]),
                ),
                Mode::Spatial => {
                    let level = Vector3::new(cos, -sin, dip_rad.tan()) * dip_rad.cos();
                    let across = Vector3::new(sin, cos, 0.0) / dip_rad.cos();
                    let (h, across) = (
                        self.request.mounting.to_chip(level),
                        self.request.mounting.to_chip(across),
                    );
                    (
                        std::array::from_fn(|i| h[i]),
                        std::array::from_fn(|i| across[i]),
                    )
                }
            };
            // δh = −δb/(a·Hm) − h·δa/a.
            let mut gradient = SVector::<f64, P>::zeros();
            for axis in 0..D {
                let scale = position[D + axis];
                gradient[axis] = -azimuth[axis] / scale;
                gradient[D + axis] = -azimuth[axis] * h[axis] / scale;
            }
            for axis in 0..D {
                gradient[axis] /= reference_mgauss;
            }
            variance += gradient.dot(&(covariance * gradient)) / HEADINGS as f64;
        }
        variance.max(0.0).sqrt().to_degrees()
    }

    /// Holds the candidate against the calibration in force, on the same samples.
    fn beats_the_one_in_force(
        &self,
        candidate: &Parameters,
        heading_sd_deg: f64,
    ) -> Result<(), Refusal> {
        let Some(in_force) = &self.request.in_force else {
            return Ok(());
        };
        let samples = &self.request.samples[self.plan.stretch.clone()];
        let standing = |parameters: &Parameters, heading_sd_deg: f64| {
            let strengths: Vec<f64> = samples
                .iter()
                .map(|s| parameters.correct(&s.field_mgauss).norm())
                .collect();
            let corrected: Vec<Sighting> = samples
                .iter()
                .filter_map(|s| {
                    let field = parameters.correct(&s.field_mgauss);
                    let field_body = self.request.mounting.to_body(field);
                    s.pose.map(|pose| Sighting {
                        t_s: s.t_s,
                        pose,
                        field_body,
                    })
                })
                .collect();
            Standing {
                strength_spread: relative_spread(strengths),
                gyro_rms_deg: self
                    .agreement(&corrected)
                    .map(|agreement| agreement.rms_deg),
                heading_sd_deg,
                spatial: parameters.mode() == Mode::Spatial,
            }
        };
        verdict::replaces(
            &standing(candidate, heading_sd_deg),
            &standing(&in_force.parameters, in_force.heading_sd_deg),
        )
    }
}

/// Robust standard deviation over median.
fn relative_spread(mut values: Vec<f64>) -> f64 {
    let Some(middle) = median(&mut values) else {
        return f64::INFINITY;
    };
    let mut off: Vec<f64> = values.iter().map(|value| (value - middle).abs()).collect();
    1.4826 * median(&mut off).unwrap_or(f64::INFINITY) / middle.abs().max(1e-9)
}
