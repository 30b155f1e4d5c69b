//! The one state of the daemon, and the reason for it: the word that the socket, the log and systemd show.
//!
//! [`judge`] has no memory: it returns the first condition, the worst first, that the evidence shows. So a faulty source or a
//! silent magnetometer leads from any state to `fault` or `stale`, and its end to what the evidence shows then.
//! What leads from one state to another (`tests/domain/condition` plays each row through the pipeline):
//!
//! | from | what happens | to | reason |
//! |---|---|---|---|
//! | (start) | readings come, and no calibration is kept | uncalibrated | `no_calibration` |
//! | (start) | readings come, and one is kept | degraded | `learning` |
//! | (start) | readings come, but none of the magnetometer | stale | `no_samples` |
//! | (start) | readings come, but none of the gyro | uncalibrated | `no_gyro` |
//! | (start) | readings come, but none of the accelerometer | uncalibrated | `no_accelerometer` |
//! | uncalibrated | a tenth of a turn | turning | `turning` |
//! | turning | `turn.time_limit_s` passes | uncalibrated | `no_calibration` |
//! | turning | the heading is worth something | degraded | `learning` |
//! | turning | a full turn before that | calibrating | `calibrating` |
//! | turning | mode off | uncalibrated | `mode_off` |
//! | calibrating | the candidate is accepted | degraded | `learning` |
//! | calibrating | the candidate is rejected | uncalibrated | the refusal's |
//! | uncalibrated | rollback or import | degraded | `learning` |
//! | uncalibrated | the gyro's range was misread | uncalibrated | `gyro_scale` |
//! | degraded | the board is moved about | good | `good` |
//! | good | forget | uncalibrated | `no_calibration` |
//! | good | the field is too weak or too strong | disturbed | `field_strength` |
//! | good | the field has another direction | disturbed | `field_changed` |
//! | disturbed | the field is as before | good | `good` |
//! | good | iron comes onto the moving board | disturbed | `field_changed` |
//! | disturbed | the board moves on with it | good | `good` |
//! | good | the accelerometer falls silent | degraded | `no_accelerometer` |
//! | good | the gyro falls silent | degraded | `no_gyro` |
//! | good | the gyro reads a constant in a turn | degraded | `gyro_dead` |
//! | good | the gyro has another sign | degraded | `gyro_sign` |
//! | good | the gyro has another scale | degraded | `gyro_scale` |
//! | good | the board turns faster than the gyro can tell | degraded | `gyro_clipped` |
//! | uncalibrated | the magnetometer's unit is wrong | fault | `field_unit` |
//! | good | the magnetometer falls silent | stale | `no_samples` |
//! | good | an axis overflows | stale | `overflow` |
//! | good | an axis reads the same number while the board turns | stale | `overflow` |
//! | stale | readings resume | good | `good` |
//! | good | the source is in trouble | fault | the trouble's |
//! | fault | the trouble is over | good | `good` |

use std::borrow::Cow;

use serde::Serialize;

use crate::check::words;

words! {
    /// What the daemon can say about its headings right now.
    #[derive(Default)]
    pub enum Condition {
        /// No calibration yet: no heading.
        #[default]
        Uncalibrated = "uncalibrated",
        /// Uncalibrated, and the board is on its way round.
        Turning = "turning",
        /// Uncalibrated, and a calibration is being computed.
        Calibrating = "calibrating",
        /// Calibrated, and the field is as the calibration expects it.
        Good = "good",
        /// Calibrated, but something has made the headings less certain.
        Degraded = "degraded",
        /// Calibrated, but something magnetic is near: the field is too strong, too weak or too steep.
        Disturbed = "disturbed",
        /// The magnetometer has been silent for too long: no heading.
        Stale = "stale",
        /// The source is broken or gone: no heading.
        Fault = "fault",
    }
}

impl Condition {
    /// Whether a heading may be published at all.
    pub fn may_steer(self) -> bool {
        matches!(self, Self::Good | Self::Degraded | Self::Disturbed)
    }
}

