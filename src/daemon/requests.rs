//! Carries out the requests of the control socket.

use std::time::Duration;

use serde_json::{Value, json};

use super::Daemon;
use super::recorder::Recorder;
use crate::calibration::model::Calibration;
use crate::calibration::policy::{CalibrationOrigin, Policy};
use crate::calibration::verdict::judge_imported;
use crate::date;
use crate::frame::rounded;
use crate::pipeline::Event;
use crate::publish::control::status::{
    ActiveSummary, CalibrationSummary, DaemonStatus, FolderSummary, ReferenceSummary,
};
use crate::publish::control::{Answer, ControlCall, ControlRequest};
use crate::store::history::HistoryError;
use crate::store::{CalibrationFile, CalibrationRecord, FormatError, History, KeptCalibration};
use crate::true_north::EarthField;
use crate::wall_clock;

impl From<HistoryError> for Answer {
    fn from(refusal: HistoryError) -> Self {
        Self::refused(refusal.code(), refusal.to_string())
    }
}

impl Daemon {
    /// What is kept of the sensor.
    pub(super) fn history(&self) -> &History {
        self.session.store.history()
    }

    /// Carries out a request. A change is answered once it is on disk.
    pub(super) fn answer(&mut self, call: ControlCall) {
        let ControlCall { request, answer } = call;
        self.session.store.take_changed();
        let done = match self.carry_out_request(request) {
            Ok(done) if self.session.store.take_changed() => done,
            Ok(unchanged) | Err(unchanged) => {
                // A client that has left need not be told.
                let _ = answer.send(unchanged);
                return;
            }
        };
        self.session.store.save(Box::new(move |kept| {
            let _ = answer.send(match kept {
                Ok(()) => done,
                Err(why) => Answer {
                    ok: false,
                    code: "not_kept",
                    message: format!(
                        "{}, but it is not on disk yet ({why}); saving is tried again, and if the daemon stops first, the change is lost",
                        done.message
                    ),
                    ..done
                },
            });
        }));
    }

    fn carry_out_request(&mut self, request: ControlRequest) -> Result<Answer, Answer> {
        match request {
            ControlRequest::Status {} => Ok(self.status()),
            ControlRequest::List {} => Ok(self.list()),
            ControlRequest::Show { number } => {
                let history = self.history();
                let entry = history.find(number)?;
                let shown = serde_json::to_value(entry.record.calibration).map_err(failed)?;
                Ok(Answer::done(sentence(entry))
                    .with_all(&json!({ "calibration": described(entry, history) }))
                    .with("parameters", shown))
            }
            ControlRequest::Export { number } => self.export(number),
            ControlRequest::Import { file } => self.import(file),
            ControlRequest::Rollback { number } => {
                let entry = *self.session.store.history_mut().roll_back(number)?;
                Ok(self.activated(entry.number, entry.record.calibration))
            }
            ControlRequest::Forget { number, all } => self.forget(number, all),
            ControlRequest::Lock {} => self.set_policy(Policy::Locked),
            ControlRequest::Unlock {} if self.history().policy != Policy::Locked => {
                let mode = self.history().policy.word();
                let message = format!("nothing was locked: mode {mode} stays");
                Ok(Answer::done(message).with("mode", mode))
            }
            ControlRequest::Unlock {} => self.set_policy(Policy::On),
            ControlRequest::Mode { mode: Some(policy) } => self.set_policy(policy),
            ControlRequest::Mode { mode: None } => Ok(policy_answer(self.history().policy)),
            ControlRequest::Start {} => {
                if self.history().is_locked() {
                    return Err(HistoryError::Locked.into());
                }
                self.handle(Event::Start);
                Ok(Answer::done(
                    "turn the board once all the way round, level and away from iron: that turn calibrates the compass",
                ))
            }
            ControlRequest::Cancel {} => {
                let started = self.session.pipeline.wanted() == Some(CalibrationOrigin::Start);
                if !started && !self.session.pipeline.is_calibrating() {
                    return Err(Answer::refused(
                        "nothing_to_cancel",
                        "nothing was started, and no calibration is under way",
                    ));
                }
                self.handle(Event::Cancel);
                Ok(Answer::done("given up; nothing else changes"))
            }
            ControlRequest::Mounting {
                level,
                heading_deg,
                reset,
            } => self.mount(level, heading_deg, reset),
        }
    }

