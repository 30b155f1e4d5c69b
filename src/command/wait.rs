//! `headingd calibration start --wait`: follows the daemon until it has judged a turn, or has learnt as much by motion.

use std::path::Path;
use std::time::{Duration, Instant};

use indicatif::ProgressBar;
use serde_json::{Value, json};

use super::control::{ControlTarget, daemon_status};
use super::headings::Headings;
use super::wording::reason_text;
use super::{Failure, print, print_json, progress, tell, text};
use crate::publish::control::ControlRequest;
use crate::publish::control::status::DaemonStatus;

/// Verdicts alone.
const WATCH: &str = r#"{"enable":true,"json":false,"calibration":true}"#;

/// Polls the daemon's status, to show the turn and to detect a cancel by another client.
const LOOK: Duration = Duration::from_secs(1);

/// Without a terminal, a line each time that so much more of a turn is done.
const STEP: f64 = 0.25;

/// Asks for a calibration on the next turn, and waits for its verdict. A refusal has status [`Failure::REFUSED`].
pub fn start_and_wait(target: &ControlTarget, json: bool) -> Result<(), Failure> {
    let path = target.path()?;
    let status = daemon_status(&path)?;
    let mut headings = Headings::open(Path::new(&status.heading_socket), WATCH)?;
    // What has been judged before is of no interest.
    headings.pass_over()?;
    headings.set_patience(LOOK)?;
    let started = target.ask(&ControlRequest::Start {}, json)?;
    tell(text(&started, "message"));
    tell("to give that up: headingd calibration cancel (Ctrl-C ends only the waiting)");
    let mut show = Show {
        bar: progress::bar(progress::WITH_MESSAGE),
        reason: None,
        share: 0.0,
    };
    show.update(&status);
    let mut looked = Instant::now();
    let mut given_up = false;
    loop {
        let object = headings.object_in_time()?.unwrap_or_default();
        // Motion that taught as much ends the wait for a turn too.
        let over = object["method"] == "turn" || object["verdict"] == "accepted";
        // The start itself cancels a calibration that is under way; its outcome is not the one to wait for.
        if object["class"] == "CALIBRATION" && over && object["reason"] != "cancelled" {
            drop(show);
            return conclude(&object, headings.text(), json);
        }
        if looked.elapsed() >= LOOK {
            looked = Instant::now();
            let status = daemon_status(&path)?;
            show.update(&status);
            let over = !status.armed && !status.calibrating;
            // The verdict may be on its way: a second look decides.
            if over && given_up {
                let message = "the calibration was cancelled, or locked, by somebody else";
                drop(show);
                if json {
                    print_json(&json!({"ok": false, "code": "cancelled", "message": message}))?;
                }
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
        let again = match verdict {
            "rejected" => "; the next turn is another attempt",
            _ => "",
        };
        let said = reason_text(verdict, reason, message);
        print(&format!("{said}{again}\n"))?;
    }
    match verdict {
        "rejected" => Err(Failure::new(Failure::REFUSED, "")),
        _ => Ok(()),
    }
}

/// What is shown meanwhile.
struct Show {
    bar: ProgressBar,
    reason: Option<String>,
    share: f64,
}

impl Show {
    fn update(&mut self, status: &DaemonStatus) {
        let word = status.cal_state.as_deref().unwrap_or("starting");
        let said = match status.reason.as_deref() {
            // Its message asks for other motion, which would spoil the turn.
            Some("learning") => "waiting for a turn: once all the way round, level".to_owned(),
            _ => format!("{word}: {}", status.message),
        };
        let share = status.progress.unwrap_or(0.0);
        if !self.bar.is_hidden() {
            progress::set(&self.bar, share);
            self.bar.set_message(said);
        } else if self.reason != status.reason || (share - self.share).abs() >= STEP {
            (self.reason, self.share) = (status.reason.clone(), share);
            let percent = |share| format!("{:3.0} % of a turn  ", 100.0 * share);
            let turned = status.progress.map_or(String::new(), percent);
            tell(format_args!("{turned}{said}"));
        }
    }
}
