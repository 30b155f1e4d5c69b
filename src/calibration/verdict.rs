//! Whether a candidate deserves trust, always with a reason.

use nalgebra::Vector2;

use super::gyro_agreement::GyroAgreement;
use super::jump::Jump;
use super::model::{Calibration, Parameters};
use crate::check::settings;
use crate::reading::{EARTH_MGAUSS, LEAST_HORIZONTAL_MGAUSS};

settings! {
    /// What is asked of a candidate.
    pub struct Limits {
        /// Planar: how much of the circle the samples must cover, degrees. Below about 225° the
        /// parameters become several times less certain.
        coverage_deg: f64 = 240.0, 90.0..=360.0, "degrees";
        /// Spatial: smallest eigenvalue of the covariance of the field's directions. A level turn has almost none across its plane; 0.005
        /// is a swing of 4° RMS.
        direction_spread: f64 = 0.005, 0.0..=0.33, "";
        /// Largest share of samples that may be outliers.
        outlier_share: f64 = 0.1, 0.0..=0.5, "";
        /// Largest residual, as a share of the field's strength. Real boards leave 2 % under
        /// the diagonal model.
        residual_share: f64 = 0.06, 0.001..=0.5, "";
        /// Largest ratio of two axes' scale factors.
        axis_ratio: f64 = 2.0, 1.0..=10.0, "";
        /// Smallest scale factor where a reference field was given.
        scale_min: f64 = 0.2, 0.01..=1.0, "";
        /// Largest scale factor where a reference field was given.
        scale_max: f64 = 5.0, 1.0..=100.0, "";
        /// Largest predicted uncertainty of a heading, RMS over all headings, degrees. Real boards reach
        /// 0.6 to 0.8 under the diagonal model. In a turn the largest error is two to three times as much. At 1.5
        /// a turn that a passing car disturbed was accepted with an error of 4.4°.
        heading_sd_deg: f64 = 1.0, 0.01..=20.0, "degrees";
        /// Largest disagreement of corrected heading and gyro, RMS, degrees. A wobbling hand and a
        /// magnetometer that is 3° askew on its board make 7°.
        gyro_rms_deg: f64 = 10.0, 0.5..=45.0, "degrees";
        /// Largest difference between the angle turned by the field and by the gyro, as a share.
        gyro_angle_share: f64 = 0.12, 0.01..=0.5, "";
        /// Planar: largest jump of the corrected field in the gyro's frame, within a moment or a second, over the
        /// median of such changes. In 14,000 clean turns noise makes 4.8 at most in 999 of 1000, a real
        /// board's misfit 4.2. Every magnet that cost more than 1.2° of heading made 13 and more, in 2000 logs. With a
        /// passing car, a limit of 6 accepted none of 1000 logs of two turns, and nine of 1000 of one turn, six of
        /// them 2.3 to 4.4° off: a swell as long as a quarter of the turn looks like a real board's misfit.
        jump_planar: f64 = 6.0, 3.0..=1000.0, "";
        /// The same in space, where one turn is not like the other and a real board's misfit makes 8.4. Of 1000 logs
        /// with a car none was accepted at 10 with a heading error above 1.8°.
        jump_spatial: f64 = 10.0, 3.0..=1000.0, "";
        /// Spatial: largest change of the dip with attitude, RMS, degrees.
        dip_spread_deg: f64 = 6.0, 0.5..=45.0, "degrees";
    }
}

/// Why a candidate was refused.
#[derive(Clone, Debug, PartialEq)]
pub struct Refusal {
    /// A code that a program can read.
    pub reason: &'static str,
    /// A sentence for a person.
    pub message: String,
}

impl Refusal {
    /// A refusal with this code and sentence.
    pub fn new(reason: &'static str, message: impl Into<String>) -> Self {
        Self {
            reason,
            message: message.into(),
        }
    }
}

/// Everything that is judged.
#[derive(Clone, Debug, PartialEq)]
pub struct Measures {
    /// Planar: how much of the circle the samples cover, degrees.
    pub coverage_deg: Option<f64>,
    /// Spatial: smallest eigenvalue of the covariance of the field's directions.
    pub direction_spread: Option<f64>,
    /// Share of samples without weight.
    pub outlier_share: f64,
    /// The same of the last samples.
    pub end_outlier_share: f64,
    /// Residual over the field's strength as the sensor sees it.
    pub residual_share: f64,
    /// Scale factors.
    pub scale: Vec<f64>,
    /// Strength of the field, milligauss, horizontal if the samples are planar.
    pub strength_mgauss: f64,
    /// Whether scale factors and strength refer to a given field.
    pub reference_given: bool,
    /// Whether the centre lies within the samples on every axis.
    pub centre_inside: bool,
    /// Predicted uncertainty of a heading, degrees.
    pub heading_sd_deg: f64,
    /// Agreement with the gyro, cross-validated, where there is a gyro.
    pub gyro: Option<GyroAgreement>,
    /// The largest jump of the field, where there is a gyro.
    pub jump: Option<Jump>,
    /// How far the field at rest before the turn is from that of the turn, over its strength.
    pub rest_share: Option<f64>,
    /// Spatial: change of the dip with attitude, where the vertical is known.
    pub dip_spread_deg: Option<f64>,
}