    fn set_policy(&mut self, policy: Policy) -> Result<Answer, Answer> {
        self.session.store.history_mut().set_policy(policy)?;
        self.handle(Event::Policy(policy));
        Ok(policy_answer(policy))
    }

    fn forget(&mut self, number: Option<u64>, all: bool) -> Result<Answer, Answer> {
        let history = self.session.store.history_mut();
        let was_active = history.active.is_some();
        let count = history.forget(number, all)?;
        let rest = match history.find(None) {
            Ok(_) => "the active one stays".to_owned(),
            Err(none) => none.to_string(),
        };
        // With `all`, also what has been learnt and is not kept yet.
        if all || was_active && history.active.is_none() {
            self.handle(Event::Activate(None));
        }
        Ok(
            Answer::done(format!("forgot {count} of the calibrations; {rest}"))
                .with("count", count),
        )
    }

    fn export(&self, number: Option<u64>) -> Result<Answer, Answer> {
        let history = self.history();
        let entry = history.find(number)?;
        let contents = CalibrationFile::of(History::of(history.identity.clone(), entry.record));
        let file = contents.to_value().map_err(failed)?;
        Ok(Answer::done(sentence(entry)).with("file", file))
    }

    fn import(&mut self, file: Value) -> Result<Answer, Answer> {
        let contents = CalibrationFile::from_value(file).map_err(|error| {
            let code = match &error {
                FormatError::Unreadable(_) => "unreadable",
                FormatError::Newer(_) => "newer",
            };
            Answer::refused(code, format!("this is no usable calibration file: {error}"))
        })?;
        let history = self.history();
        let found = contents.find(&history.identity);
        let found = found.ok_or_else(|| other_sensor(&contents, history))?;
        let entry = found.active().ok_or_else(|| {
            let message = "no calibration in this file is active: export writes one that is";
            Answer::refused("no_calibration", message)
        })?;
        judge_imported(&entry.record.calibration, &self.session.config.verdict).map_err(
            |refusal| {
                let message = format!("{}: {}", refusal.reason, refusal.message);
                Answer::refused("implausible", message)
            },
        )?;
        if history.is_locked() {
            return Err(HistoryError::Locked.into());
        }
        let record = CalibrationRecord {
            origin: Some(CalibrationOrigin::Import),
            ..entry.record
        };
        // Copies of one that is kept already would drive out the others.
        let number = match history.number_of(&record) {
            Some(number) => {
                let history = self.session.store.history_mut();
                history.roll_back(Some(number))?.number
            }
            None => self.session.store.keep(record),
        };
        Ok(self.activated(number, record.calibration))
    }

    fn activated(&mut self, number: u64, calibration: Calibration) -> Answer {
        self.handle(Event::Activate(Some(Box::new(calibration))));
        Answer::done(format!("calibration {number} is active")).with("number", number)
    }

    fn list(&self) -> Answer {
        let history = self.history();
        let described = |entry| described(entry, history);
        let entries: Vec<_> = history.entries.iter().map(described).collect();
        let message = match (entries.len(), history.active) {
            (0, _) => format!("no calibration of {} is kept", history.identity),
            (count, Some(number)) => format!("{count} kept; {number} is active"),
            (count, None) => format!("{count} kept; none is active"),
        };
        Answer::done(message)
            .with("sensor", history.identity.sensor.as_str())
            .with("mag_axes", history.identity.mag_axes.to_string())
            .with("mode", history.policy.word())
            .with("in_force", history.active)
            .with_all(&json!({ "calibrations": entries }))
    }

