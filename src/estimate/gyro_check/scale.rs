//! The gyro's scale by the field, whatever iron there is.
//!
//! A field that stands still turns against the board. With y the raw field, b the hard iron, D the soft iron and the rotation
//! between the chips, and ω what the gyro reads,
//!
//! ```text
//! dy/dt = s D (D⁻¹ (y − b) × ω)
//! ```
//!
//! where s is how fast the board turns over how fast the gyro reads that it does: 1 where the gyro is right. ω is the reading less its
//! bias. The scale errors that gravity has shown are put back: of an error of 10 %, gravity soon removes half. Over a moment the change of
//! y is linear in s and in s b, so that a regression over moments gives both, and their deviations. The hard iron is estimated here and not
//! taken from the filter, since a filter that a wrong gyro has misled agrees with that gyro. D and the magnetometer's lag are the filter's.
//! Without D, soft iron of 5 % changes s by as much where the board swings about one attitude. Over full turns a wrong D cannot hide a
//! wrong scale, since D [ω]× D⁻¹ has the eigenvalues of [ω]×; over an arc it can hide some.

use nalgebra::{Matrix3, Matrix3x4, Matrix4, Vector3, Vector4};

use super::GyroVerdict;
use crate::estimate::filter::{Filter, Input};
use crate::estimate::prior::{FIELD_MGAUSS, IRON};
use crate::frame::put;

#[cfg(test)]
mod tests;

/// A moment ends when the gyro has turned this far, radians (14°), or after this time, seconds. What the field has changed by must
/// not end it: that would choose the moments in which noise adds to the change.
const MOMENT_RAD: f64 = 0.25;
const MOMENT_S: f64 = 1.5;
/// Moments of a smaller turn are noise, radians.
const LEAST_RAD: f64 = 0.1;
/// A larger change from one sample to the next ends the moment without a result.
const JUMP: f64 = 0.3;
/// So does a longer time between them, seconds: the rate in a gap is not known.
const GAP_S: f64 = 0.3;
/// A larger change between two samples than `NO_TURN` (50 mG) plus `MOST_BY_TURNING` for each radian that the gyro reads is iron that has
/// come or gone, not a turn: the strongest field on earth, 670 mG, and a gyro that reads half of the true rate.
const NO_TURN: f64 = 0.1;
const MOST_BY_TURNING: f64 = 2.7;
/// A moment counts in full if its rotation is known to this share, which is less than the scale may be off. If less is known, it counts
/// by that much less; beyond the second share it does not count. The gyro's bias is uncertain and, where the rate changes, so is the magnetometer's lag.
const UNKNOWN_SHARE: f64 = 0.03;
const MOST_UNKNOWN_SHARE: f64 = 0.3;
/// So many moments are remembered, ten radians of turning, and fewer than these say nothing: there are four unknowns.
const MEMORY: f64 = 40.0;
const LEAST_MOMENTS: f64 = 8.0;
/// The least scatter of a change, as a share of the field: even places differ by 0.7 %, at both ends.
const SCATTER: f64 = 0.01;
/// Least share of the information on s that must be left when the iron is found from the same moments. An arc of 100° leaves a
/// quarter; a shorter one does not tell a scale from iron.
const LEFT: f64 = 0.25;
/// The same for the first headings, before the gyro has been shown to be right. That takes four moments: with forgetting, three count as
/// 2.93. Four moments determine the four unknowns even on a level board. The scale must then be off by more deviations.
const FIRST_MOMENTS: f64 = 3.0;
const FIRST_LEFT: f64 = 0.1;
const FIRST_DEVIATIONS: f64 = 2.0;
/// The same for a gyro that turns the opposite way: no iron looks like that, if the moments fit.
const OPPOSED_MOMENTS: f64 = 5.0;
/// A scale is wrong when it is further from 1 than 5 %, and than that by three deviations.
const TOLERANCE: f64 = 0.05;
const DEVIATIONS: f64 = 3.0;
/// The best scale must also leave less than this share of the squared change unexplained: iron that passes leaves more. Noise and
/// unevenness of 2 % leave 4 % of the squared change of the smallest moment that counts. A field that changes less than by a turn of
/// `LEAST_RAD` may be all noise: the gyro reads far too much.
const FITS: f64 = 0.1;
/// The axes are wrong, not the scale, if the best scale leaves more than this share, unless the field may be all noise.
const UNEXPLAINED: f64 = 0.3;

