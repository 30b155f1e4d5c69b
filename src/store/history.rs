//! What is kept for one sensor: its calibrations in the order in which they were saved, which is active, and how the board
//! is mounted. Pure.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::calibration::model::Calibration;
use crate::calibration::outcome::Outcome;
use crate::calibration::policy::{CalibrationOrigin, Policy};
use crate::frame::Mounting;

/// The largest number that a file may hold: far above what any daemon saves in its life, and far enough below the
/// largest `u64`, and the largest integer that every JSON program reads exactly, for numbers to go on after it.
const LARGEST_NUMBER: u64 = 1_000_000_000_000;

/// Two mountings that differ by less, in any of the nine numbers, are the same: libraries differ in the last digit of a sine.
const SAME: f64 = 1e-9;

/// Which sensor a calibration holds for, and how it is mounted.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Identity {
    /// The sensor's name, such as `hmc5843`.
    pub sensor: String,
    /// The magnetometer's mounting.
    pub mag_axes: Mounting,
}

impl Identity {
    /// The sensor with this name, mounted like this.
    pub fn new(sensor: &str, mag_axes: Mounting) -> Self {
        Self {
            sensor: sensor.to_owned(),
            mag_axes,
        }
    }
}

impl fmt::Display for Identity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} mounted {}", self.sensor, self.mag_axes)
    }
}

/// How the board is mounted, and what the configuration said of that at the time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct BoardMounting {
    /// Board axes along body X, Y, Z.
    pub board_axes: Mounting,
    /// The configured mounting that it replaced when it was told.
    pub configured: Mounting,
}

impl BoardMounting {
    /// Whether it still holds: a configuration that differs from the one it replaced was changed later, and takes precedence.
    pub fn holds(&self, configured: &Mounting) -> bool {
        let difference = self.configured.rotation() - configured.rotation();
        difference.amax() < SAME
    }

    /// What is wrong with it.
    pub(super) fn fault(&self) -> Option<String> {
        let mirrored = self.board_axes.is_mirrored();
        mirrored.then(|| "mounting.board_axes is mirrored, but must be a rotation".to_owned())
    }
}

/// A calibration with where it came from and how good it was found to be.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CalibrationRecord {
    /// When it was made, seconds since 1970-01-01 UTC; left out if the clock was not set.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub saved_unix_s: Option<u64>,
    /// Why it was made, or how it came here; version 1 does not say.
    #[serde(rename = "reason", default, skip_serializing_if = "Option::is_none")]
    pub origin: Option<CalibrationOrigin>,
    /// Heading against the gyro, RMS, degrees, if there was a gyro.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gyro_rms_deg: Option<f64>,
    /// How many samples it was fitted to.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub samples: Option<usize>,
    /// The calibration.
    pub calibration: Calibration,
}

impl CalibrationRecord {
    /// A calibration from its outcome.
    pub fn of(
        outcome: &Outcome,
        calibration: Calibration,
        origin: CalibrationOrigin,
        saved_unix_s: Option<u64>,
    ) -> Self {
        Self {
            saved_unix_s,
            origin: Some(origin),
            gyro_rms_deg: outcome.gyro_rms_deg,
            samples: Some(outcome.samples.used).filter(|&used| used > 0),
            calibration,
        }
    }
}

/// One calibration of a history.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct KeptCalibration {
    /// Counts what was saved for this sensor, from 1: this is the order, whatever the clock was.
    pub number: u64,
    /// The calibration.
    #[serde(flatten)]
    pub record: CalibrationRecord,
}

/// Everything that is kept for one sensor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct History {
    /// The sensor.
    #[serde(flatten)]
    pub identity: Identity,
    /// Whether the daemon calibrates it by itself.
    #[serde(rename = "mode", default)]
    pub policy: Policy,
    /// How the board is mounted, if the daemon was told that while it ran.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mounting: Option<Box<BoardMounting>>,
    /// The number of the active calibration, if there is one.
    #[serde(rename = "in_force", default, skip_serializing_if = "Option::is_none")]
    pub active: Option<u64>,
    /// The number given last; no number is given twice. Saving fails beyond `LARGEST_NUMBER`.
    pub last_number: u64,
    /// The calibrations, in the order of their numbers.
    #[serde(rename = "history")]
    pub entries: Vec<KeptCalibration>,
}

/// Why something could not be done with a history.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum HistoryError {
    /// There is no calibration with this number.
    #[error("there is no calibration {0}: headingd calibration list shows which there are")]
    NoSuchNumber(u64),
    /// Nothing was kept before the active calibration.
    #[error(
        "there is no earlier calibration to go back to: headingd calibration list shows which there are"
    )]
    NothingBefore,
    /// No calibration is active, with this policy; whether there are others to go back to.
    #[error("no calibration is active: {}{}", .0.remedy(), if *.1 { ", or headingd calibration rollback" } else { "" })]
    NoneActive(Policy, bool),
    /// The active one is locked.
    #[error("the active calibration is locked: headingd calibration unlock lets it go")]
    Locked,
}

impl HistoryError {
    /// A code for programs.
    pub fn code(self) -> &'static str {
        match self {
            Self::NoSuchNumber(_) => "no_such_number",
            Self::NothingBefore => "nothing_before",
            Self::NoneActive(..) => "no_calibration",
            Self::Locked => "locked",
        }
    }
}

impl History {
    /// Of a sensor for which nothing was kept yet.
    pub fn new(identity: Identity) -> Self {
        Self {
            identity,
            policy: Policy::default(),
            mounting: None,
            active: None,
            last_number: 0,
            entries: Vec::new(),
        }
    }

