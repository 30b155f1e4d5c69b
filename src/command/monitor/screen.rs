//! The screen as a whole: made for 80 columns and 24 lines. On a smaller one the panel takes all, its heading first.

use std::time::Instant;

use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect, Size};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Paragraph, Wrap};
use serde_json::Value;

use super::super::text;
use super::super::wording::{bar, heading_text, span};
use super::palette::Palette;
use super::rose::Rose;
use super::scatter::scatter;
use super::view::View;
use crate::advice::next_step;
use crate::calibration::model::Mode;
use crate::calibration::policy::Policy;
use crate::frame::{rounded, to_tenths};
use crate::publish::control::status::{CalibrationSummary, DaemonStatus};

const KEYS: &str = "c calibrate  x cancel  l lock/unlock  r roll back  v level  q quit";

/// Width of what a line of the panel begins with.
const NAME: usize = 12;

/// A panel of fewer columns has no room for that.
const NARROW: u16 = 40;

/// Rose and planes of the field are drawn from this size on.
const LEAST: Size = Size {
    width: 64,
    height: 21,
};

pub(super) fn draw(view: &View, style: &Palette, now: Instant, frame: &mut Frame) {
    let area = frame.area();
    let is_small = area.width < LEAST.width || area.height < LEAST.height;
    let width = usize::from(area.width);
    let said = last_line(view, width, is_small);
    // An answer of the daemon may be longer than the screen is wide, and a wrapped line is not quite full.
    let said_lines = said.chars().count().div_ceil((9 * width / 10).max(1));
    // Two lines are for heading and state.
    let said_lines = (said_lines as u16).min(area.height.saturating_sub(2));
    let [above, last] =
        Layout::vertical([Constraint::Min(0), Constraint::Length(said_lines)]).areas(area);
    let said = Paragraph::new(said).wrap(Wrap { trim: true });
    frame.render_widget(said.style(style.strong()), last);
    if is_small {
        return draw_panel_alone(view, style, now, above, frame);
    }
    let [title, top, bottom] = Layout::vertical([
        Constraint::Length(1),
        Constraint::Length(14),
        Constraint::Min(5),
    ])
    .areas(above);
    let [left, right] =
        Layout::horizontal([Constraint::Length(28), Constraint::Min(20)]).areas(top);
    let source = view.answered().map_or(String::new(), |status| {
        let (sensor, source) = (&status.sensor, &status.source);
        let (clients, up) = (status.clients, span(status.uptime_s));
        format!("{sensor} on {source}, clients {clients}, up {up}")
    });
    frame.render_widget(
        Line::from(format!("{}  {source}", view.socket)).style(style.strong()),
        title,
    );
    let att = view.att(now);
    let heading_deg = att["heading"].as_f64().or(att["mheading"].as_f64());
    let rose = Rose {
        heading: heading_deg.map(|degrees| (degrees, att["heading_sd"].as_f64())),
        raw_deg: att["raw_heading"].as_f64(),
        directions: &view.directions,
        style: *style,
    };
    let inside = Rect {
        width: left.width.saturating_sub(2),
        ..left
    };
    frame.render_widget(rose, inside);
    let lines = panel(view, style, att, now, NAME);
    frame.render_widget(Paragraph::new(lines).wrap(Wrap { trim: false }), right);
    scatters(view, style, bottom, frame);
}

/// Heading and state first, and what else there is room for.
fn draw_panel_alone(view: &View, style: &Palette, now: Instant, area: Rect, frame: &mut Frame) {
    let is_narrow = area.width < NARROW;
    let mut att = view.att(now).clone();
    // The heading takes one line.
    if let Some(att) = att.as_object_mut() {
        att.remove("raw_heading");
        if is_narrow {
            att.remove("heading_sd");
        }
    }
    let name = if is_narrow { 0 } else { NAME };
    let lines = panel(view, style, &att, now, name);
    frame.render_widget(Paragraph::new(lines).wrap(Wrap { trim: false }), area);
}