/// With a larger share of outliers among the last samples, the fit does not hold for what comes: one spike in a
/// hundred samples never makes so many.
const MOST_AT_THE_END: f64 = 0.5;

/// A jump by a smaller share of the field is none, however still the field is otherwise.
const LEAST_JUMP_SHARE: f64 = 0.02;

/// Field and fit at rest may differ by this share, 11° of heading: up to 4° are the gyro's drift, 4° a turn's sway, and a little over 2°
/// the place's.
const MOST_AT_REST: f64 = 0.2;

/// What a measure must be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Bound {
    /// No more than this.
    AtMost(f64),
    /// No less than this.
    AtLeast(f64),
    /// True, which is measured as 1.
    True,
}

/// A measure, and what it must be.
#[derive(Clone, Debug, PartialEq)]
pub struct Limit {
    /// What is measured.
    pub name: &'static str,
    /// Its unit, if it has one.
    pub unit: &'static str,
    /// What it is.
    pub measured: f64,
    /// What it must be.
    pub bound: Bound,
}

impl Limit {
    /// Whether the measure is within its bound.
    pub fn is_kept(&self) -> bool {
        match self.bound {
            Bound::AtMost(most) => self.measured <= most,
            Bound::AtLeast(least) => self.measured >= least,
            Bound::True => self.measured > 0.0,
        }
    }

    /// Measure, relation and bound, as text.
    pub fn as_text(&self) -> [String; 3] {
        let (relation, bound) = match self.bound {
            Bound::AtMost(most) => ("at most", most),
            Bound::AtLeast(least) => ("at least", least),
            Bound::True => {
                let measured = if self.is_kept() { "yes" } else { "no" };
                return [measured, "must be", "yes"].map(str::to_owned);
            }
        };
        let digits = if bound < 0.1 { 4 } else { 2 };
        let number = |value: f64| {
            format!("{value:.digits$} {}", self.unit)
                .trim_end()
                .to_owned()
        };
        [number(self.measured), relation.to_owned(), number(bound)]
    }
}

/// A limit, with the code of a refusal and what a broken one means.
type Explained = (Limit, &'static str, &'static str);

/// Code, name, unit, measure if it is known, bound, and what a broken limit means.
#[rustfmt::skip]
type LimitRow = (&'static str, &'static str, &'static str, Option<f64>, Bound, &'static str);

/// The limits of the measures that are known.
#[rustfmt::skip]
fn known(rows: impl IntoIterator<Item = LimitRow>) -> impl Iterator<Item = Explained> {
    rows.into_iter().filter_map(|(reason, name, unit, measured, bound, why)| {
        Some((Limit { name, unit, measured: measured?, bound }, reason, why))
    })
}