    /// With one calibration, which is active.
    pub fn of(identity: Identity, record: CalibrationRecord) -> Self {
        let mut history = Self::new(identity);
        history.keep(record, 1);
        history
    }

    /// How the board is mounted: as the daemon was told, unless the configuration has changed since.
    pub fn board(&self, configured: &Mounting) -> Mounting {
        match &self.mounting {
            Some(told) if told.holds(configured) => told.board_axes,
            _ => *configured,
        }
    }

    /// The active calibration.
    pub fn active(&self) -> Option<&KeptCalibration> {
        self.entry(self.active?)
    }

    /// The calibration with this number.
    fn entry(&self, number: u64) -> Option<&KeptCalibration> {
        self.entries.iter().find(|entry| entry.number == number)
    }

    /// The calibration with this number, or the active one.
    ///
    /// # Errors
    ///
    /// When there is no such calibration.
    pub fn find(&self, number: Option<u64>) -> Result<&KeptCalibration, HistoryError> {
        match number {
            Some(number) => self.entry(number).ok_or(HistoryError::NoSuchNumber(number)),
            None => self.active().ok_or_else(|| self.none_active()),
        }
    }

    /// The number of this calibration, if it is kept already: of copies that of the active one, else of the newest.
    pub fn number_of(&self, record: &CalibrationRecord) -> Option<u64> {
        let same = |kept: &&KeptCalibration| {
            kept.record.calibration == record.calibration
                && kept.record.saved_unix_s == record.saved_unix_s
        };
        let mut active_first = self.active().into_iter().chain(self.entries.iter().rev());
        Some(active_first.find(same)?.number)
    }

    /// Whether the active calibration must not be replaced.
    pub fn is_locked(&self) -> bool {
        self.policy == Policy::Locked && self.active.is_some()
    }

    /// Makes a calibration the active one, and drops the oldest ones beyond `most`, but not the one that was active, unless `most` is 1:
    /// somebody may have gone back to it.
    pub fn keep(&mut self, record: CalibrationRecord, most: usize) {
        let before = self.active;
        self.last_number += 1;
        self.active = Some(self.last_number);
        self.entries.push(KeptCalibration {
            number: self.last_number,
            record,
        });
        while self.entries.len() > most.max(1) {
            let may_go = |entry: &KeptCalibration| most < 2 || Some(entry.number) != before;
            let oldest = self.entries.iter().position(may_go).unwrap_or(0);
            self.entries.remove(oldest);
        }
    }

    /// Makes an earlier calibration the active one: that with this number, or the one saved before.
    ///
    /// # Errors
    ///
    /// When there is no such calibration, or when the active one is locked.
    pub fn roll_back(&mut self, number: Option<u64>) -> Result<&KeptCalibration, HistoryError> {
        if self.is_locked() {
            return Err(HistoryError::Locked);
        }
        let earlier = match number {
            Some(_) => self.find(number)?,
            None => {
                let active = self.active.unwrap_or(u64::MAX);
                let mut newest_first = self.entries.iter().rev();
                newest_first
                    .find(|entry| entry.number < active)
                    .ok_or(HistoryError::NothingBefore)?
            }
        };
        self.active = Some(earlier.number);
        self.find(None)
    }

    /// Forgets all calibrations, or that with this number, or the active one, and returns how many. If the active one is among
    /// them, none is active any more.
    ///
    /// # Errors
    ///
    /// When there is no such calibration, or when the active one is locked.
    pub fn forget(&mut self, number: Option<u64>, all: bool) -> Result<usize, HistoryError> {
        let only = if all {
            None
        } else {
            Some(self.find(number)?.number)
        };
        let goes = |entry: &KeptCalibration| only.is_none_or(|number| entry.number == number);
        if self.is_locked() && self.active().is_some_and(goes) {
            return Err(HistoryError::Locked);
        }
        let before = self.entries.len();
        self.entries.retain(|entry| !goes(entry));
        if self.active().is_none() {
            self.active = None;
        }
        Ok(before - self.entries.len())
    }

    fn none_active(&self) -> HistoryError {
        HistoryError::NoneActive(self.policy, !self.entries.is_empty())
    }

    /// Locks the active calibration, or sets another policy.
    ///
    /// # Errors
    ///
    /// When a lock is asked for and no calibration is active.
    pub fn set_policy(&mut self, policy: Policy) -> Result<(), HistoryError> {
        if policy == Policy::Locked && self.active.is_none() {
            return Err(self.none_active());
        }
        self.policy = policy;
        Ok(())
    }

    /// What is wrong with it, on reading and on writing.
    pub(super) fn fault(&self) -> Option<String> {
        if let Some(fault) = self.mounting.as_ref().and_then(|told| told.fault()) {
            return Some(fault);
        }
        let mut last = 0;
        for entry in &self.entries {
            if entry.number <= last {
                return Some(format!(
                    "history: number {} follows {last}, but numbers must rise from 1",
                    entry.number
                ));
            }
            last = entry.number;
        }
        let newest = self.last_number;
        if last > newest {
            return Some(format!(
                "last_number is {newest}, but the history has a number {last}"
            ));
        }
        if newest > LARGEST_NUMBER {
            return Some(format!(
                "last_number is {newest}, but must be at most {LARGEST_NUMBER}"
            ));
        }
        match self.active {
            Some(number) if self.entry(number).is_none() => Some(format!(
                "in_force is {number}, but the history has no such number"
            )),
            _ => None,
        }
    }
}
