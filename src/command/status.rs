//! `headingd status`: how the running daemon does.

use super::calibration::line;
use super::control::{self, ControlTarget};
use super::wording::{heading_text, plain_text, reason_text, span};
use super::{Failure, print, print_json};
use crate::publish::control::ControlRequest;
use crate::publish::control::status::{DaemonStatus, FolderSummary};

/// Show how the running daemon does
///
/// The heading with its uncertainty (one standard deviation), the same word and reason as on the heading socket, the
/// active calibration, what the last turn or motion has come to, and whether calibrations and raw readings are kept.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Example: headingd status --json")]
pub struct Args {
    #[command(flatten)]
    pub target: ControlTarget,
    /// Print the daemon's answer, one JSON object; a refusal too
    #[arg(long)]
    pub json: bool,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    let answer = args.target.ask(&ControlRequest::Status {}, args.json)?;
    if args.json {
        print_json(&answer)
    } else {
        print(&written(&control::read(answer)?))
    }
}

fn written(status: &DaemonStatus) -> String {
    let [word, reason] =
        [&status.cal_state, &status.reason].map(|text| text.as_deref().unwrap_or("starting"));
    let mut out = heading(status);
    out += &(reason_text(word, reason, &status.message) + "\n");
    let mut add = |name: &str, value: String| out += &format!("{name:<12} {value}\n");
    let mut active = "none active".to_owned();
    if let Some(calibration) = &status.calibration {
        active = line(calibration);
        if let Some(age_s) = calibration.age_s {
            active += &format!(", {} old", span(age_s));
        }
    }
    add("calibration", active);
    if let Some(last) = &status.last {
        // Nothing needs to be done about a refusal while headings are good.
        let said = if word == "good" {
            plain_text
        } else {
            reason_text
        };
        add("last", said(&last.verdict, &last.reason, &last.message));
    }
    let mut mode = status.policy.word().to_owned();
    if status.armed {
        mode += "; the next turn calibrates";
    }
    if status.calibrating {
        mode += "; a calibration is under way";
    }
    add("mode", mode);
    if let Some(progress) = status.progress.filter(|&p| p > 0.0) {
        add("turn", format!("{:.0} %", 100.0 * progress));
    }
    let (source, sensor, axes) = (&status.source, &status.sensor, &status.mag_axes);
    add("source", format!("{source}, {sensor} mounted {axes}"));
    let text = |text: &Option<String>| text.clone().unwrap_or_default();
    let kept = |folder: &FolderSummary| match folder.state.as_str() {
        "good" => Some(format!("good, in {}", text(&folder.directory))),
        "failing" => Some(format!("failing: {}", text(&folder.message))),
        _ => None,
    };
    let lost = || "off: calibrations are lost when the daemon stops".to_owned();
    add("store", kept(&status.store).unwrap_or_else(lost));
    if let Some(recording) = kept(&status.record) {
        add("recording", recording);
    }
    add(
        "up",
        format!("{}, clients {}", span(status.uptime_s), status.clients),
    );
    out
}

fn heading(status: &DaemonStatus) -> String {
    match heading_text(status.heading, status.mheading, status.heading_sd) {
        Some(heading) => format!("heading {heading}\n"),
        None => "no heading\n".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn every_trouble_is_shown() {
        let read = |status| control::read::<DaemonStatus>(status).unwrap();
        let text = written(&read(json!({
            "heading": 7.26, "mheading": 350.0, "heading_sd": 4.04,
            "message": "none speaks", "cal_state": "degraded", "reason": "no_gyro", "mode": "off", "armed": true,
            "calibrating": true, "progress": 0.42, "source": "/dev/i2c-1", "sensor": "hmc5843",
            "mag_axes": "+x +y +z", "uptime_s": 61, "clients": 2,
            "store": { "state": "failing", "directory": "/a", "message": "no room" },
            "record": { "state": "failing", "directory": "/b", "message": "no folder" },
            "calibration": { "number": 3, "mode": "planar", "age_s": 60, "residual_mgauss": 2.04 },
            "last": { "verdict": "rejected", "reason": "jump", "message": "the field jumps" }
        })));
        assert!(
            text.starts_with("heading 007.3° true ± 4.0°\ndegraded (no_gyro): none speaks\nwhat to do: check the gyro"),
            "{text}"
        );
        let good = read(json!({
            "cal_state": "good", "reason": "good", "message": "as expected",
            "last": { "verdict": "rejected", "reason": "no_fit", "message": "no ellipse" }
        }));
        let text_of_good = written(&good);
        assert!(text_of_good.contains("rejected (no_fit): no ellipse\n"));
        assert!(!text_of_good.contains("what to do"), "{text_of_good}");
        assert_eq!(
            heading(&read(json!({ "mheading": 359.97 }))),
            "heading 000.0° magnetic\n"
        );
        assert_eq!(heading(&DaemonStatus::default()), "no heading\n");
        for part in [
            "off; the next turn calibrates; a calibration is under way\n",
            "42 %",
            "store        failing: no room\nrecording    failing: no folder\n",
            "residual 2.0 mG, 1 min 0 s old\nlast         rejected (jump): the field jumps\n",
            "/dev/i2c-1, hmc5843 mounted +x +y +z\n",
            "1 min 1 s, clients 2\n",
        ] {
            assert!(text.contains(part), "{part} is not in {text}");
        }
    }
}