/// A condition with its reason, as published in class `STATE`.
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// The condition.
    pub condition: Condition,
    /// Why, as a code that a program can read (`no_calibration`, `turning`, `field_strength` …).
    pub reason: &'static str,
    /// Why, as a sentence for a person. It is judged at every reading, and most sentences are fixed.
    pub message: Cow<'static, str>,
    /// How much of a full turn has been made, or of a heading has been learnt, 0 to 1.
    pub progress: Option<f64>,
    /// The source's clock, seconds.
    pub t_s: f64,
}

/// What is wrong with the source.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct SourceFault {
    /// As a code that a program can read (`no_answer`, `unplugged` …).
    pub code: &'static str,
    /// As a sentence for a person: what was attempted, on which device, what was found, what helps.
    pub message: String,
}

/// What the condition depends on.
#[derive(Clone, Debug, PartialEq)]
pub struct Evidence<'a> {
    /// The source's clock, seconds.
    pub t_s: f64,
    /// What is wrong with the source, if it is known to be.
    pub fault: Option<&'a SourceFault>,
    /// Seconds since the last whole magnetometer sample; infinite if there was none.
    pub silent_s: f64,
    /// Whether what came in the meantime had an axis beyond its range.
    pub overflowing: bool,
    /// Samples older than this are stale, seconds.
    pub stale_s: f64,
    /// Whether there is a calibration.
    pub calibrated: bool,
    /// Whether one is being computed.
    pub calibrating: bool,
    /// Whether a turn would be calibrated on.
    pub wanted: bool,
    /// How much of a turn has been completed, 0 to 1.
    pub turned: f64,
    /// How much has been learnt on the way to a heading, 0 to 1.
    pub learnt: f64,
    /// The motion that would teach most.
    pub motion_wanted: &'static str,
    /// Why the last candidate was refused, if nothing was accepted since.
    pub refused: Option<(&'static str, &'a str)>,
    /// Deviation of the heading, degrees.
    pub heading_sd_deg: f64,
    /// Below this it is good, degrees.
    pub good_sd_deg: f64,
    /// Strength of the field over what is expected, less 1, smoothed.
    pub strength_deviation: f64,
    /// Strength of the field, milligauss, where the earth's is nowhere like that.
    pub impossible_mgauss: Option<f64>,
    /// The field is not the earth's.
    pub disturbed: bool,
    /// Whether the board's tilt is known.
    pub tilt_known: bool,
    /// Whether there is gyro data.
    pub gyro_live: bool,
    /// What is wrong with it, as a code.
    pub gyro_fault: Option<&'static str>,
}

/// A field that is stronger or weaker by more is disturbed for that reason; others have changed their direction.
pub const STRENGTH_TOLERANCE: f64 = 0.15;

/// A rotation this far along is called a turn.
const TURNING_FROM: f64 = 0.1;

