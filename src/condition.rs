//! The one state of the daemon, and the reason for it: the word that the socket, the log and systemd show.
//!
//! `pipeline/judge.rs` judges it without memory: the first condition that applies, worst first. So a faulty source or a silent
//! magnetometer leads from any state to `fault` or `stale`, and its end to whatever applies then.
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
//! | good | the nose points straight up | degraded | `nose_vertical` |
//! | good | the accelerometer falls silent | degraded | `no_accelerometer` |
//! | good | the gyro falls silent | degraded | `no_gyro` |
//! | good | the gyro reads a constant in a turn | degraded | `gyro_dead` |
//! | (start) | an axis of the gyro reads a constant | uncalibrated | `gyro_dead` |
//! | (start) | an axis of the accelerometer reads a constant | uncalibrated | `accel_dead` |
//! | good | the gyro has another sign | degraded | `gyro_sign` |
//! | (start) | the magnetometer's axes are exchanged | uncalibrated | `mag_axes` |
//! | (start) | the accelerometer's axes are exchanged | uncalibrated | `accel_axes` |
//! | good | the accelerometer reads another unit | degraded | `accel_unit` |
//! | good | the gyro has another scale | degraded | `gyro_scale` |
//! | good | the board turns faster than the gyro can tell | degraded | `gyro_clipped` |
//! | good | up and down are exchanged, by the position | degraded | `reversed_field` |
//! | uncalibrated | the magnetometer's unit is wrong | fault | `field_unit` |
//! | good | the magnetometer falls silent | stale | `no_samples` |
//! | good | an axis overflows | stale | `overflow` |
//! | good | an axis reads the same number while the board turns | stale | `overflow` |
//! | stale | readings resume | good | `good` |
//! | good | the source fails | fault | the fault's code |
//! | fault | the fault ends | good | `good` |

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
        /// Calibrated, but something magnetic is near: the field differs from the expected one in strength or direction.
        Disturbed = "disturbed",
        /// No usable sample of the magnetometer for too long, since it is silent or beyond its range: no heading.
        Stale = "stale",
        /// The source is broken or gone, a sensor repeats its value, or the field's unit is wrong: no heading.
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
