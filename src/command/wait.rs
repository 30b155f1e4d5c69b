//! `headingd calibration start --wait`: follows the daemon until it has judged a turn.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use serde_json::Value;

use super::control::{self, ControlTarget, exchange};
use super::headings::Headings;
use super::progress::Progress;
use super::{Failure, print, text};
use crate::advice::next_step;
use crate::publish::control::ControlRequest;
use crate::publish::control::status::DaemonStatus;

/// States and verdicts alone.
const WATCH: &str = r#"{"enable":true,"json":false,"state":true,"calibration":true}"#;

/// How often the daemon is asked whether it still wants to calibrate: somebody else may have cancelled.
const LOOK: Duration = Duration::from_secs(2);

/// Without a terminal, a line each time that so much more of a turn is done.
const STEP: f64 = 0.25;

/// Asks for a calibration on the next turn, and waits for its verdict. A refusal has status [`Failure::REFUSED`].
pub fn start_and_wait(target: &ControlTarget, json: bool) -> Result<(), Failure> {
    let path = target.path()?;
    let ask_status = || -> Result<DaemonStatus, Failure> {
        let answer = exchange(&path, &ControlRequest::Status {});
        control::read(answer.map_err(|(why, _)| why)?)
    };
    let status = ask_status()?;
    let Some(socket) = &status.heading_socket else {
        let message =
            "the daemon is older than this headingd, and does not name its socket for headings";
        return Err(Failure::new(Failure::UNAVAILABLE, message));
    };
    let mut headings = Headings::open(&PathBuf::from(socket), WATCH)?;
    // What has been judged before is of no interest.
    headings.pass_over()?;
    headings.set_patience(Some(LOOK))?;
    let started = target.ask(&ControlRequest::Start {}, json)?;
    eprintln!("headingd: {}", text(&started, "message"));
    let mut show = Show::new();
    let mut looked = Instant::now();
    let mut given_up = false;
    loop {
        let object = headings.object_in_time()?.unwrap_or_default();
        match object["class"].as_str() {
            Some("STATE") => show.state(&object),
            // A calibration by motion is not what was asked for.
            Some("CALIBRATION") if object["method"] == "turn" => {
                drop(show);
                return conclude(&object, headings.text(), json);
            }
            _ => {}
        }
        if looked.elapsed() > LOOK {
            looked = Instant::now();
            let status = ask_status()?;
            let over = !status.armed && !status.calibrating;
            // The verdict may be on its way: a second look decides.
            if over && given_up {
                let message = "given up: somebody has cancelled it, or locked the calibration";
                return Err(Failure::new(Failure::REFUSED, message));
            }
            given_up = over;
        }
    }
}

fn conclude(outcome: &Value, line: &str, json: bool) -> Result<(), Failure> {
    let [verdict, reason, message] = ["verdict", "reason", "message"].map(|key| text(outcome, key));
    if json {
        print(&format!("{line}\n"))?;
    } else {
        let mut said = format!("{verdict} ({reason}): {message}\n");
        if verdict == "rejected"
            && let Some(advice) = next_step(reason)
        {
            said += &format!("what to do: {advice}; the next turn is calibrated on again\n");
        }
        print(&said)?;
    }
    match verdict {
        "rejected" => Err(Failure::new(Failure::REFUSED, "")),
        _ => Ok(()),
    }
}

/// What is shown meanwhile.
struct Show {
    bar: Progress,
    reason: String,
    share: f64,
}

impl Show {
    fn new() -> Self {
        Self {
            bar: Progress::with_message(),
            reason: String::new(),
            share: 0.0,
        }
    }

    fn state(&mut self, state: &Value) {
        let [word, reason, message] =
            ["cal_state", "reason", "message"].map(|key| text(state, key));
        let share = state["progress"].as_f64().unwrap_or_default();
        let changed = reason != self.reason;
        if changed {
            reason.clone_into(&mut self.reason);
            self.share = 0.0;
        }
        if self.bar.is_shown() {
            self.bar.set(share);
            self.bar.say(format!("{word}: {message}"));
        } else if changed || share >= self.share + STEP {
            self.share = share;
            eprintln!("headingd: {:3.0} %  {word}: {message}", 100.0 * share);
        }
    }
}
