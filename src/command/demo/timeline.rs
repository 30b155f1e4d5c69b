//! What a person sees of the demo, made from what its client reads.

use std::fmt;

use serde_json::Value;

use super::super::wording::bar;
use super::super::{Failure, text};
use crate::config::Config;
use crate::frame::{to_tenths, wrap_pi};
use crate::sensor::simulator::{self, Simulator};

/// Headings further from the truth than this, RMS, are not what was promised.
const PROMISED_DEG: f64 = 1.0;
/// From one line on headings to the next, on the board's clock.
const NEXT_LINE_S: f64 = 5.0;
/// From one line on a turn's progress to the next, in turns.
const STEP: f64 = 0.25;
/// The socket tells time to the microsecond.
const SAME_S: f64 = 1e-6;
/// Lines that go on begin below the text of the first.
const INDENT: &str = "           ";

pub(super) struct Timeline {
    /// What the board that the daemon reads does, once more.
    simulator: Simulator,
    basic_iterations: usize,
    now_s: f64,
    shown_s: f64,
    shown_progress: f64,
    state: String,
    accepted: bool,
    turns: u32,
    raw_before: Score,
    raw_after: Score,
    published: Score,
}

impl Timeline {
    pub(super) fn new(config: &Config, simulator: Simulator) -> Self {
        Self {
            simulator,
            basic_iterations: config.calibration.max_iterations,
            now_s: 0.0,
            shown_s: 0.0,
            shown_progress: 0.0,
            state: String::new(),
            accepted: false,
            turns: 0,
            raw_before: Score::default(),
            raw_after: Score::default(),
            published: Score::default(),
        }
    }

    /// Takes a message, and gives what there is to show of it.
    pub(super) fn take(&mut self, message: &Value) -> String {
        if let Some(t_s) = message["t_s"].as_f64() {
            self.now_s = t_s;
        }
        match message["class"].as_str() {
            Some("ATT") => self.attitude(message),
            Some("STATE") => self.state(message),
            Some("CALIBRATION") => self.calibration(message),
            Some("ERROR") => self.line(&format!("error: {}", text(message, "message"))),
            _ => String::new(),
        }
    }

    fn attitude(&mut self, att: &Value) -> String {
        let Some(truth_deg) = self.truth_deg() else {
            return String::new();
        };
        let number = |key: &str| att[key].as_f64();
        let raw = number("raw_heading");
        let Some(heading_deg) = number("mheading") else {
            self.raw_before.add(raw, truth_deg);
            return String::new();
        };
        self.raw_after.add(raw, truth_deg);
        self.published.add(Some(heading_deg), truth_deg);
        if self.now_s < self.shown_s + NEXT_LINE_S {
            return String::new();
        }
        self.shown_s = self.now_s;
        let [heading_deg, truth_deg] = [heading_deg, truth_deg].map(to_tenths);
        let raw = raw.map_or(String::new(), |raw| {
            format!(", raw {:5.1}°", to_tenths(raw))
        });
        self.line(&format!(
            "heading {heading_deg:5.1}°, truth {truth_deg:5.1}°{raw}, {}",
            self.state
        ))
    }

    /// The true heading at the time of the newest reading.
    fn truth_deg(&mut self) -> Option<f64> {
        let from_s = self.now_s - SAME_S;
        let entry = self
            .simulator
            .find(|entry| entry.reading.field_mgauss.is_some() && entry.reading.t_s > from_s)?;
        entry.heading_truth_deg
    }

    fn state(&mut self, state: &Value) -> String {
        let word = text(state, "cal_state").to_owned();
        let changed = word != self.state;
        self.state = word;
        match (self.state.as_str(), state["progress"].as_f64()) {
            ("uncalibrated", _) if changed => {
                self.line("at rest and uncalibrated: no heading is published, only the raw one")
            }
            ("turning", Some(progress)) => {
                if changed {
                    self.shown_progress = 0.0;
                    let raw = self.raw_before;
                    return self.line(&format!(
                        "the board turns; up to now the raw heading was off by {raw}"
                    ));
                }
                if progress < self.shown_progress + STEP {
                    return String::new();
                }
                self.shown_progress = progress;
                let percent = 100.0 * progress;
                self.line(&format!("turning {} {percent:3.0} %", bar(progress)))
            }
            ("fault", _) => self.line(&format!("fault: {}", text(state, "message"))),
            _ => String::new(),
        }
    }

