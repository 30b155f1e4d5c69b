//! `headingd watch`: prints headings as they come.

use std::io::{self, Write};

use serde_json::{Value, json};

use super::headings::{HeadingTarget, Headings};
use super::wording::{heading_text, reason_text};
use super::{Failure, number, output, text};

/// Headings as text are for people, who read one a second.
const TEXT_RATE_HZ: f64 = 1.0;

/// Print headings as they come, until stopped
///
/// As text: time, heading with its uncertainty (one standard deviation), and the condition. A line of its own says why
/// there is no heading, and what to do. --json prints the daemon's own objects, one a line: headings (ATT) and changes
/// of condition (STATE). --nmea prints NMEA 0183.
#[derive(Clone, Debug, Default, clap::Args)]
#[command(after_help = "Example: headingd watch --json | jq .mheading")]
pub struct Args {
    #[command(flatten)]
    pub target: HeadingTarget,
    /// Print JSON, an object a line
    #[arg(long, conflicts_with = "nmea")]
    pub json: bool,
    /// Print NMEA 0183
    #[arg(long)]
    pub nmea: bool,
    /// Headings a second at most, 0.1 to 1000. Without it: one as text, all as JSON, nmea.rate_hz as NMEA
    #[arg(long, value_name = "HZ", value_parser = number("a number", 0.1..=1000.0))]
    pub rate: Option<f64>,
    /// Stop after so many headings, 1 or more
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub count: Option<u64>,
}

impl Args {
    fn watch(&self) -> Value {
        let mut watch =
            json!({ "enable": true, "json": !self.nmea, "nmea": self.nmea, "state": !self.nmea });
        let text = !self.json && !self.nmea;
        if let Some(rate_hz) = self.rate.or(text.then_some(TEXT_RATE_HZ)) {
            watch["rate_hz"] = rate_hz.into();
        }
        watch
    }
}

pub fn run(args: &Args) -> Result<(), Failure> {
    let sockets = args.target.sockets()?;
    let mut headings = Headings::open(&sockets.headings, &args.watch().to_string())?;
    let mut out = io::stdout().lock();
    let mut printed = 0;
    let mut state = String::new();
    let is_enough = |printed| args.count.is_some_and(|most| printed >= most);
    while args.nmea || !is_enough(printed) {
        if args.nmea {
            let line = headings.line()?;
            if line.starts_with('$') {
                // HDM is the first sentence of each heading.
                let begins = line.get(3..6) == Some("HDM");
                if begins && is_enough(printed) {
                    break;
                }
                printed += u64::from(begins);
                output(writeln!(out, "{line}"))?;
            }
        } else {
            let object = headings.object()?;
            let class = text(&object, "class");
            let steerable = class == "ATT" && object["mheading"].as_f64().is_some();
            if args.json && (class == "ATT" || class == "STATE") {
                output(writeln!(out, "{}", headings.text()))?;
            } else if steerable {
                output(writeln!(out, "{}", line(&object)))?;
            } else if class == "STATE" {
                let why = why(&object);
                if why != state {
                    output(writeln!(out, "{why}"))?;
                    state = why;
                }
            }
            printed += u64::from(steerable);
        }
        output(out.flush())?;
    }
    Ok(())
}

fn line(att: &Value) -> String {
    let number = |key: &str| att[key].as_f64();
    let time = match (att["time"].as_str(), number("t_s")) {
        (Some(time), _) => time.to_owned(),
        (None, Some(t_s)) => format!("{t_s:10.3} s"),
        (None, None) => String::new(),
    };
    let heading = heading_text(number("heading"), number("mheading"), number("heading_sd"));
    format!(
        "{time}  {}  {}",
        heading.unwrap_or_default(),
        text(att, "cal_state")
    )
}

/// A condition as text: progress is none of it, so that it is printed once.
fn why(state: &Value) -> String {
    let [word, reason, message] = ["cal_state", "reason", "message"].map(|key| text(state, key));
    reason_text(word, reason, message)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_heading_is_true_where_that_is_known_and_has_its_time_and_uncertainty() {
        let att = json!({ "time": "2026-11-22T14:00:00.125Z", "t_s": 3.0, "heading": 7.04, "mheading": 350.1,
                          "heading_sd": 0.83, "cal_state": "good" });
        assert_eq!(
            line(&att),
            "2026-11-22T14:00:00.125Z  007.0° true ± 0.8°  good"
        );
        let att = json!({ "t_s": 3.0, "mheading": 350.1, "cal_state": "degraded" });
        assert_eq!(line(&att), "     3.000 s  350.1° magnetic  degraded");
    }
}
