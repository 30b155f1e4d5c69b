//! Evaluates a fit: everything that is measured of it for the verdict.

use nalgebra::{SMatrix, SVector, Vector2, Vector3};

use super::coverage::{centre_inside, coverage_deg, direction_spread};
use super::cross_validation::{Parts, without_each_part};
use super::curve::{self, Curve, Distance};
use super::fit::Fitted;
use super::fit_turn::TurnFit;
use super::gyro_agreement::{self, GyroAgreement, Sighting};
use super::jump::largest_jump;
use super::model::{Calibration, Mode, Model, Parameters, Planar, Spatial};
use super::outcome::Outcome;
use super::plane::level_rest;
use super::refine::Refined;
use super::uncertainty::{correlation_length, heading_sd_deg};
use super::verdict::{self, Measures, Refusal};
use crate::frame::rows;

/// A rest before a turn is compared with this part of the turn, a quarter: over more of it the gyro drifts.
const FIRST_PART: usize = 4;

/// How many samples count as the last: a sixth of a second to a second of them, longer than a spike lasts.
const LAST: usize = 16;

/// Dip assumed for the predicted uncertainty of a heading where the vertical is not known, degrees:
/// between those of Rome and of Oslo.
const USUAL_DIP_DEG: f64 = 68.0;

/// The vertical field over the horizontal where a compass is still of use: a dip of 75°.
const STEEPEST: f64 = 3.7;