    fn calibration(&mut self, outcome: &Value) -> String {
        let verdict = text(outcome, "verdict");
        self.turns += u32::from(outcome["method"] == "turn");
        let mut shown = self.line(&match (text(outcome, "method"), self.turns) {
            ("turn", 1) => format!("full turn. The raw heading was off by {}", self.raw_before),
            ("turn", turn) => format!("full turn, number {turn}"),
            _ => "calibration by motion".to_owned(),
        });
        let mut add = |line: &str| shown += &format!("{INDENT}{line}\n");
        if let (Some(start), Some(end), Some(total)) = (
            outcome["window"]["start"].as_u64(),
            outcome["window"]["end"].as_u64(),
            outcome["samples"]["total"].as_u64(),
        ) {
            add(&format!("RIST   samples {start} to {end} of {total}"));
        }
        if let Some(iterations) = outcome["swarm"]["iterations"].as_u64() {
            add(&format!(
                "swarm  {iterations} iterations, where the basic algorithm makes {}",
                self.basic_iterations
            ));
        }
        add(&format!("{verdict}: {}", text(outcome, "message")));
        if verdict == "accepted" {
            if !self.accepted {
                add("from now on this calibration corrects the field");
            }
            self.accepted = true;
        }
        self.shown_s = self.now_s;
        shown
    }

    pub(super) fn closing(&self) -> String {
        let mut shown = self.line(&format!(
            "the end. {} headings were published; they were off by",
            self.published.count
        ));
        for (what, score) in [
            ("published heading  ", &self.published),
            ("raw heading        ", &self.raw_after),
        ] {
            shown += &format!("{INDENT}{what}{score}\n");
        }
        shown
    }

    /// Whether the demo has shown what it was to show.
    pub(super) fn judge(&self) -> Result<(), Failure> {
        let refused = |why: String| Err(Failure::new(Failure::REFUSED, why));
        match self.published.rms_deg() {
            _ if !self.accepted => refused("no calibration was accepted".to_owned()),
            None => refused("no heading was published after the calibration".to_owned()),
            Some(rms_deg) if rms_deg > PROMISED_DEG => refused(format!(
                "the published headings were off by {rms_deg:.2}° RMS, which is more than {PROMISED_DEG}°"
            )),
            Some(_) => Ok(()),
        }
    }

    /// A line with the time before it.
    fn line(&self, line: &str) -> String {
        format!("{:6.1} s   {line}\n", self.now_s)
    }
}

/// What comes first: what this is, and how to look into it.
pub(super) fn opening(config: &Config, duration_s: f64) -> String {
    let socket = config.socket.socket.display();
    let simulator::Settings { seed, turns, .. } = config.simulator;
    let speed = config.source.speed;
    format!(
        "headingd demo: a simulated HMC5843 with hard iron, a gyro and an accelerometer, seed {seed}.\n\
         The board rests, makes {turns} level turns, and then moves about: {duration_s:.0} s, {speed} times real time.\n\
         \n\
         The daemon serves on {socket}\n\
         To look into it from another terminal:\n\
         \n  headingd watch --socket {socket}\n\n"
    )
}

/// Angles between headings and the truth.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Score {
    count: u32,
    sum_of_squares: f64,
    worst_deg: f64,
}

impl Score {
    /// Counts a heading, if there is one.
    fn add(&mut self, heading_deg: Option<f64>, truth_deg: f64) {
        if let Some(heading_deg) = heading_deg {
            let error_deg = wrap_pi((heading_deg - truth_deg).to_radians()).to_degrees();
            self.count += 1;
            self.sum_of_squares += error_deg * error_deg;
            self.worst_deg = self.worst_deg.max(error_deg.abs());
        }
    }

    /// The root mean square, degrees, unless nothing was counted.
    fn rms_deg(&self) -> Option<f64> {
        (self.count > 0).then(|| (self.sum_of_squares / f64::from(self.count)).sqrt())
    }
}

impl fmt::Display for Score {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.rms_deg() {
            Some(rms_deg) => write!(f, "{rms_deg:5.2}° RMS, {:5.2}° at worst", self.worst_deg),
            None => f.write_str("none was published"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_go_the_short_way_round() {
        let mut score = Score::default();
        assert_eq!(score.rms_deg(), None);
        score.add(Some(1.0), 358.0);
        score.add(Some(356.0), 0.0);
        score.add(None, 90.0);
        assert!((score.rms_deg().unwrap() - 12.5f64.sqrt()).abs() < 1e-12);
        assert_eq!(score.to_string(), " 3.54° RMS,  4.00° at worst");
    }
}