/// A question, or what the last key has led to, or the keys, for which a small screen has no room.
fn last_line(view: &View, width: usize, is_small: bool) -> String {
    const REMINDER: &str = "   (c x l r v q)";
    match &view.asking {
        Some((question, _)) => format!("{question} y: yes, any other key: no"),
        None if view.said.is_empty() && is_small => String::new(),
        None if view.said.is_empty() => KEYS.to_owned(),
        None if view.said.chars().count() + REMINDER.len() > width => view.said.clone(),
        None => format!("{}{REMINDER}", view.said),
    }
}

/// The lines of the panel. The names before them are `width` wide; with 0, heading and state have none.
fn panel<'a>(
    view: &'a View,
    style: &Palette,
    att: &'a Value,
    now: Instant,
    width: usize,
) -> Vec<Line<'a>> {
    let mut lines = Vec::new();
    let [true_deg, magnetic_deg, sd_deg] =
        ["heading", "mheading", "heading_sd"].map(|key| att[key].as_f64());
    let none = if width > 0 { "none" } else { "no heading" };
    let shown = heading_text(true_deg, magnetic_deg, sd_deg).unwrap_or(none.to_owned());
    let raw = att["raw_heading"].as_f64();
    let raw = raw.map_or(String::new(), |raw| {
        format!("   (raw {:05.1}°)", to_tenths(raw))
    });
    lines.push(Line::from(vec![
        Span::from(first_name("heading", width)),
        Span::styled(shown, style.strong()),
        Span::styled(raw, style.raw()),
    ]));
    state(view, style, width, &mut lines);
    let mut add = |name: &str, value: String| {
        lines.push(Line::from(named(name, width, &value)));
    };
    let status = view.answered();
    add("field", field(att, status));
    let [which, quality] = calibration(status.and_then(|status| status.calibration.as_ref()));
    add("calibration", which);
    if !quality.is_empty() {
        add("", quality);
    }
    if let Some(verdict) = view.outcome["verdict"].as_str() {
        let reason = text(&view.outcome, "reason");
        add("last", format!("{verdict} ({reason})"));
    }
    let hz = |rate: Option<f64>| rate.map_or("-".to_owned(), |rate| format!("{rate:.0}"));
    add(
        "rates",
        format!(
            "field {}, gyro {}, headings {} a second",
            hz(view.field_hz.hz(now)),
            hz(view.gyro_hz.hz(now)),
            hz(view.headings_hz.hz(now))
        ),
    );
    match &view.status {
        None => {}
        Some(Err(why)) => add("control", why.clone()),
        Some(Ok(status)) => {
            let (faults, dropped) = (status.counts.faults, status.counts.values_dropped);
            add(
                "errors",
                format!("faults {faults}, dropped {dropped}, missed {}", view.missed),
            );
        }
    }
    lines
}

/// What a line begins with that needs no name where there is no room.
fn first_name(name: &str, width: usize) -> String {
    match width {
        0 => String::new(),
        _ => format!("{name:width$}"),
    }
}

/// A line with its name.
fn named(name: &str, width: usize, value: &str) -> String {
    match (width, name) {
        (0, "") => value.to_owned(),
        (0, _) => format!("{name} {value}"),
        _ => format!("{name:width$}{value}"),
    }
}

/// The condition, why, what to do, and how far that is.
fn state<'a>(view: &'a View, style: &Palette, width: usize, lines: &mut Vec<Line<'a>>) {
    if let Some(why) = &view.lost {
        lines.push(Line::from(vec![
            Span::from(first_name("state", width)),
            Span::styled(" lost ", style.badge("lost")),
        ]));
        lines.push(Line::from(why.as_str()));
        return;
    }
    let [word, reason, message] =
        ["cal_state", "reason", "message"].map(|key| text(&view.state, key));
    let status = view.answered();
    let reason_alone = Some(reason.to_owned()).filter(|_| reason != word);
    let mode = status.filter(|status| status.policy != Policy::On);
    let mode = mode.map(|status| format!("mode {}", status.policy.word()));
    let armed = status.filter(|status| status.armed);
    let armed = armed.map(|_| "calibrates on the next turn".to_owned());
    let more: Vec<String> = [reason_alone, mode, armed].into_iter().flatten().collect();
    lines.push(Line::from(vec![
        Span::from(first_name("state", width)),
        Span::styled(format!(" {word} "), style.badge(word)),
        Span::from(format!(" {}", more.join(", "))),
    ]));
    lines.push(Line::from(message));
    if let Some(advice) = next_step(reason) {
        lines.push(Line::styled(format!("-> {advice}"), style.strong()));
    }
    // While a heading is published, a turn goes on beside it.
    let turned = status
        .and_then(|status| status.progress)
        .filter(|share| *share > 0.0);
    if let Some(share) = view.state["progress"].as_f64().or(turned) {
        let progress = format!("{} {:3.0} %", bar(share), 100.0 * share);
        lines.push(Line::from(named("progress", width, &progress)));
        let missing = view.directions.missing();
        if !missing.is_empty() {
            lines.push(Line::from(named("missing", width, &missing)));
        }
    }
}