    /// The daemon's status, with word, reason and sentence of the `STATE` published last.
    fn status(&self) -> Answer {
        let history = self.history();
        let report = self.reported.as_ref();
        let starting = || "the daemon has just started: no reading has come yet".to_owned();
        let message = report.map_or_else(starting, |report| report.message.to_string());
        let session = &self.session;
        let latest = self.publisher.latest();
        let latest = latest.filter(|heading| heading.magnetic_deg().is_some());
        let latest = latest.as_ref();
        let reference = |field: &EarthField| ReferenceSummary {
            strength_mgauss: to_hundredths(field.strength_mgauss.value),
            dip_deg: to_hundredths(field.dip_deg.value),
        };
        let active = |calibration: Calibration| ActiveSummary {
            mode: Some(calibration.parameters.mode()),
            strength_mgauss: to_hundredths(calibration.strength_mgauss),
        };
        let board = history.board(&session.config.mounting.board());
        // Rounded again, since the remainder has more digits.
        let degrees =
            |angle: Option<f64>| Some(to_hundredths(to_hundredths(angle?).rem_euclid(360.0)));
        Answer::done(message).with_all(&DaemonStatus {
            cal_state: report.map(|report| report.condition.word().to_owned()),
            reason: report.map(|report| report.reason.to_owned()),
            heading: latest.and_then(|it| degrees(it.true_deg())),
            mheading: latest.and_then(|it| degrees(it.magnetic_deg())),
            heading_sd: latest.and_then(|it| it.sd_deg.map(to_hundredths)),
            policy: history.policy,
            armed: session.pipeline.wanted() == Some(CalibrationOrigin::Start),
            calibrating: session.pipeline.is_calibrating(),
            progress: session.pipeline.progress().map(to_hundredths),
            calibration: history.active().map(|entry| described(entry, history)),
            last: self.concluded.clone(),
            reference: session.north.true_north.field().map(reference),
            active: session.pipeline.calibration().map(active),
            heading_socket: self.socket.display().to_string(),
            source: session.source.name.clone(),
            sensor: history.identity.sensor.clone(),
            mag_axes: history.identity.mag_axes.to_string(),
            board_axes: Some(board.rounded()),
            uptime_s: self.begun.elapsed().as_secs(),
            clients: self.publisher.clients(),
            counts: self.counts(),
            store: session.store.summary(),
            record: (session.recorder.as_ref()).map_or_else(FolderSummary::off, Recorder::summary),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            // In the answer already.
            message: String::new(),
        })
    }
}

/// To two decimal places, as headings are published.
fn to_hundredths(value: f64) -> f64 {
    rounded(value, 2)
}

fn policy_answer(policy: Policy) -> Answer {
    let message = match policy {
        Policy::On => "mode on: full turns and other motion calibrate",
        Policy::Off => {
            "mode off: nothing is calibrated unless headingd calibration start asks for it"
        }
        Policy::Locked => "mode locked: nothing takes the place of the active calibration",
    };
    Answer::done(message).with("mode", policy.word())
}

fn described(entry: &KeptCalibration, history: &History) -> CalibrationSummary {
    let CalibrationRecord {
        saved_unix_s,
        origin,
        gyro_rms_deg,
        samples,
        calibration,
    } = entry.record;
    CalibrationSummary {
        number: entry.number,
        in_force: history.active == Some(entry.number),
        saved_unix_s,
        time: saved_unix_s.map(|unix_s| date::rfc3339(Duration::from_secs(unix_s))),
        age_s: saved_unix_s.and_then(|saved| wall_clock::unix_now_s()?.checked_sub(saved)),
        origin,
        mode: Some(calibration.parameters.mode()),
        method: Some(calibration.method().to_owned()),
        residual_mgauss: Some(calibration.residual_mgauss),
        heading_sd_deg: Some(calibration.heading_sd_deg),
        gyro_rms_deg,
        samples,
    }
}

fn sentence(entry: &KeptCalibration) -> String {
    let calibration = &entry.record.calibration;
    let mode = calibration.parameters.mode().word();
    // A turn's fit knows nothing of the place, and of how the chips lie to each other.
    let certain = match calibration.covariance {
        Some(_) => "headings certain to",
        None => "the fit alone certain to",
    };
    format!(
        "calibration {}: {mode}, residual {:.1} milligauss, {certain} {:.2} degrees",
        entry.number, calibration.residual_mgauss, calibration.heading_sd_deg
    )
}

fn other_sensor(contents: &CalibrationFile, history: &History) -> Answer {
    let here = &history.identity;
    let turned = contents
        .sensors
        .iter()
        .any(|other| other.identity.sensor == here.sensor);
    let (code, remedy) = if turned {
        (
            "other_mounting",
            "set [mounting] right, or turn the board to calibrate anew",
        )
    } else {
        ("other_sensor", "turn the board to calibrate this one")
    };
    let owners = contents.owners();
    Answer::refused(
        code,
        format!("this file is of {owners}, but the sensor here is {here}: {remedy}"),
    )
}

fn failed(error: impl std::fmt::Display) -> Answer {
    Answer::refused("internal", format!("this cannot be written: {error}"))
}
