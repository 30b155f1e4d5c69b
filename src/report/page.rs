//! The page: text, tables and figures in one file, light or dark as the reader has it.

use super::analysis::{Analysis, Findings, Judged, Point};
use super::html::{escaped, verdict};
use super::turn::Turned;
use super::{deviation, field, swarm, timeline};
use crate::advice::next_step;
use crate::calibration::model::Mode;
use crate::calibration::outcome::SwarmReport;
use crate::calibration::settings::StopChoice;
use crate::calibration::verdict::{Limit, measured};
use crate::frame::to_tenths;

/// Verdicts listed on the page, the newest first, and warnings, the oldest first.
const LISTED: usize = 50;

const STYLE: &str = include_str!("style.css");
const NO_TURN: &str = "<h2>Calibration by a full turn</h2>\n\
                       <p>No full turn has calibrated the board.</p>\n";

pub fn page(analysis: &Analysis) -> String {
    let found = &analysis.found;
    let mut out = String::with_capacity(1 << 18);
    let title = format!("headingd: {}", escaped(&analysis.source));
    out += "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">";
    out += "<meta name=\"viewport\" content=\"width=device-width\">";
    out += &format!("<title>{title}</title><style>{STYLE}</style></head><body><main>\n");
    out += &format!("<h1>{title}</h1>\n");
    out += &summary(analysis);
    out += "<h2>Headings</h2>\n";
    let bands = "Bands: <b class=good>good</b>, <b class=middling>degraded or disturbed</b>, \
                 <b class=quiet>not calibrated yet</b>, <b class=bad>stale or fault</b>.";
    let from_true_north = match found.declination_deg {
        Some(_) => "; <b class=other>true</b>: published, and the declination added",
        None => "",
    };
    out += &figure(
        &timeline::headings(found),
        &format!(
            "Magnetic heading: <b class=raw>raw</b>, and <b class=corrected>published</b>{from_true_north}. {bands}"
        ),
    );
    out += &figure(
        &timeline::uncertainty(found),
        "Uncertainty of the published heading, one standard deviation.",
    );
    out += &conditions(found);
    match &found.turn {
        Some(judged) => out += &turn(judged),
        None => out += NO_TURN,
    }
    out += &motion(analysis);
    out += &verdicts(found);
    out += &format!(
        "<footer>headingd {}</footer>\n</main></body></html>\n",
        env!("CARGO_PKG_VERSION")
    );
    out
}

/// What comes first: how it ended.
fn summary(analysis: &Analysis) -> String {
    let found = &analysis.found;
    let first_s = found.first_s.unwrap_or(0.0);
    let mut rows = vec![
        ("magnetometer", analysis.header.sensor_name().to_owned()),
        (
            "length",
            format!(
                "{:.1} s, {} readings, {} headings published",
                found.now_s - first_s,
                found.readings,
                found.headings
            ),
        ),
        ("full turns", found.turns.to_string()),
    ];
    if let Some(from) = analysis.header.recorded_from() {
        rows.insert(1, ("recorded from", from.to_owned()));
    }
    if analysis.dropped() > 0 {
        rows.push((
            "values dropped",
            format!("{}, which no sensor can have taken", analysis.dropped()),
        ));
    }
    if let Some(newest) = &found.newest {
        rows.push(("last heading", heading(newest)));
    }
    if let Some(declination_deg) = found.declination_deg {
        let side = if declination_deg < 0.0 {
            "west"
        } else {
            "east"
        };
        let text = format!(
            "{:.1}°, magnetic north is {side} of true north",
            declination_deg.abs()
        );
        rows.push(("declination", text));
    }
    for warning in found.warnings.iter().take(LISTED) {
        rows.push(("warning", warning.clone()));
    }
    let more = found.warnings.len().saturating_sub(LISTED);
    if more > 0 {
        rows.push(("warnings", format!("{more} more")));
    }
    if let Some(last) = &found.last {
        rows.push((
            "at the end",
            format!(
                "{} ({}): {}",
                last.condition.word(),
                last.reason,
                last.message
            ),
        ));
        if let Some(advice) = next_step(last.reason) {
            rows.push(("what to do", advice.to_owned()));
        }
    }
    if let Some(calibration) = analysis.calibration() {
        rows.push((
            "calibration",
            format!(
                "{} by {}, residual {:.1} mG, headings certain to {:.2}°",
                calibration.parameters.mode().word(),
                calibration.method(),
                calibration.residual_mgauss,
                calibration.heading_sd_deg
            ),
        ));
    }
    let cells = rows
        .iter()
        .map(|(name, value)| format!("<tr><th>{name}</th><td>{}</td></tr>\n", escaped(value)));
    format!("<table>\n{}</table>\n", cells.collect::<String>())
}