/// Strength and dip of the corrected field, against what they should be where that is known.
fn field(att: &Value, status: Option<&DaemonStatus>) -> String {
    let Some(strength) = att["mag_len"].as_f64() else {
        return "not known yet".to_owned();
    };
    let active = status.and_then(|status| status.active.as_ref());
    // A planar calibration has the strength in its plane alone.
    let spatial = att["mag_z"].is_number();
    let comparable = active.filter(|active| (active.mode == Some(Mode::Spatial)) == spatial);
    let expected = comparable.map(|active| active.strength_mgauss);
    let mut out = match expected.filter(|expected| *expected > 0.0) {
        Some(expected) => {
            let off = rounded(100.0 * (strength / expected - 1.0), 0);
            format!("{strength:.0} of {expected:.0} mG ({off:+.0} %)")
        }
        None => format!("{strength:.0} mG"),
    };
    if let Some(dip) = att["dip"].as_f64() {
        out += &format!(", dip {dip:.1}°");
        if let Some(here) = status.and_then(|status| status.reference.as_ref()) {
            out += &format!(" of {:.1}°", here.dip_deg);
        }
    }
    out
}

/// Which calibration it is, and how good.
fn calibration(found: Option<&CalibrationSummary>) -> [String; 2] {
    let Some(found) = found else {
        return ["none".to_owned(), String::new()];
    };
    let mode = found.mode.map(Mode::word).unwrap_or_default();
    let method = found.method.as_deref().unwrap_or_default();
    let mut which = format!("{}, {mode} by {method}", found.number);
    if let Some(age_s) = found.age_s {
        which += &format!(", {} old", span(age_s));
    }
    let known = [
        ("residual", found.residual_mgauss, " mG"),
        (found.deviation_label(), found.heading_sd_deg, "°"),
        ("gyro", found.gyro_rms_deg, "°"),
    ];
    let parts = known.iter().filter_map(|(name, value, unit)| {
        let value = (*value)?;
        Some(format!("{name} {value:.1}{unit}"))
    });
    [which, parts.collect::<Vec<_>>().join(", ")]
}

fn scatters(view: &View, style: &Palette, area: Rect, frame: &mut Frame) {
    let thirds = Layout::horizontal([Constraint::Ratio(1, 3); 3]).areas::<3>(area);
    let planes = [
        ([0, 1], "XY", ". raw"),
        (
            [0, 2],
            "XZ",
            if style.unicode {
                "⠿ corrected"
            } else {
                "o corrected"
            },
        ),
        ([1, 2], "YZ", ""),
    ];
    for ((axes, name, legend), area) in planes.into_iter().zip(thirds) {
        let reach_mgauss = view.reach_mgauss(axes);
        let title = format!("{name} ±{reach_mgauss:.0} mG {legend}");
        let block = Block::bordered().title(title);
        let block = if style.unicode {
            block
        } else {
            block.border_set(ASCII)
        };
        let inside = block.inner(area);
        frame.render_widget(block.border_style(style.faint()), area);
        let trails = [&view.raw, &view.corrected];
        frame.render_widget(scatter(axes, reach_mgauss, trails, *style, inside), inside);
    }
}

/// A border for terminals that know no others.
const ASCII: ratatui::symbols::border::Set = ratatui::symbols::border::Set {
    top_left: "+",
    top_right: "+",
    bottom_left: "+",
    bottom_right: "+",
    vertical_left: "|",
    vertical_right: "|",
    horizontal_top: "-",
    horizontal_bottom: "-",
};
