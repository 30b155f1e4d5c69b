//! What is known of the daemon, as the screen shows it.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use serde_json::Value;

use super::directions::Directions;
use super::feeds::News;
use super::scatter::FieldTrail;
use crate::calibration::policy::Policy;
use crate::frame::Mounting;
use crate::publish::control::ControlRequest;
use crate::publish::control::status::DaemonStatus;
use crate::publish::raw::{self, Object};

/// How many samples of the field are shown.
const SAMPLES: usize = 600;

/// A heading that came longer ago is not shown.
const FRESH: Duration = Duration::from_secs(2);

/// Rates are those of so many readings.
const RATE_OVER: usize = 100;

#[derive(Default)]
pub(super) struct View {
    pub(super) socket: String,
    /// Why the socket for headings is lost, if it is.
    pub(super) lost: Option<String>,
    att: Option<(Value, Instant)>,
    pub(super) state: Value,
    pub(super) outcome: Value,
    /// The latest answer to `status`, or why there is none.
    pub(super) status: Option<Result<Box<DaemonStatus>, String>>,
    /// The daemon's answer to the last key.
    pub(super) said: String,
    /// What the user is asked to confirm, and the request that it is.
    pub(super) asking: Option<(&'static str, ControlRequest)>,
    mounting: Mounting,
    pub(super) raw: FieldTrail,
    pub(super) corrected: FieldTrail,
    pub(super) directions: Directions,
    pub(super) headings_hz: Frequency,
    pub(super) field_hz: Frequency,
    pub(super) gyro_hz: Frequency,
    last_reading: u64,
    /// Readings that the daemon has left out for this client.
    pub(super) missed: u64,
}

impl View {
    pub(super) fn new(socket: String) -> Self {
        Self {
            socket,
            ..Self::default()
        }
    }

    pub(super) fn take(&mut self, news: News, now: Instant) {
        match news {
            News::Object(object) => {
                self.lost = None;
                self.object(object, now);
            }
            // The next daemon on this socket has a calibration and counts of its own.
            News::Lost(why) => {
                *self = Self::new(std::mem::take(&mut self.socket));
                self.lost = Some(why);
            }
            News::Status(status) => {
                let board = self.board();
                self.status = Some(status);
                // All of these are in the axes of the vehicle.
                if self.board() != board {
                    self.raw.clear();
                    self.corrected.clear();
                    self.directions.clear();
                }
            }
            News::Answer(said) => self.said = said,
        }
    }

    fn object(&mut self, object: Value, now: Instant) {
        match object["class"].as_str() {
            Some("ATT") => self.attitude(object, now),
            Some("STATE") => {
                let begins =
                    |word: &str| object["cal_state"] == word && self.state["cal_state"] != word;
                if begins("turning") {
                    self.directions.clear();
                }
                self.state = object;
            }
            Some("CALIBRATION") => {
                if object["method"] == "turn" {
                    self.directions.clear();
                }
                self.outcome = object;
            }
            Some("BOARD" | "READING") => self.reading(object, now),
            _ => {}
        }
    }

    fn attitude(&mut self, att: Value, now: Instant) {
        let number = |key: &str| att[key].as_f64();
        if let Some(t_s) = number("t_s") {
            self.headings_hz.count(t_s, now);
            let trusted = number("mheading");
            if let Some(degrees) = trusted.or(number("raw_heading")) {
                let rate_deg_s = number("rot").map(|rot| rot / 60.0);
                self.directions
                    .take(t_s, degrees, trusted.is_some(), rate_deg_s);
            }
        }
        let corrected = ["mag_x", "mag_y", "mag_z"].map(number);
        if corrected[0].is_some() {
            keep(
                &mut self.corrected,
                corrected.map(|axis| axis.unwrap_or(f64::NAN)),
            );
        }
        self.att = Some((att, now));
    }

    /// A board tells how its chips are mounted, and its readings are in their axes.
    fn reading(&mut self, object: Value, now: Instant) {
        match serde_json::from_value(object) {
            Ok(Object::Board { header }) => {
                if let Ok(header) = raw::header(&header) {
                    self.mounting = header.mountings.mag;
                }
            }
            Ok(Object::Reading(row)) => {
                let reading = row.reading();
                if self.last_reading > 0 {
                    let missed = row.seq.saturating_sub(self.last_reading).saturating_sub(1);
                    self.missed = self.missed.saturating_add(missed);
                }
                self.last_reading = row.seq;
                if let Some(field) = reading.whole_field_mgauss() {
                    self.field_hz.count(reading.t_s, now);
                    let mounting = self.board().after(&self.mounting);
                    keep(&mut self.raw, mounting.to_body(field).into());
                }
                if reading.rate_rad_s.is_some() {
                    self.gyro_hz.count(reading.t_s, now);
                }
            }
            _ => {}
        }
    }

    /// The latest heading, if it is fresh.
    pub(super) fn att(&self, now: Instant) -> &Value {
        match &self.att {
            Some((att, came)) if now.saturating_duration_since(*came) < FRESH => att,
            _ => &Value::Null,
        }
    }

    pub(super) fn answered(&self) -> Option<&DaemonStatus> {
        self.status.as_ref()?.as_deref().ok()
    }

    /// How the board is mounted: the corrected field is in the axes of the vehicle, and the raw one is drawn beside it.
    fn board(&self) -> Mounting {
        let told = self.answered().and_then(|status| status.board_axes);
        told.unwrap_or_default()
    }

    /// Whether nothing may take the place of the calibration.
    pub(super) fn is_locked(&self) -> bool {
        self.answered()
            .is_some_and(|status| status.policy == Policy::Locked)
    }

    /// The field at the edge of a plane, milligauss: all that is shown in it fits, in steps of 100.
    pub(super) fn reach_mgauss(&self, axes: [usize; 2]) -> f64 {
        let all = self.raw.iter().chain(&self.corrected);
        let parts = all.flat_map(|field| axes.map(|axis| field[axis].abs()));
        let most = parts.filter(|part| part.is_finite()).fold(100.0, f64::max);
        100.0 * (most / 100.0).ceil()
    }
}

fn keep(samples: &mut FieldTrail, sample: [f64; 3]) {
    if samples.len() == SAMPLES {
        samples.pop_front();
    }
    samples.push_back(sample);
}

/// How often something comes, by its own times.
#[derive(Clone, Debug, Default)]
pub(super) struct Frequency {
    times_s: VecDeque<f64>,
    came: Option<Instant>,
}

impl Frequency {
    fn count(&mut self, t_s: f64, now: Instant) {
        self.came = Some(now);
        // A source may begin anew.
        if self.times_s.back().is_some_and(|last_s| t_s < *last_s) {
            self.times_s.clear();
        }
        if self.times_s.len() == RATE_OVER {
            self.times_s.pop_front();
        }
        self.times_s.push_back(t_s);
    }

    /// A second; `None` if nothing has come of late.
    pub(super) fn hz(&self, now: Instant) -> Option<f64> {
        self.came
            .filter(|came| now.saturating_duration_since(*came) < FRESH)?;
        let passed_s = self.times_s.back()? - self.times_s.front()?;
        (passed_s > 0.0).then(|| (self.times_s.len() - 1) as f64 / passed_s)
    }
}