fn heading(point: &Point) -> String {
    let known = |degrees: Option<f64>, of| {
        degrees.map(|degrees| format!("{:05.1}° {of}", to_tenths(degrees)))
    };
    let both = [
        known(point.heading_deg, "magnetic"),
        known(point.true_deg, "true"),
    ];
    let uncertain = point.sd_deg.map(|sd_deg| format!(" ± {sd_deg:.1}°"));
    let both = both.into_iter().flatten().collect::<Vec<_>>().join(", ");
    both + &uncertain.unwrap_or_default()
}

/// The changes of condition as a table.
fn conditions(found: &Findings) -> String {
    let mut out = String::from(
        "<details><summary>Conditions</summary><table>\n<tr><th>from, s</th><th>condition</th><th>reason</th><th>message</th></tr>\n",
    );
    for report in &found.changes {
        out += &format!(
            "<tr><td>{:.1}</td><td>{}</td><td>{}</td><td>{}</td></tr>\n",
            report.t_s.max(found.first_s.unwrap_or(0.0)),
            report.condition.word(),
            report.reason,
            escaped(&report.message)
        );
    }
    out + "</table></details>\n"
}

/// Everything about the turn that was judged.
fn turn(judged: &Judged) -> String {
    let outcome = &judged.outcome;
    let mut out = verdict("Calibration by a full turn", outcome);
    if let Some(measures) = &outcome.measures {
        out += &limits(&measured(measures, &judged.request.limits));
    }
    let Some(turned) = Turned::of(judged) else {
        out += "<p>Nothing was fitted, so that there is nothing to draw.</p>\n";
        return out;
    };
    let is_rejected = judged.is_rejected();
    if is_rejected {
        out += "<p>Below, the field is corrected by the turn's own fit, which was rejected: no heading is.</p>\n";
    }
    out += &figure(
        &field::circles(&turned),
        "Field of the turn: <b class=raw>raw</b>, and <b class=corrected>corrected</b>, on a circle about the origin of the corrected field's mean strength.",
    );
    let what = match outcome.mode {
        Some(Mode::Planar) => "in the plane of the turn",
        _ => "in space",
    };
    out += &figure(
        &field::strength(&turned),
        &format!(
            "Strength of the field {what}: <b class=raw>raw</b>, and <b class=corrected>corrected</b>."
        ),
    );
    out += &figure(
        &field::window(judged),
        "Raw field along the chip's axes <b class=raw>X</b>, <b class=corrected>Y</b> and <b class=other>Z</b>, and the <b class=good>windows</b> that RIST chose for the swarm.",
    );
    out += &swarms(judged);
    let held = deviation::held(&turned);
    if held.is_empty() {
        out += "<p>The gyro did not follow the turn, so that there is nothing to hold the field against.</p>\n";
        return out;
    }
    out += &figure(
        &deviation::against_gyro(&held),
        "Corrected heading less the heading by the gyro.",
    );
    out += &figure(
        &deviation::by_heading(&held),
        "Deviation by heading: <b class=raw>before</b>, and <b class=corrected>after</b>.",
    );
    let after = if is_rejected {
        "after, by the rejected fit"
    } else {
        "after"
    };
    out += &card(&held, after);
    out
}