/// All limits that apply, the most telling first.
#[rustfmt::skip]
fn all(m: &Measures, l: &Limits) -> impl Iterator<Item = Explained> {
    use Bound::{AtLeast, AtMost, True};
    const WRONG_STRENGTH: &str = "the earth's is 220 to 670 mG, and half to twice that is allowed: check the unit and the range of the magnetometer";
    let percent = |share: f64| 100.0 * share;
    let largest = m.scale.iter().copied().fold(f64::MIN, f64::max);
    let smallest = m.scale.iter().copied().fold(f64::MAX, f64::min);
    let given = |scale: f64| m.reference_given.then_some(scale);
    let strength = (!m.reference_given).then_some(m.strength_mgauss);
    let whole = strength.filter(|_| m.direction_spread.is_some());
    let in_plane = strength.filter(|_| m.direction_spread.is_none());
    let drift = m.gyro.map(|gyro| percent(gyro.drift_share));
    let rms_deg = m.gyro.map(|gyro| gyro.rms_deg);
    let jump = m.jump.filter(|jump| jump.share > LEAST_JUMP_SHARE).map(|jump| jump.times_usual);
    let most_jump = match m.coverage_deg {
        Some(_) => l.jump_planar,
        None => l.jump_spatial,
    };
    let rest = m.rest_share.map(percent);
    // A plane's diagonal model leaves a residual of 2 % on a real board. A larger one, and not too few samples, makes the fit uncertain.
    let uncertain = match m.coverage_deg {
        Some(_) if m.residual_share > 0.5 * l.residual_share =>
            "soft iron is strong, or the field was disturbed: turn the board about all three axes",
        _ => "more samples or a fuller turn are needed",
    };
    known([
        ("field_unit", "strength of the field", "mG", strength, AtMost(*EARTH_MGAUSS.end()),
         WRONG_STRENGTH),
        ("field_unit", "strength of the field", "mG", whole, AtLeast(*EARTH_MGAUSS.start()),
         WRONG_STRENGTH),
        ("field_unit", "strength of the field in the plane of the turn", "mG", in_plane, AtLeast(LEAST_HORIZONTAL_MGAUSS),
         "the earth's horizontal field is 60 to 420 mG where a compass works: check the unit and the range of the magnetometer"),
        ("coverage", "coverage of the circle", "degrees", m.coverage_deg, AtLeast(l.coverage_deg),
         "turn the board further round, or more slowly"),
        ("coverage", "spread of the field's directions", "", m.direction_spread, AtLeast(l.direction_spread),
         "the field hardly moved along one axis: turn the board about a second axis too"),
        ("outliers", "outliers", "%", Some(percent(m.outlier_share)), AtMost(percent(l.outlier_share)),
         "something magnetic came or went during the turn"),
        ("outliers", "outliers among the last samples", "%", Some(percent(m.end_outlier_share)), AtMost(percent(MOST_AT_THE_END)),
         "something magnetic came or went, and the fit no longer holds"),
        ("residual", "residual, of the field", "%", Some(percent(m.residual_share)), AtMost(percent(l.residual_share)),
         "the field was disturbed, the board moved through it, or soft iron is strong: turn the board about all three axes"),
        ("axis_ratio", "ratio of the axes' scale factors", "", Some(largest / smallest), AtMost(l.axis_ratio),
         "no magnetometer's axes differ so much"),
        ("scale", "smallest scale factor", "", given(smallest), AtLeast(l.scale_min),
         "check the reference field and the gain"),
        ("scale", "largest scale factor", "", given(largest), AtMost(l.scale_max),
         "check the reference field and the gain"),
        ("centre", "centre within the samples", "", Some(f64::from(m.centre_inside)), True,
         "the samples show too small a part of the curve"),
        ("jump", "largest jump of the field within a second, times the usual", "", jump, AtMost(most_jump),
         "something magnetic came or went, or the board tilted"),
        ("gyro_angle", "angle turned, field against gyro", "%", drift, AtMost(percent(l.gyro_angle_share)),
         "check the gyro's mounting, sign and scale"),
        ("heading_uncertainty", "predicted heading uncertainty", "degrees", Some(m.heading_sd_deg), AtMost(l.heading_sd_deg),
         uncertain),
        ("gyro", "heading against gyro, RMS", "degrees", rms_deg, AtMost(l.gyro_rms_deg),
         "the corrected heading does not follow the gyro"),
        ("rest", "field at rest before the turn against the fit", "%", rest, AtMost(percent(MOST_AT_REST)),
         "something magnetic came with the turn, such as a running motor"),
        ("dip", "change of dip with attitude, RMS", "degrees", m.dip_spread_deg, AtMost(l.dip_spread_deg),
         "check the mountings, or keep iron away"),
    ])
}

/// All limits that apply to a candidate, the most telling first.
pub fn measured(m: &Measures, limits: &Limits) -> Vec<Limit> {
    all(m, limits).map(|(limit, ..)| limit).collect()
}

/// The first objection to a candidate, the most telling first; `Ok` if there is none.
///
/// # Errors
///
/// The first objection.
pub fn judge(m: &Measures, limits: &Limits) -> Result<(), Refusal> {
    first_objection(all(m, limits))
}

