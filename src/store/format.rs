//! The calibration file: JSON, with its version in front.
//!
//! ```json
//! { "headingd_store": 2, "sensors": [
//!   { "sensor": "hmc5843", "mag_axes": "+x +y +z", "mode": "on", "in_force": 2, "last_number": 2, "history": [
//!     { "number": 2, "saved_unix_s": 1760000000, "reason": "turn", "gyro_rms_deg": 0.8, "samples": 560,
//!       "calibration": { "mode": "planar", … } } ] } ] }
//! ```
//!
//! Version 1 had one sensor, and the active calibration alone. Version 3 has the `mounting` of a board; where there is
//! none, version 2 is written. Keys that a version does not know are ignored. A change that an older program must not
//! ignore needs a new version: one that ignored a mounting would publish headings of another direction.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::history::{History, Identity};
use super::plausible::{faults, no_number};

const VERSION: u64 = 3;

/// The version of a file in which no board's mounting is kept.
const WITHOUT_MOUNTING: u64 = 2;

/// What a calibration file holds.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CalibrationFile {
    /// What is kept, sensor by sensor.
    pub sensors: Vec<History>,
}

/// Why a text is no calibration file.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FormatError {
    /// Not understood, half-written or with values that no calibration has.
    #[error("{0}")]
    Unreadable(String),
    /// Of a version that only a newer program knows.
    #[error("store version {0} is newer than this headingd supports ({VERSION}): upgrade headingd")]
    Newer(u64),
}

#[derive(Serialize)]
struct Written<'a> {
    headingd_store: u64,
    #[serde(flatten)]
    contents: &'a CalibrationFile,
}

impl CalibrationFile {
    /// With one sensor.
    pub fn of(history: History) -> Self {
        Self {
            sensors: vec![history],
        }
    }

    /// What is kept for this sensor.
    pub fn find(&self, identity: &Identity) -> Option<&History> {
        self.sensors.iter().find(|kept| kept.identity == *identity)
    }

    /// Whose calibrations these are, for people.
    pub fn owners(&self) -> String {
        let owner = |kept: &History| kept.identity.to_string();
        let owners: Vec<String> = self.sensors.iter().map(owner).collect();
        if owners.is_empty() {
            return "no sensor".to_owned();
        }
        owners.join(" and ")
    }

    /// What is kept for this sensor takes the place of what was.
    pub fn put(&mut self, history: History) {
        match self
            .sensors
            .iter_mut()
            .find(|kept| kept.identity == history.identity)
        {
            Some(kept) => *kept = history,
            None => self.sensors.push(history),
        }
    }

    /// As the text of a file.
    ///
    /// # Errors
    ///
    /// When something could not be read again.
    pub fn to_json(&self) -> Result<String, String> {
        let written = self.written()?;
        let text = serde_json::to_string_pretty(&written).map_err(|error| error.to_string())?;
        Ok(text + "\n")
    }

    /// The same as one object.
    ///
    /// # Errors
    ///
    /// When something could not be read again.
    pub fn to_value(&self) -> Result<Value, String> {
        serde_json::to_value(self.written()?).map_err(|error| error.to_string())
    }

    fn written(&self) -> Result<Written<'_>, String> {
        // What is written must be readable: JSON has no NaN, for one.
        if let Some(fault) = self.fault() {
            return Err(fault);
        }
        let mounted = self.sensors.iter().any(|kept| kept.mounting.is_some());
        Ok(Written {
            headingd_store: if mounted { VERSION } else { WITHOUT_MOUNTING },
            contents: self,
        })
    }

    /// Reads a calibration file, and checks that its values can be a calibration's.
    ///
    /// # Errors
    ///
    /// When the text is not a calibration file of a supported version, or when its values cannot be those of a calibration.
    pub fn from_json(bytes: &[u8]) -> Result<Self, FormatError> {
        let value: Value = serde_json::from_slice(bytes)
            .map_err(|error| FormatError::Unreadable(error.to_string()))?;
        Self::from_value(value)
    }

    /// The same of JSON that has been read.
    ///
    /// # Errors
    ///
    /// As [`Self::from_json`].
    pub fn from_value(mut value: Value) -> Result<Self, FormatError> {
        let fail = |why: String| FormatError::Unreadable(why);
        // Check the version first: other fields may differ.
        let version = match value.get("headingd_store").map(Value::as_u64) {
            Some(Some(newer)) if newer > VERSION => return Err(FormatError::Newer(newer)),
            Some(Some(version)) if version > 0 => version,
            Some(_) => return Err(fail("headingd_store is no version number".to_owned())),
            None => return Err(fail("key headingd_store is missing".to_owned())),
        };
        if version == 1 {
            // It had one calibration, which was active.
            let [sensor, mag_axes] = ["sensor", "mag_axes"].map(|key| value[key].take());
            value["number"] = 1.into();
            // It wrote 0 where the clock was not set.
            if value["saved_unix_s"] == 0 {
                value["saved_unix_s"] = Value::Null;
            }
            value = json!({ "sensors": [{
                "sensor": sensor, "mag_axes": mag_axes, "in_force": 1, "last_number": 1, "history": [value],
            }] });
        }
        let contents = Self::deserialize(&value)
            .map_err(|error| fail(no_number("", &value).unwrap_or_else(|| error.to_string())))?;
        match contents.fault() {
            None => Ok(contents),
            Some(fault) => Err(fail(fault)),
        }
    }

    fn fault(&self) -> Option<String> {
        for (index, history) in self.sensors.iter().enumerate() {
            if let Some(fault) = history.fault() {
                return Some(format!("sensors[{index}]: {fault}"));
            }
            if self.sensors[..index]
                .iter()
                .any(|other| other.identity == history.identity)
            {
                return Some(format!("{} appears twice", history.identity));
            }
            for entry in &history.entries {
                if let Some(fault) = faults(&entry.record.calibration).first() {
                    return Some(fault.to_string());
                }
            }
        }
        None
    }
}
