//! The one state of the daemon, and the reason for it: the word that the socket, the log and systemd show.

use serde::Serialize;

/// What the daemon can say about its headings right now.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Condition {
    /// No calibration yet: no heading.
    Uncalibrated,
    /// Uncalibrated, and the board is on its way round.
    Turning,
    /// Uncalibrated, and a calibration is being computed.
    Calibrating,
    /// Calibrated, and the field is as the calibration expects it.
    Good,
    /// Calibrated, but something has made the headings less certain.
    Degraded,
    /// Calibrated, but something magnetic is near: the field is too strong, too weak or too steep.
    Disturbed,
    /// The magnetometer has been silent for too long: no heading.
    Stale,
    /// The source is broken or gone: no heading.
    Fault,
}

impl Condition {
    /// The word as published.
    pub fn word(self) -> &'static str {
        match self {
            Self::Uncalibrated => "uncalibrated",
            Self::Turning => "turning",
            Self::Calibrating => "calibrating",
            Self::Good => "good",
            Self::Degraded => "degraded",
            Self::Disturbed => "disturbed",
            Self::Stale => "stale",
            Self::Fault => "fault",
        }
    }

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
    /// Why, as a sentence for a person.
    pub message: String,
    /// How much of a full turn has been made, 0 to 1; known while turning.
    pub progress: Option<f64>,
    /// The source's clock, seconds.
    pub t_s: f64,
}