/// The first objection to an imported calibration. Its samples are not known, so only its own numbers are held against the limits.
///
/// # Errors
///
/// The first objection.
#[rustfmt::skip]
pub fn judge_imported(calibration: &Calibration, l: &Limits) -> Result<(), Refusal> {
    use Bound::AtMost;
    let scale = match &calibration.parameters {
        Parameters::Planar(planar) => planar.scale,
        Parameters::Spatial(spatial) => {
            let values = spatial.matrix.singular_values();
            Vector2::new(values.min(), values.max())
        }
    };
    let ratio = scale.max() / scale.min();
    let share = calibration.residual_mgauss / (calibration.strength_mgauss * 0.5 * scale.sum());
    // A covariance states how far to trust it, and the estimate starts from it.
    let sd_deg = calibration.covariance.is_none().then_some(calibration.heading_sd_deg);
    first_objection(known([
        ("axis_ratio", "ratio of the axes' scale factors", "", Some(ratio), AtMost(l.axis_ratio),
         "is it of another chip?"),
        ("residual", "residual, of the field", "%", Some(100.0 * share), AtMost(100.0 * l.residual_share),
         "its samples were spread about its fit"),
        ("heading_uncertainty", "predicted heading uncertainty", "degrees", sd_deg, AtMost(l.heading_sd_deg),
         "its headings are not certain enough"),
    ]))
}

fn first_objection(mut limits: impl Iterator<Item = Explained>) -> Result<(), Refusal> {
    let Some((limit, reason, why)) = limits.find(|(limit, ..)| !limit.is_kept()) else {
        return Ok(());
    };
    let [measured, relation, bound] = limit.as_text();
    let message = format!("{}: {measured} ({relation} {bound}): {why}", limit.name);
    Err(Refusal::new(reason, message))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn good() -> Measures {
        Measures {
            coverage_deg: Some(355.0),
            direction_spread: Some(0.1),
            outlier_share: 0.0,
            end_outlier_share: 0.0,
            residual_share: 0.012,
            scale: vec![0.9, 1.1],
            strength_mgauss: 500.0,
            reference_given: true,
            centre_inside: true,
            heading_sd_deg: 0.05,
            gyro: Some(GyroAgreement {
                rms_deg: 1.0,
                drift_share: 0.01,
            }),
            jump: Some(Jump {
                share: 0.1,
                times_usual: 2.0,
            }),
            rest_share: Some(0.05),
            dip_spread_deg: Some(1.0),
        }
    }

    #[test]
    fn a_good_candidate_passes() {
        assert_eq!(judge(&good(), &Limits::default()), Ok(()));
    }

    #[test]
    fn every_refusal_has_its_code_and_a_sentence() {
        type SpoilMeasures = fn(&mut Measures);
        let cases: [(&str, SpoilMeasures); 14] = [
            ("coverage", |m| m.coverage_deg = Some(239.0)),
            ("coverage", |m| m.direction_spread = Some(0.0)),
            ("outliers", |m| m.outlier_share = 0.3),
            ("outliers", |m| m.end_outlier_share = 0.6),
            ("jump", |m| m.jump.as_mut().unwrap().times_usual = 13.0),
            ("residual", |m| m.residual_share = 0.07),
            ("axis_ratio", |m| m.scale = vec![0.4, 0.9]),
            ("scale", |m| m.scale = vec![6.0, 6.0]),
            ("centre", |m| m.centre_inside = false),
            ("heading_uncertainty", |m| m.heading_sd_deg = 1.1),
            ("gyro_angle", |m| m.gyro.as_mut().unwrap().drift_share = 0.5),
            ("gyro", |m| m.gyro.as_mut().unwrap().rms_deg = 11.0),
            ("rest", |m| m.rest_share = Some(0.3)),
            ("dip", |m| m.dip_spread_deg = Some(7.0)),
        ];
        for (reason, spoil) in cases {
            let mut measures = good();
            spoil(&mut measures);
            let refusal = judge(&measures, &Limits::default()).unwrap_err();
            assert_eq!(refusal.reason, reason);
            assert!(refusal.message.len() > 40, "{}", refusal.message);
        }
    }

    #[test]
    fn what_is_told_first_is_what_helps() {
        // A gyro of the wrong sign levels the samples wrongly, which makes the fit uncertain.
        let mut measures = good();
        measures.heading_sd_deg = 1.1;
        measures.gyro = Some(GyroAgreement {
            rms_deg: 11.0,
            drift_share: 2.0,
        });
        let judged = |measures: &Measures| judge(measures, &Limits::default()).unwrap_err();
        assert_eq!(judged(&measures).reason, "gyro_angle");
        measures.gyro = None;
        assert!(judged(&measures).message.contains("more samples"));
        measures.residual_share = 0.04;
        assert!(judged(&measures).message.contains("soft iron"));
    }

    #[test]
    fn without_a_reference_only_the_ratio_of_scales_counts() {
        let measures = Measures {
            scale: vec![6.0, 6.0],
            reference_given: false,
            ..good()
        };
        assert_eq!(judge(&measures, &Limits::default()), Ok(()));
    }
}
