//! The answers that commands read: the daemon's status, and the calibrations kept.
//!
//! Each key may be missing, as an older daemon does not send it or it is not known.

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::calibration::model::Mode;
use crate::calibration::policy::{CalibrationOrigin, Policy};
use crate::frame::Mounting;

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub(crate) struct DaemonStatus {
    #[serde(skip_serializing)]
    pub(crate) message: String,
    pub(crate) cal_state: Option<String>,
    pub(crate) reason: Option<String>,
    pub(crate) heading: Option<f64>,
    pub(crate) mheading: Option<f64>,
    pub(crate) heading_sd: Option<f64>,
    #[serde(rename = "mode")]
    pub(crate) policy: Policy,
    pub(crate) armed: bool,
    pub(crate) calibrating: bool,
    pub(crate) progress: Option<f64>,
    pub(crate) calibration: Option<CalibrationSummary>,
    /// What the last calibration has come to, kept or not.
    pub(crate) last: Option<OutcomeSummary>,
    /// What corrects the field now: motion may have taught more than what is kept.
    pub(crate) active: Option<ActiveSummary>,
    /// The earth's field where the board is, if that is known.
    pub(crate) reference: Option<ReferenceSummary>,
    pub(crate) heading_socket: String,
    pub(crate) source: String,
    pub(crate) sensor: String,
    pub(crate) mag_axes: String,
    /// How the board is mounted, as configured or told.
    pub(crate) board_axes: Option<Mounting>,
    pub(crate) uptime_s: u64,
    pub(crate) clients: usize,
    pub(crate) counts: StatusCounts,
    pub(crate) store: FolderSummary,
    /// The recording.
    pub(crate) record: FolderSummary,
    pub(crate) version: String,
}

/// A calibration as `list`, `show` and `status` describe it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub(crate) struct CalibrationSummary {
    pub(crate) number: u64,
    pub(crate) in_force: bool,
    pub(crate) saved_unix_s: Option<u64>,
    pub(crate) time: Option<String>,
    pub(crate) age_s: Option<u64>,
    #[serde(rename = "reason")]
    pub(crate) origin: Option<CalibrationOrigin>,
    pub(crate) mode: Option<Mode>,
    pub(crate) method: Option<String>,
    pub(crate) residual_mgauss: Option<f64>,
    pub(crate) heading_sd_deg: Option<f64>,
    pub(crate) gyro_rms_deg: Option<f64>,
    pub(crate) samples: Option<usize>,
}

impl CalibrationSummary {
    /// Names what `heading_sd_deg` measures. A turn gives the deviation of its fit alone: the fit knows neither the place nor how the
    /// chips lie to each other.
    pub(crate) fn deviation_label(&self) -> &'static str {
        match self.method.as_deref() {
            Some("turn") => "fit",
            _ => "heading",
        }
    }
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub(crate) struct OutcomeSummary {
    pub(crate) verdict: String,
    pub(crate) reason: String,
    pub(crate) message: String,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub(crate) struct ActiveSummary {
    pub(crate) mode: Option<Mode>,
    pub(crate) strength_mgauss: f64,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub(crate) struct ReferenceSummary {
    pub(crate) strength_mgauss: f64,
    pub(crate) dip_deg: f64,
}

/// Since the daemon has begun.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub(crate) struct StatusCounts {
    pub(crate) readings: u64,
    pub(crate) headings: u64,
    pub(crate) turns: u64,
    pub(crate) calibrations_accepted: u64,
    pub(crate) calibrations_refused: u64,
    pub(crate) values_dropped: u64,
    pub(crate) faults: u64,
}

/// Whether something is kept, and where.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub(crate) struct FolderSummary {
    /// `good`, `off` or `failing`.
    pub(crate) state: String,
    pub(crate) directory: Option<String>,
    pub(crate) message: Option<String>,
}

impl FolderSummary {
    /// Nothing is kept.
    pub(crate) fn off() -> Self {
        Self {
            state: "off".to_owned(),
            ..Self::default()
        }
    }

    /// It is kept there, unless there is a fault.
    pub(crate) fn of(directory: &Path, fault: Option<String>) -> Self {
        let state = if fault.is_some() { "failing" } else { "good" };
        Self {
            state: state.to_owned(),
            directory: Some(directory.display().to_string()),
            message: fault,
        }
    }
}
