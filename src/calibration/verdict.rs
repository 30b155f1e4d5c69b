//! Whether a candidate deserves trust, always with a reason.

use super::gyro_agreement::GyroAgreement;
use super::jump::Jump;

pub mod imported;
mod limits;

pub use limits::Limits;

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
    /// Whether they refer to a given field.
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

/// More outliers than this among the last samples, and the fit does not hold for what comes: one spike in a
/// hundred samples never makes so many.
const MOST_AT_THE_END: f64 = 0.5;

/// A jump by a smaller share of the field is none, however still the field is otherwise.
const LEAST_JUMP_SHARE: f64 = 0.02;

/// Field and fit at rest may differ by this share, 11° of heading: by up to 4° the gyro has drifted, 4° are a swaying turn's, 2° and a
/// little more the place's.
pub const MOST_AT_REST: f64 = 0.2;

/// The first objection to a candidate, the most telling first; `Ok` if there is none.
///
/// # Errors
///
/// The first objection.
pub fn judge(m: &Measures, limits: &Limits) -> Result<(), Refusal> {
    let refuse = |reason, message: String| Err(Refusal::new(reason, message));
    let percent = |share: f64| 100.0 * share;
    if let Some(coverage) = m.coverage_deg.filter(|&c| c < limits.coverage_deg) {
        let least = limits.coverage_deg;
        let message = format!(
            "the field was seen from {coverage:.0} of 360 degrees; at least {least:.0} are needed: turn the board further round"
        );
        return refuse("coverage", message);
    }
    if let Some(spread) = m.direction_spread.filter(|&s| s < limits.direction_spread) {
        let least = limits.direction_spread;
        let message = format!(
            "the field hardly moved along one axis (spread {spread:.4}, at least {least:.4} is needed): turn the board about a second axis too"
        );
        return refuse("coverage", message);
    }
    if m.outlier_share > limits.outlier_share {
        let [found, most] = [m.outlier_share, limits.outlier_share].map(percent);
        let message = format!(
            "{found:.0} % of the samples lie far off the fit (at most {most:.0} % may): something magnetic came or went during the turn"
        );
        return refuse("outliers", message);
    }
    if m.end_outlier_share > MOST_AT_THE_END {
        let message = "the last samples lie far off the fit: something magnetic came or went, and the fit no longer holds";
        return refuse("outliers", message.to_owned());
    }
    if m.residual_share > limits.residual_share {
        let [found, most] = [m.residual_share, limits.residual_share].map(percent);
        let message = format!(
            "the samples scatter by {found:.1} % of the field about the fit (at most {most:.1} % may): the field was disturbed, or the board moved through it"
        );
        return refuse("residual", message);
    }
    let largest = m.scale.iter().copied().fold(f64::MIN, f64::max);
    let smallest = m.scale.iter().copied().fold(f64::MAX, f64::min);
    if largest > limits.axis_ratio * smallest {
        let (found, most) = (largest / smallest, limits.axis_ratio);
        let message = format!(
            "one axis would be {found:.2} times as sensitive as another (at most {most:.2}): no magnetometer is"
        );
        return refuse("axis_ratio", message);
    }
    if m.reference_given && (smallest < limits.scale_min || largest > limits.scale_max) {
        let (least, most) = (limits.scale_min, limits.scale_max);
        let message = format!(
            "scale factors of {smallest:.2} to {largest:.2} are outside {least:.2} to {most:.2}: check the reference field and the gain"
        );
        return refuse("scale", message);
    }
    if !m.centre_inside {
        let message =
            "the fitted centre lies outside the samples: they show too small a part of the curve";
        return refuse("centre", message.to_owned());
    }
    if m.heading_sd_deg > limits.heading_sd_deg {
        let (found, most) = (m.heading_sd_deg, limits.heading_sd_deg);
        let message = format!(
            "headings would be uncertain by {found:.2} degrees (at most {most:.2}): more samples or a fuller turn are needed"
        );
        return refuse("heading_uncertainty", message);
    }
    if let Some(gyro) = m.gyro {
        if gyro.drift_share > limits.gyro_angle_share {
            let [found, most] = [gyro.drift_share, limits.gyro_angle_share].map(percent);
            let message = format!(
                "field and gyro differ by {found:.0} % of the angle turned (at most {most:.0} %): check the gyro's mounting, sign and scale"
            );
            return refuse("gyro_angle", message);
        }
        if gyro.rms_deg > limits.gyro_rms_deg {
            let (found, most) = (gyro.rms_deg, limits.gyro_rms_deg);
            let message = format!(
                "the corrected heading strays from the gyro by {found:.1} degrees RMS (at most {most:.1}): the fit does not turn as the board did"
            );
            return refuse("gyro", message);
        }
    }
    let most = limits.largest_jump(m);
    if let Some(jump) = m.jump
        && jump.share > LEAST_JUMP_SHARE
        && jump.times_usual > most
    {
        let (found, times) = (percent(jump.share), jump.times_usual);
        let message = format!(
            "the field jumped by {found:.0} % within a second, {times:.1} times what is usual in this turn (at most {most:.1}): something magnetic came or went, or the board tilted"
        );
        return refuse("jump", message);
    }
    if let Some(share) = m.rest_share.filter(|&share| share > MOST_AT_REST) {
        let [found, most] = [share, MOST_AT_REST].map(percent);
        let message = format!(
            "at rest before the turn the field was {found:.0} % off what the fit makes of it (at most {most:.0} % may): something magnetic came with the turn, as of a motor that runs"
        );
        return refuse("rest", message);
    }
    if let Some(spread) = m.dip_spread_deg.filter(|&s| s > limits.dip_spread_deg) {
        let most = limits.dip_spread_deg;
        let message = format!(
            "the corrected field's dip changes by {spread:.1} degrees RMS with attitude (at most {most:.1}): check the mountings, or keep iron away"
        );
        return refuse("dip", message);
    }
    Ok(())
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
            ("jump", |m| {
                m.jump = Some(Jump {
                    share: 0.1,
                    times_usual: 13.0,
                })
            }),
            ("residual", |m| m.residual_share = 0.07),
            ("axis_ratio", |m| m.scale = vec![0.4, 0.9]),
            ("scale", |m| m.scale = vec![6.0, 6.0]),
            ("centre", |m| m.centre_inside = false),
            ("heading_uncertainty", |m| m.heading_sd_deg = 1.1),
            ("gyro_angle", |m| {
                m.gyro = Some(GyroAgreement {
                    rms_deg: 1.0,
                    drift_share: 0.5,
                })
            }),
            ("gyro", |m| {
                m.gyro = Some(GyroAgreement {
                    rms_deg: 11.0,
                    drift_share: 0.0,
                })
            }),
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
    fn without_a_reference_only_the_ratio_of_scales_counts() {
        let measures = Measures {
            scale: vec![6.0, 6.0],
            reference_given: false,
            ..good()
        };
        assert_eq!(judge(&measures, &Limits::default()), Ok(()));
    }
}
