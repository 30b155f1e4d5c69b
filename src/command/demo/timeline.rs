//! What a person sees of the demo, made from what its client reads.

use std::fmt::Write;
use std::io::{self, IsTerminal};

use serde_json::Value;

use super::score::{Score, Truth};
use crate::command::Failure;
use crate::config::Config;
use crate::frame::hypot;
use crate::sensor::simulator::{self, Simulator};

/// Headings further from the truth than this, RMS, are not what was promised.
const PROMISED_DEG: f64 = 1.0;
/// A board that is level within this angle.
const LEVEL_DEG: f64 = 1.0;
/// On a terminal the last line is rewritten this often, on the board's clock; elsewhere it is a line each
/// time that the second number has passed.
const REWRITE_S: f64 = 0.2;
const NEXT_LINE_S: f64 = 5.0;
/// Lines that go on begin below the text of the first.
const INDENT: &str = "           ";

/// The demo so far.
pub(super) struct Timeline {
    truth: Truth,
    settings: simulator::Settings,
    socket: String,
    speed: f64,
    duration_s: f64,
    basic_iterations: usize,
    terminal: bool,
    /// The last line on the terminal is one that will be rewritten.
    rewriting: bool,
    now_s: f64,
    shown_s: f64,
    shown_progress: f64,
    state: String,
    accepted: bool,
    turns: u32,
    raw_before: Score,
    raw_after: Score,
    published: Score,
    level: Score,
    tilted: Score,
}

impl Timeline {
    pub(super) fn new(config: &Config, simulator: Simulator) -> Self {
        Self {
            duration_s: simulator.duration_s(),
            truth: Truth::of(simulator),
            settings: config.simulator.clone(),
            socket: config.socket.socket.display().to_string(),
            speed: config.source.speed,
            basic_iterations: config.calibration.max_iterations,
            terminal: io::stdout().is_terminal(),
            rewriting: false,
            now_s: 0.0,
            shown_s: 0.0,
            shown_progress: 0.0,
            state: String::new(),
            accepted: false,
            turns: 0,
            raw_before: Score::default(),
            raw_after: Score::default(),
            published: Score::default(),
            level: Score::default(),
            tilted: Score::default(),
        }
    }

    /// What comes first: what this is, and how to look into it.
    pub(super) fn opening(&self) -> String {
        let socket = &self.socket;
        format!(
            "headingd demo: a simulated HMC5843 with hard iron, a gyro and an accelerometer, seed {seed}.\n\
             The board rests, makes {turns} level turns, and then moves about: {duration:.0} s, {speed} times real time.\n\
             \n\
             The daemon serves on {socket}\n\
             To look into it from another terminal:\n\
             \n  python3 -c 'import socket as s; c = s.socket(s.AF_UNIX); c.connect(\"{socket}\"); \
             c.send(b\"?WATCH={{\\\"enable\\\":true,\\\"json\\\":true}};\\n\"); [print(l, end=\"\") for l in c.makefile()]'\n\
             \nor, where there is an nc that knows -U:\n\
             \n  (printf '?WATCH={{\"enable\":true}};\\n'; cat) | nc -U {socket}\n\n",
            seed = self.settings.seed,
            turns = self.settings.turns,
            duration = self.duration_s,
            speed = self.speed,
        )
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
        let Some(truth_deg) = self.truth.heading_deg(self.now_s) else {
            return String::new();
        };
        let number = |key: &str| att[key].as_f64();
        let raw = number("raw_heading");
        let Some(heading_deg) = number("mheading") else {
            self.raw_before.count(raw, truth_deg);
            return String::new();
        };
        self.raw_after.count(raw, truth_deg);
        self.published.count(Some(heading_deg), truth_deg);
        let tilt = number("pitch").zip(number("roll"));
        let level = tilt.is_some_and(|(pitch, roll)| hypot(pitch, roll) < LEVEL_DEG);
        let score = if level {
            &mut self.level
        } else {
            &mut self.tilted
        };
        score.count(number("inst_heading"), truth_deg);

        let pause_s = if self.terminal {
            REWRITE_S
        } else {
            NEXT_LINE_S
        };
        if self.now_s < self.shown_s + pause_s {
            return String::new();
        }
        self.shown_s = self.now_s;
        let raw = raw.map_or(String::new(), |raw| format!(", raw {raw:5.1}°"));
        self.passing(&format!(
            "heading {heading_deg:5.1}°, truth {truth_deg:5.1}°{raw}, {}",
            self.state
        ))
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
                let step = if self.terminal { 0.0 } else { 0.25 };
                if changed {
                    self.shown_progress = 0.0;
                    let raw = self.raw_before;
                    return self.line(&format!(
                        "the board turns; up to now the raw heading was off by {raw}"
                    ));
                }
                if progress < self.shown_progress + step {
                    return String::new();
                }
                self.shown_progress = progress;
                let done = (progress * 20.0) as usize;
                self.passing(&format!(
                    "turning [{}{}] {:3.0} %",
                    "#".repeat(done.min(20)),
                    ".".repeat(20 - done.min(20)),
                    progress * 100.0
                ))
            }
            ("fault", _) => self.line(&format!("fault: {}", text(state, "message"))),
            _ => String::new(),
        }
    }

    fn calibration(&mut self, outcome: &Value) -> String {
        self.turns += 1;
        let first = !self.accepted;
        let verdict = text(outcome, "verdict");
        let mut shown = self.line(&match self.turns {
            1 => format!("full turn. The raw heading was off by {}", self.raw_before),
            turn => format!("full turn, number {turn}"),
        });
        let mut add = |line: &str| {
            // Writing to a String cannot fail.
            let _ = writeln!(shown, "{INDENT}{line}");
        };
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
            for line in found(outcome, &self.settings) {
                add(&line);
            }
            if first {
                add("from now on this calibration corrects the field");
            }
            self.accepted = true;
        }
        self.shown_s = self.now_s;
        shown
    }

    /// What comes last.
    pub(super) fn closing(&mut self) -> String {
        let mut shown = self.line(&format!(
            "the end. {} headings were published; they were off by",
            self.published.headings()
        ));
        for (what, score) in [
            ("published heading (fused)     ", &self.published),
            ("instantaneous, board level    ", &self.level),
            ("instantaneous, board tilted   ", &self.tilted),
            ("raw heading                   ", &self.raw_after),
        ] {
            // Writing to a String cannot fail.
            let _ = writeln!(shown, "{INDENT}{what}{score}");
        }
        let _ = writeln!(
            shown,
            "{INDENT}Level turns calibrate their plane alone, so that a tilt out of it costs the instantaneous\n\
             {INDENT}heading up to 3° a degree; the gyro carries the published one through.",
        );
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

    /// Ends a line that was to be rewritten.
    pub(super) fn end_of_line(&mut self) -> &'static str {
        if std::mem::take(&mut self.rewriting) {
            "\n"
        } else {
            ""
        }
    }

    /// A line that stays.
    fn line(&mut self, line: &str) -> String {
        let before = if std::mem::take(&mut self.rewriting) {
            "\r\x1b[K"
        } else {
            ""
        };
        format!("{before}{:6.1} s   {line}\n", self.now_s)
    }

    /// A line that the next one replaces, on a terminal.
    fn passing(&mut self, line: &str) -> String {
        if self.terminal {
            self.rewriting = true;
            format!("\r\x1b[K{:6.1} s   {line}", self.now_s)
        } else {
            self.line(line)
        }
    }
}