/// A regression over moments, older ones forgotten.
#[derive(Clone, Debug, Default)]
pub(super) struct GyroScale {
    moment: Option<TurnedMoment>,
    /// Sums over moments: of JᵀJ, of Jᵀ times the change, and of the squared change, with J the slopes by s and by s b.
    information: Matrix4<f64>,
    seen: Vector4<f64>,
    squares: f64,
    moments: f64,
    /// Sum over moments: what is not known of the rotation, as a share of it, where that is more than `UNKNOWN_SHARE`.
    unknown_share: f64,
    /// Mean variance of the entries of the filter's D at the last moment.
    matrix2: f64,
}

/// Fields are shares of `FIELD_MGAUSS`.
#[derive(Clone, Copy, Debug)]
struct TurnedMoment {
    age_s: f64,
    /// The filter's D when the moment began, and its inverse.
    d: Matrix3<f64>,
    inverse: Matrix3<f64>,
    first: Vector3<f64>,
    /// Of the newest sample.
    last: Vector3<f64>,
    /// Integrals of D⁻¹ y × ω and of ω.
    predicted: Vector3<f64>,
    turned_rad: Vector3<f64>,
    /// Of the first sample.
    rate_rad_s: Vector3<f64>,
}

/// What the regression finds.
struct FoundScale {
    /// s and its deviation.
    scale: f64,
    sd: f64,
    /// The share of the squared change that it leaves.
    unexplained: f64,
    moments: f64,
    /// The share of the information on s that is left when the iron is found from the same moments.
    left: f64,
}

impl FoundScale {
    /// Whether the moments tell the scale from iron.
    fn is_enough(&self) -> bool {
        self.moments >= LEAST_MOMENTS && self.left > LEFT
    }

    /// How far the scale is from 1.
    fn off(&self) -> f64 {
        (self.scale - 1.0).abs()
    }
}

impl GyroScale {
    /// Takes a sample, and what the filter knows of the gyro's bias. Whether the sample ended a moment that counts.
    pub(super) fn take(&mut self, input: &Input, filter: &Filter) -> bool {
        let (bias, variance) = filter.gyro_bias();
        let bias_sd = variance.max().sqrt();
        let field = input.field_mgauss / FIELD_MGAUSS;
        let free_rad = input.turned_rad - bias * input.period_s;
        let turned_rad = free_rad + input.board.gyro_matrix * free_rad;
        let step = self.moment.map(|moment| (field - moment.last).norm());
        let most = NO_TURN + MOST_BY_TURNING * turned_rad.norm();
        if step.is_some_and(|step| step > most) {
            self.begin_anew();
        }
        let unbroken = input.period_s <= GAP_S && step.is_some_and(|step| step <= JUMP);
        let Some(mut moment) = self.moment.filter(|_| unbroken) else {
            self.moment = TurnedMoment::begin(input, filter);
            return false;
        };
        let mean = 0.5 * (moment.last + field);
        moment.age_s += input.period_s;
        moment.predicted += (moment.inverse * mean).cross(&turned_rad);
        moment.turned_rad += turned_rad;
        moment.last = field;
        let angle_rad = moment.turned_rad.norm();
        if angle_rad < MOMENT_RAD && moment.age_s < MOMENT_S {
            self.moment = Some(moment);
            return false;
        }
        let change = field - moment.first;
        let by_lag =
            filter.lag_beyond_s(input.lag_s) * (input.rate_rad_s - moment.rate_rad_s).norm();
        let unknown_share = (bias_sd * moment.age_s + by_lag) / angle_rad;
        let counts = angle_rad > LEAST_RAD && unknown_share < MOST_UNKNOWN_SHARE;
        self.moment = TurnedMoment::begin(input, filter);
        if counts {
            self.learn(&moment, &change, unknown_share);
            self.matrix2 = filter.matrix_variance();
        }
        counts
    }

    fn learn(&mut self, moment: &TurnedMoment, change: &Vector3<f64>, unknown_share: f64) {
        let mut slopes = Matrix3x4::zeros();
        put(&mut slopes, (0, 0), &(moment.d * moment.predicted));
        let by_iron = moment.d * moment.turned_rad.cross_matrix() * moment.inverse;
        put(&mut slopes, (0, 1), &by_iron);
        let weight = (UNKNOWN_SHARE / unknown_share).min(1.0);
        let keep = 1.0 - weight / MEMORY;
        self.information = self.information * keep + weight * slopes.transpose() * slopes;
        self.seen = self.seen * keep + weight * slopes.transpose() * change;
        self.squares = self.squares * keep + weight * change.norm_squared();
        self.moments = self.moments * keep + weight;
        let counted = if weight < 1.0 { unknown_share } else { 0.0 };
        self.unknown_share = self.unknown_share * keep + weight * counted;
    }