/// What motion has taught where no full turn has calibrated.
fn motion(analysis: &Analysis) -> String {
    let Some((outcome, held_to)) = analysis.motion() else {
        return String::new();
    };
    verdict("Calibration by motion", &outcome) + &limits(&held_to)
}

fn swarms(judged: &Judged) -> String {
    let samples = &judged.outcome.samples;
    let [basic, mpsot] = [StopChoice::Basic, StopChoice::Mpsot].map(|stop| swarm::of(judged, stop));
    let iterations = |swarm: &Option<SwarmReport>| match swarm {
        Some(swarm) => swarm.iterations.to_string(),
        None => "none".to_owned(),
    };
    let mut out = figure(
        &swarm::fitness(basic.as_ref(), mpsot.as_ref()),
        &format!(
            "Fitness of the global best of the paper's swarm by iteration: <b class=raw>basic</b>, {} iterations, and stopped by <b class=corrected>MPSOT</b>, {}.",
            iterations(&basic),
            iterations(&mpsot)
        ),
    );
    let most = samples.total.max(1) as f64;
    out += "<table><tr><th>samples</th><th></th><th></th></tr>\n";
    for (name, count) in [
        ("all", samples.total),
        ("turn", samples.turn),
        ("RIST's windows", samples.window),
    ] {
        out += &format!(
            "<tr><th>{name}</th><td>{count}</td><td><meter value={:.4}></meter></td></tr>\n",
            count as f64 / most
        );
    }
    out + "</table>\n"
}

fn limits(limits: &[Limit]) -> String {
    let mut out = String::from(
        "<table><tr><th>limit</th><th>measured</th><th></th><th>limit</th><th></th></tr>\n",
    );
    for limit in limits {
        let [measured, relation, bound] = limit.as_text();
        let (class, word) = if limit.is_kept() {
            ("good", "kept")
        } else {
            ("bad", "broken")
        };
        out += &format!(
            "<tr><th>{}</th><td>{measured}</td><td>{relation}</td><td>{bound}</td><td><b class={class}>{word}</b></td></tr>\n",
            limit.name
        );
    }
    out + "</table>\n"
}

fn card(held: &[deviation::Held], after_name: &str) -> String {
    let mut rows = [String::new(), String::new(), String::new()];
    for (heading_deg, deviations) in deviation::card(held) {
        rows[0] += &format!("<th>{heading_deg:03.0}°</th>");
        let [before, after] = match deviations {
            Some((before, after)) => [before, after].map(|deviation| format!("{deviation:+.1}")),
            None => [String::new(), String::new()],
        };
        rows[1] += &format!("<td>{before}</td>");
        rows[2] += &format!("<td>{after}</td>");
    }
    let [head, before, after] = rows;
    format!(
        "<table class=card><caption>Deviation card, degrees</caption><tr><th>heading</th>{head}</tr>\n\
         <tr><th>before</th>{before}</tr>\n<tr><th>{after_name}</th>{after}</tr></table>\n"
    )
}

fn verdicts(found: &Findings) -> String {
    if found.verdicts.is_empty() {
        return String::new();
    }
    let mut out = String::from(
        "<h2>All verdicts, newest first</h2>\n<table><tr><th>at, s</th><th>by</th><th>verdict</th><th>reason</th><th></th></tr>\n",
    );
    for (t_s, outcome) in found.verdicts.iter().rev().take(LISTED) {
        out += &format!(
            "<tr><td>{t_s:.1}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td></tr>\n",
            outcome.method,
            outcome.verdict.word(),
            outcome.reason,
            escaped(&outcome.message)
        );
    }
    out + "</table>\n"
}

fn figure(svg: &str, caption: &str) -> String {
    format!("<figure>{svg}<figcaption>{caption}</figcaption></figure>\n")
}