impl TurnFit<'_> {
    /// Measures and judges a fit, and fills in the outcome. Returns the message of an acceptance.
    ///
    /// # Errors
    ///
    /// The refusal, if the fit does not deserve trust.
    pub fn evaluate<const D: usize, const P: usize>(
        &self,
        fitted: &Fitted<D, P>,
        outcome: &mut Outcome,
    ) -> Result<String, Refusal> {
        let best = &fitted.best;
        let unusable = || Refusal::new("no_fit", "the fitted scale factors cannot be inverted");
        let curve = Curve::new(&best.position, best.reference_mgauss).ok_or_else(unusable)?;
        let measures = self.measure(fitted, &curve);
        self.report(fitted, &measures, outcome);
        verdict::judge(&measures, &self.request.limits)?;
        let against_gyro = match measures.gyro {
            Some(gyro) => format!("agrees with the gyro within {:.1} degrees", gyro.rms_deg),
            None => "no gyro to compare with".to_owned(),
        };
        Ok(format!(
            "{} samples fit within {:.1} milligauss, the fit's own deviation is {:.2} degrees of heading, {against_gyro}",
            best.used, best.residual_mgauss, measures.heading_sd_deg
        ))
    }

    /// Measures all that is judged of a fit.
    fn measure<const D: usize, const P: usize>(
        &self,
        fitted: &Fitted<D, P>,
        curve: &Curve<D, P>,
    ) -> Measures {
        let Fitted { points, best, .. } = fitted;
        let cutoff = best.cutoff_mgauss;
        let planar = self.plan.mode == Mode::Planar;
        let distances: Vec<Distance<P>> =
            points.iter().map(|point| curve.distance(point)).collect();
        let residuals: Vec<f64> = distances.iter().map(|d| d.value_mgauss).collect();
        let fits = |index: usize| residuals[index].abs() < cutoff;
        // A dip is measured in space only.
        let sightings = if planar {
            Vec::new()
        } else {
            self.sightings(points, |_| curve, fits)
        };
        let dip = gyro_agreement::mean_dip_rad(&sightings).unwrap_or(USUAL_DIP_DEG.to_radians());
        let heading_sd_deg = correlation_length(&residuals).sqrt()
            * heading_sd_deg(
                self.plan.mode,
                &self.request.mounting,
                curve,
                &best.covariance,
                dip,
            );
        let scale = &best.position[D..2 * D];
        let mean_scale = scale.iter().sum::<f64>() / D as f64;
        let directions: Vec<SVector<f64, D>> = points
            .iter()
            .map(|point| SVector::from(curve.correct(point)).normalize())
            .collect();
        let seen = self.sightings(points, |_| curve, |_| true);
        Measures {
            coverage_deg: planar.then(|| coverage_deg(&directions)),
            direction_spread: (!planar).then(|| direction_spread(&directions)),
            outlier_share: 1.0 - best.used as f64 / points.len() as f64,
            end_outlier_share: end_outlier_share(&residuals, cutoff),
            residual_share: best.residual_mgauss / (best.reference_mgauss * mean_scale),
            scale: scale.to_vec(),
            strength_mgauss: best.reference_mgauss,
            reference_given: self.reference().is_some(),
            centre_inside: centre_inside(points, &best.position[..D]),
            heading_sd_deg,
            gyro: self.cross_validated(points, &distances, best, fits),
            jump: largest_jump(&seen),
            rest_share: self.rest_share(&seen, curve, best.reference_mgauss),
            dip_spread_deg: gyro_agreement::dip_spread_deg(&sightings),
        }
    }

    /// Puts the fit, and what was measured of it, into the outcome.
    fn report<const D: usize, const P: usize>(
        &self,
        fitted: &Fitted<D, P>,
        measures: &Measures,
        outcome: &mut Outcome,
    ) {
        let Fitted { level, best, .. } = fitted;
        let position = &best.position;
        outcome.samples.used = best.used;
        outcome.reference_mgauss = self.reference();
        outcome.residual_mgauss = Some(best.residual_mgauss);
        outcome.heading_sd_deg = Some(measures.heading_sd_deg);
        outcome.gyro_rms_deg = measures.gyro.map(|gyro| gyro.rms_deg);
        outcome.bias_mgauss = Some(position[..D].to_vec());
        outcome.scale = Some(measures.scale.clone());
        if P > 2 * D {
            outcome.model = Some(Model::Symmetric);
            outcome.matrix = Some(rows(&curve::matrix::<3>(&position[D..])).into());
        }
        outcome.measures = Some(measures.clone());
        outcome.calibration = Some(Calibration {
            reference_mgauss: self.reference(),
            ..Calibration::of(
                self.parameters::<D>(position, level),
                best.reference_mgauss,
                best.residual_mgauss,
                measures.heading_sd_deg,
            )
        });
    }

    fn parameters<const D: usize>(&self, position: &[f64], level: &[f64]) -> Parameters {
        let (bias, entries) = position.split_at(D);
        if self.plan.mode == Mode::Planar {
            return Parameters::Planar(Planar {
                basis: self.plan.basis,
                bias_mgauss: Vector2::from_column_slice(bias),
                scale: Vector2::from_column_slice(entries),
                level: Vector2::from_column_slice(level),
            });
        }
        let bias = Vector3::from_column_slice(bias);
        Parameters::Spatial(if entries.len() > D {
            Spatial {
                model: Model::Symmetric,
                bias_mgauss: bias,
                matrix: curve::matrix(entries),
            }
        } else {
            Spatial::diagonal(bias, Vector3::from_column_slice(entries))
        })
    }

    /// The samples with a pose that are `wanted`, corrected by the curve that holds for each.
    fn sightings<'c, const D: usize, const P: usize>(
        &self,
        points: &[[f64; D]],
        curve_of: impl Fn(usize) -> &'c Curve<D, P>,
        wanted: impl Fn(usize) -> bool,
    ) -> Vec<Sighting> {
        let samples = &self.request.samples[self.plan.samples.clone()];
        let axes_body = self.axes_body::<D>();
        let mut sightings = Vec::with_capacity(points.len());
        for (index, (sample, point)) in samples.iter().zip(points).enumerate() {
            let Some(pose) = sample.pose.filter(|_| wanted(index)) else {
                continue;
            };
            sightings.push(Sighting {
                t_s: sample.t_s,
                pose,
                field_body: axes_body * SVector::from(curve_of(index).correct(point)),
            });
        }
        sightings
    }

    /// How far the field at rest before the turn is from the mean of the turn's first part, in the gyro's frame, as a share of this
    /// strength. What a lean at rest adds by the vertical field is taken off.
    /// `None` without a sample at rest, or if the gyro was lost in between.
    fn rest_share<const D: usize, const P: usize>(
        &self,
        seen: &[Sighting],
        curve: &Curve<D, P>,
        strength_mgauss: f64,
    ) -> Option<f64> {
        let (rest, lean_rad) = match self.plan.mode {
            Mode::Planar => level_rest(self.request)?,
            Mode::Spatial => (self.request.rest?, 0.0),
        };
        let pose = rest.pose?;
        let samples = &self.request.samples[self.plan.samples.clone()];
        // Over several turns a gyro of a wrong scale would have turned the frame.
        let first_turn = self.request.turns.first();
        let turn_len =
            first_turn.map_or(samples.len(), |turn| turn.samples.len().min(samples.len()));
        let first = &samples[..turn_len / FIRST_PART];
        let begins = first.iter().filter(|sample| sample.pose.is_some()).count();
        let turned: Vec<Vector3<f64>> = seen[..begins]
            .iter()
            .filter(|sighting| sighting.pose.frame_id == pose.frame_id)
            .map(|sighting| sighting.pose.orientation * sighting.field_body)
            .collect();
        let sum: Vector3<f64> = turned.iter().sum();
        let point = self.plan.project(&rest);
        let rested =
            pose.orientation * (self.axes_body::<D>() * SVector::from(curve.correct(&point)));
        let apart = (sum / turned.len() as f64 - rested).norm();
        let by_lean = STEEPEST * lean_rad;
        (!turned.is_empty()).then(|| (apart / strength_mgauss - by_lean).max(0.0))
    }

    /// The calibrated axes, body axes.
    fn axes_body<const D: usize>(&self) -> SMatrix<f64, 3, D> {
        let chip_axes = match self.plan.mode {
            Mode::Planar => [self.plan.basis[0], self.plan.basis[1], Vector3::zeros()],
            Mode::Spatial => [Vector3::x(), Vector3::y(), Vector3::z()],
        };
        SMatrix::from_fn(|row, column| self.request.mounting.to_body(chip_axes[column])[row])
    }

    /// Each part of the samples is corrected by a fit to the other parts.
    fn cross_validated<const D: usize, const P: usize>(
        &self,
        points: &[[f64; D]],
        distances: &[Distance<P>],
        best: &Refined<P>,
        fits: impl Fn(usize) -> bool,
    ) -> Option<GyroAgreement> {
        let parts = Parts::new(points.len(), self.turn_ends());
        let curves = without_each_part(points, distances, best, &parts)
            .iter()
            .map(|position| Curve::new(position, best.reference_mgauss))
            .collect::<Option<Vec<Curve<D, P>>>>()?;
        let part_of = parts.of_each_sample();
        let sightings = self.sightings(points, |index| &curves[part_of[index]], fits);
        match self.plan.mode {
            Mode::Planar => {
                let to_body = |axis| self.request.mounting.to_body(axis);
                gyro_agreement::planar(&sightings, self.plan.basis.map(to_body))
            }
            Mode::Spatial => gyro_agreement::spatial(&sightings),
        }
    }

    /// Where turns begin and end among the plan's samples. In the plane nothing depends on it: each turn shows all of the curve.
    fn turn_ends(&self) -> Vec<usize> {
        let plan = &self.plan.samples;
        let turns = match self.plan.mode {
            Mode::Planar => &[],
            Mode::Spatial => self.request.turns.as_slice(),
        };
        let ends = turns.iter().flat_map(|t| [t.samples.start, t.samples.end]);
        ends.map(|end| end.clamp(plan.start, plan.end) - plan.start)
            .collect()
    }
}

/// The share of outliers among the last samples.
fn end_outlier_share(residuals: &[f64], cutoff_mgauss: f64) -> f64 {
    let last = &residuals[residuals.len().saturating_sub(LAST)..];
    let outliers = last
        .iter()
        .filter(|residual| residual.abs() >= cutoff_mgauss)
        .count();
    outliers as f64 / last.len() as f64
}