/// The condition that the evidence asks for; the first that applies, worst first.
pub fn judge(evidence: &Evidence) -> Report {
    let e = evidence;
    if let Some(fault) = e.fault {
        return e.report(Condition::Fault, fault.code, fault.message.clone());
    }
    if e.silent_s > e.stale_s {
        return if e.overflowing {
            let message = "the field is beyond the magnetometer's range, or an axis is stuck: choose a larger range, or move away from the magnet";
            e.report(Condition::Stale, "overflow", message)
        } else {
            let message = "no magnetometer sample is recent enough to publish a heading from";
            e.report(Condition::Stale, "no_samples", message)
        };
    }
    if let Some(strength) = e.impossible_mgauss {
        return e.report(Condition::Fault, "field_unit", wrong_strength(strength));
    }
    if !e.calibrated {
        return if e.calibrating {
            e.report(
                Condition::Calibrating,
                "calibrating",
                "calibrating on the motion just made",
            )
        } else if let Some(reason) = e.gyro_fault {
            e.report(Condition::Uncalibrated, reason, gyro_fault(reason))
        } else if !e.wanted {
            let message = "told not to calibrate by itself: headingd calibration start, and then turn the board";
            e.report(Condition::Uncalibrated, "mode_off", message)
        } else if e.turned >= TURNING_FROM {
            e.report(
                Condition::Turning,
                "turning",
                "keep turning the board the same way round",
            )
        } else if let Some((reason, message)) = e.refused {
            e.report(
                Condition::Uncalibrated,
                reason,
                format!("the last attempt gave no calibration: {message}"),
            )
        } else if !e.gyro_live {
            let message = "no gyro data, so turns cannot be detected: connect the gyro or import a calibration";
            e.report(Condition::Uncalibrated, "no_gyro", message)
        } else if !e.tilt_known {
            let message = "no accelerometer data, so headings hold for a board that stays level: keep it level, and turn it once all the way round";
            e.report(Condition::Uncalibrated, "no_accelerometer", message)
        } else {
            let message = "turn the board once all the way round, or move it about, away from iron";
            e.report(Condition::Uncalibrated, "no_calibration", message)
        };
    }
    if let Some(reason) = e.gyro_fault {
        return e.report(Condition::Degraded, reason, gyro_fault(reason));
    }
    if e.disturbed {
        if e.strength_deviation.abs() > STRENGTH_TOLERANCE {
            let percent = 100.0 * (1.0 + e.strength_deviation);
            // In steps, or every sample would be news.
            let message = format!(
                "the field has {:.0} % of the strength it should have",
                (percent / 10.0).round() * 10.0
            );
            return e.report(Condition::Disturbed, "field_strength", message);
        }
        let message = "the field is not what the motion predicts: something magnetic is near";
        return e.report(Condition::Disturbed, "field_changed", message);
    }
    if !e.tilt_known {
        let message = "no accelerometer data: headings hold for a board that is level";
        return e.report(Condition::Degraded, "no_accelerometer", message);
    }
    if !e.gyro_live {
        let message = "no gyro data: headings are those of single samples";
        return e.report(Condition::Degraded, "no_gyro", message);
    }
    // NaN is not certain.
    let certain = e.heading_sd_deg <= e.good_sd_deg;
    if !certain {
        let message = format!(
            "the heading is still uncertain: move the board about, and {}",
            e.motion_wanted
        );
        return e.report(Condition::Degraded, "learning", message);
    }
    e.report(
        Condition::Good,
        "good",
        "the field is as the estimate expects it",
    )
}

/// What a person should know of a field that is nowhere so strong, milligauss.
pub fn wrong_strength(strength_mgauss: f64) -> String {
    format!(
        "the field is {strength_mgauss:.0} mG strong, and the earth's is 220 to 670: check the magnetometer's unit and range"
    )
}

/// What a person should know of a gyro that is at fault.
fn gyro_fault(reason: &str) -> &'static str {
    match reason {
        "gyro_clipped" => "the board turns faster than the gyro can measure: turn it more slowly",
        "gyro_dead" => "the field turns and the gyro reads a constant: check its wiring",
        "gyro_sign" => {
            "gyro and field turn different ways: check the gyro's axes and signs in [mounting]"
        }
        _ => {
            "gyro and field differ by more than 5 % in how far the board turns: check the gyro's range"
        }
    }
}

impl Evidence<'_> {
    fn report(
        &self,
        condition: Condition,
        reason: &'static str,
        message: impl Into<Cow<'static, str>>,
    ) -> Report {
        Report {
            condition,
            reason,
            message: message.into(),
            progress: match condition {
                Condition::Turning => Some(self.turned),
                Condition::Uncalibrated => Some(self.learnt),
                Condition::Degraded if reason == "learning" => {
                    Some((self.good_sd_deg / self.heading_sd_deg).clamp(0.0, 1.0))
                }
                _ => None,
            },
            t_s: self.t_s,
        }
    }
}