    /// Samples are missing.
    pub(super) fn lose_moment(&mut self) {
        self.moment = None;
    }

    /// Discards the moments, unless there are fewer than `LEAST_MOMENTS`: iron may have come or gone, or the gyro may have changed. If the
    /// gyro reads a quarter of the true rate, each turn looks like iron that has changed.
    pub(super) fn begin_anew(&mut self) {
        if self.moments >= LEAST_MOMENTS {
            *self = Self::default();
        }
    }

    /// What the moments say, however little that is.
    fn regress(&self) -> Option<FoundScale> {
        if self.moments < FIRST_MOMENTS {
            return None;
        }
        let mut information = self.information;
        for axis in 1..4 {
            information[(axis, axis)] += (SCATTER / IRON).powi(2);
        }
        let inverse = information.try_inverse()?;
        let found = inverse * self.seen;
        // The field about the iron found: large iron would hide how short the arc is.
        let about_iron = found / found[0];
        let alone = about_iron.dot(&(self.information * about_iron));
        let left = 1.0 / (inverse[(0, 0)] * alone);
        let residual = self.squares - found.dot(&self.seen);
        let scatter2 = (residual / (3.0 * self.moments - 4.0)).max(SCATTER.powi(2));
        // Over an arc a wrong D looks like a wrong scale, as iron does; over full turns, which leave all, it does not.
        let by_matrix2 = self.matrix2 * (1.0 / left - 1.0).max(0.0);
        let by_unknown = self.unknown_share / self.moments;
        let variance = scatter2 * inverse[(0, 0)] + by_matrix2 + by_unknown.powi(2);
        Some(FoundScale {
            scale: found[0],
            sd: variance.sqrt(),
            unexplained: residual / self.squares,
            moments: self.moments,
            left,
        })
    }

    /// How far the scale is from 1, if that is probably too far, though perhaps not certainly; else 0. A gyro that has not been shown to be
    /// right is suspected by less evidence: nothing else protects the first headings.
    pub(super) fn suspected(&self, was_right: bool) -> f64 {
        let Some(found) = self.regress() else {
            return 0.0;
        };
        let deviations = if found.is_enough() {
            1.0
        } else if !was_right && found.left > FIRST_LEFT {
            FIRST_DEVIATIONS
        } else {
            return 0.0;
        };
        let off = found.off();
        if off > TOLERANCE + deviations * found.sd {
            off
        } else {
            0.0
        }
    }

    /// Whether the scale is right, as far as the moments tell.
    pub(super) fn verdict(&self) -> GyroVerdict {
        let Some(found) = self.regress() else {
            return GyroVerdict::Unknown;
        };
        let (off, sd) = (found.off(), found.sd);
        let opposed = found.scale < -DEVIATIONS * sd;
        let fits = found.unexplained < FITS;
        if opposed && fits && found.moments > OPPOSED_MOMENTS && found.left > FIRST_LEFT {
            return GyroVerdict::Opposed;
        }
        if !found.is_enough() {
            return GyroVerdict::Unknown;
        }
        let wrong = off > TOLERANCE + DEVIATIONS * sd;
        let turns = self.squares > self.moments * LEAST_RAD.powi(2);
        let other_axes = wrong && turns && found.unexplained > UNEXPLAINED;
        if opposed || other_axes {
            GyroVerdict::Opposed
        } else if wrong && (fits || !turns) {
            GyroVerdict::Wrong
        } else if off < TOLERANCE && sd < TOLERANCE {
            GyroVerdict::Right
        } else {
            GyroVerdict::Unknown
        }
    }
}

impl TurnedMoment {
    fn begin(input: &Input, filter: &Filter) -> Option<Self> {
        let field = input.field_mgauss / FIELD_MGAUSS;
        let d = filter.matrix();
        Some(Self {
            age_s: 0.0,
            d,
            inverse: d.try_inverse()?,
            first: field,
            last: field,
            predicted: Vector3::zeros(),
            turned_rad: Vector3::zeros(),
            rate_rad_s: input.rate_rad_s,
        })
    }
}