fn text<'a>(message: &'a Value, key: &str) -> &'a str {
    message[key].as_str().unwrap_or("unknown")
}

/// The parameters found beside the true ones, and how well they fit.
fn found(outcome: &Value, truth: &simulator::Settings) -> Vec<String> {
    let numbers = |value: &Value| -> Vec<f64> {
        let values = value.as_array().map(Vec::as_slice).unwrap_or_default();
        values.iter().filter_map(Value::as_f64).collect()
    };
    // Parameters lie along the axes of the turn's plane; without one, along the chip's.
    let axes: Vec<Vec<f64>> = match outcome["basis"].as_array() {
        Some(basis) => basis.iter().map(numbers).collect(),
        None => (0..3)
            .map(|axis| (0..3).map(|i| f64::from(u8::from(i == axis))).collect())
            .collect(),
    };
    let along = |axis: &[f64], weight: fn(f64) -> f64, values: [f64; 3]| -> f64 {
        axis.iter().zip(values).map(|(a, v)| weight(*a) * v).sum()
    };
    let scales: Vec<f64> = axes
        .iter()
        .map(|axis| along(axis, |a| a * a, truth.scale))
        .collect();
    // Without a reference field, the scale factors found have a mean of 1.
    let mean = scales.iter().sum::<f64>() / scales.len().max(1) as f64;
    let (bias, scale) = (numbers(&outcome["bias_mgauss"]), numbers(&outcome["scale"]));
    let mut lines = Vec::new();
    for (index, ((axis, bias), scale)) in axes.iter().zip(bias).zip(scale).enumerate() {
        let nearest =
            (0..3.min(axis.len())).max_by(|&i, &j| axis[i].abs().total_cmp(&axis[j].abs()));
        let name = nearest.map_or('?', |i| ['x', 'y', 'z'][i]);
        lines.push(format!(
            "axis {name}  bias {bias:7.2} mG (truth {:7.2}), scale {scale:.4} (truth {:.4})",
            along(axis, |a| a, truth.bias_mgauss),
            scales[index] / mean,
        ));
    }
    let quality: Vec<String> = [
        ("residual", "residual_mgauss", " mG"),
        ("predicted heading uncertainty", "heading_sd_deg", "°"),
        ("against the gyro", "gyro_rms_deg", "° RMS"),
    ]
    .iter()
    .filter_map(|(name, key, unit)| {
        outcome[*key]
            .as_f64()
            .map(|number| format!("{name} {number:.2}{unit}"))
    })
    .collect();
    lines.push(quality.join(", "));
    lines
}
