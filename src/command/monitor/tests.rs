//! The screen, drawn into a buffer.

use std::time::{Duration, Instant};

use ratatui::Terminal;
use ratatui::backend::TestBackend;
use ratatui::style::Color;
use serde_json::{Value, json};

use super::feeds::News;
use super::palette::Palette;
use super::screen;
use super::view::View;
use crate::publish::control::ControlRequest;

const PLAIN: Palette = Palette {
    colour: false,
    unicode: true,
};

/// The screen's lines.
fn lines(terminal: &Terminal<TestBackend>) -> Vec<String> {
    let buffer = terminal.backend().buffer();
    let width = usize::from(buffer.area.width);
    let cells: Vec<&str> = buffer.content.iter().map(|cell| cell.symbol()).collect();
    cells.chunks(width).map(|row| row.concat()).collect()
}

fn drawn(
    view: &View,
    style: &Palette,
    now: Instant,
    width: u16,
    height: u16,
) -> Terminal<TestBackend> {
    let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
    terminal
        .draw(|frame| screen::draw(view, style, now, frame))
        .unwrap();
    terminal
}

fn fed(objects: &[Value], now: Instant) -> View {
    let mut view = View::new("/run/headingd/heading.sock".into());
    for object in objects {
        view.take(News::Object(object.clone()), now);
    }
    view
}

/// A board that turns, from east through south, uncalibrated.
fn turning() -> Vec<Value> {
    let mut objects = vec![
        json!({"class": "BOARD", "header": "# headingd-log 1\n# mag_axes = +x -y -z\nt_s,mx,my,mz\n"}),
        json!({"class": "STATE", "cal_state": "turning", "reason": "turning", "message": "25 % of a full turn", "progress": 0.25}),
    ];
    for i in 0..=90 {
        let angle = f64::from(i).to_radians();
        let t_s = 0.025 * f64::from(i);
        objects.push(json!({"class": "READING", "seq": i + 1, "t_s": t_s,
                            "mx": 200.0 + 160.0 * angle.cos(), "my": 160.0 * angle.sin(), "mz": -500.0}));
        objects.push(
            json!({"class": "ATT", "t_s": t_s, "seq": i + 1, "raw_heading": 90.0, "rot": 2400.0,
                            "cal_state": "turning", "mag_st": "C"}),
        );
    }
    objects
}

#[test]
fn a_turning_board_shows_how_far_it_is_and_what_is_missing() {
    let now = Instant::now();
    let view = fed(&turning(), now);
    let screen = lines(&drawn(&view, &PLAIN, now, 80, 24));
    let all = screen.join("\n");
    for part in [
        "heading     none   (raw 090.0°)",
        "state        turning",
        "progress    [#####...............]  25 %",
        // Shown by the gyro from east on: the raw heading stands still.
        "missing     SSW to ENE",
        "field 40",
        "XY ±400 mG . raw",
        "XZ ±500 mG",
        "c calibrate",
    ] {
        assert!(all.contains(part), "{part} is not in\n{all}");
    }
    assert_eq!(screen.len(), 24);
    // Body axes: Z is turned over, so that the field points down, and is drawn above the middle of XZ.
    let raw: Vec<usize> = (16..22)
        .filter(|row| screen[*row].chars().skip(28).take(24).any(|c| c == '.'))
        .collect();
    assert!(!raw.is_empty() && raw.iter().all(|row| *row < 19), "{all}");
}

#[test]
fn the_field_is_drawn_in_the_axes_of_the_vehicle() {
    let now = Instant::now();
    let mut view = fed(&turning(), now);
    let att = json!({"class": "ATT", "mag_x": 160.0, "mag_y": 0.0, "mag_z": 500.0});
    view.take(News::Object(att), now);
    assert!(!view.corrected.is_empty() && view.directions.missing() != "all");
    let down = |view: &View| view.raw.iter().all(|field| field[2] > 0.0);
    assert!(!view.raw.is_empty() && down(&view));
    let status = serde_json::from_value(json!({"board_axes": "+x -y -z"})).unwrap();
    view.take(News::Status(Ok(Box::new(status))), now);
    assert!(view.raw.is_empty() && view.corrected.is_empty());
    assert_eq!(view.directions.missing(), "all");
    for object in turning() {
        view.take(News::Object(object), now);
    }
    assert!(!view.raw.is_empty() && !view.raw.iter().any(|field| field[2] > 0.0));
}

#[test]
fn a_good_board_shows_its_heading_field_and_calibration() {
    let now = Instant::now();
    let mut view = fed(
        &[
            json!({"class": "STATE", "cal_state": "good", "reason": "good", "message": "the field is as the estimate expects it"}),
            json!({"class": "CALIBRATION", "verdict": "rejected", "reason": "coverage", "method": "turn", "message": "a quarter is missing"}),
            json!({"class": "ATT", "t_s": 1.0, "seq": 1, "heading": 271.3, "mheading": 258.0, "heading_sd": 0.83,
                   "raw_heading": 240.0, "mag_x": 10.0, "mag_y": 160.0, "mag_z": 500.0, "mag_len": 525.1, "dip": 72.31,
                   "cal_state": "good", "mag_st": "N"}),
        ],
        now,
    );
    let status = json!({
        "ok": true, "mode": "locked", "source": "/dev/i2c-1", "sensor": "hmc5843", "clients": 2, "uptime_s": 3700,
        "calibration": {"number": 4, "mode": "planar", "method": "turn", "age_s": 120, "residual_mgauss": 1.94,
                        "heading_sd_deg": 0.08, "gyro_rms_deg": 0.77},
        "active": {"mode": "spatial", "strength_mgauss": 520.0},
        "reference": {"dip_deg": 72.9, "strength_mgauss": 551.0},
        "counts": {"faults": 1, "values_dropped": 3}
    });
    view.take(
        News::Status(Ok(Box::new(serde_json::from_value(status).unwrap()))),
        now,
    );
    let terminal = drawn(&view, &PLAIN, now, 80, 24);
    let all = lines(&terminal).join("\n");
    for part in [
        "hmc5843 on /dev/i2c-1",
        "heading     271.3° true ± 0.8°   (raw 240.0°)",
        "state        good  mode locked",
        "field       525 of 520 mG (+1 %), dip 72.3° of 72.9°",
        "calibration 4, planar by turn, 2 min 0 s old",
        "            residual 1.9 mG, fit 0.1°, gyro 0.8°",
        "last        rejected (coverage)",
        "errors      faults 1, dropped 3, missed 0",
        "clients 2, up 1 h 1 min",
    ] {
        assert!(all.contains(part), "{part} is not in\n{all}");
    }
    // The needle points west, the raw one does not reach as far.
    assert!(
        all.lines()
            .any(|line| line.trim_start().starts_with("=") && line.contains("####")),
        "{all}"
    );
    // No colour is none.
    let colourless = terminal
        .backend()
        .buffer()
        .content
        .iter()
        .all(|cell| (cell.fg, cell.bg) == (Color::Reset, Color::Reset));
    assert!(colourless);
    // What is no longer fresh is not shown as if it were.
    let later = now + Duration::from_secs(3);
    let all = lines(&drawn(&view, &PLAIN, later, 80, 24)).join("\n");
    assert!(
        all.contains("heading     none") && !all.contains("271.3"),
        "{all}"
    );
}

#[test]
fn an_answer_longer_than_the_screen_is_wide_is_shown_whole() {
    let now = Instant::now();
    let mut view = fed(
        &[json!({"class": "ATT", "t_s": 1.0, "seq": 1, "mag_z": 500.0, "mag_len": 519.9})],
        now,
    );
    let status = json!({"ok": true, "active": {"mode": "spatial", "strength_mgauss": 520.0}});
    let status = Box::new(serde_json::from_value(status).unwrap());
    view.take(News::Status(Ok(status)), now);
    view.take(News::Answer("given up".to_owned()), now);
    let screen = lines(&drawn(&view, &PLAIN, now, 80, 24));
    assert_eq!(screen[23].trim(), "given up   (c x l r v q)");
    assert!(screen.join("\n").contains("520 of 520 mG (+0 %)"));
    let answer = "turn the board once all the way round, level and away from iron: that turn calibrates the compass";
    view.take(News::Answer(answer.to_owned()), now);
    let screen = lines(&drawn(&view, &PLAIN, now, 80, 24));
    assert_eq!(
        [screen[22].trim(), screen[23].trim()].join(" "),
        answer,
        "{}",
        screen.join("\n")
    );
    view.take(News::Answer(format!("{answer} {answer}; at last")), now);
    let screen = lines(&drawn(&view, &PLAIN, now, 80, 24));
    assert!(screen[23].contains("at last"), "{}", screen.join("\n"));
}

#[test]
fn plain_terminals_get_ascii_and_any_size_is_drawn() {
    let now = Instant::now();
    let ascii = Palette {
        colour: true,
        unicode: false,
    };
    let view = fed(&turning(), now);
    let all = lines(&drawn(&view, &ascii, now, 80, 24)).join("");
    let strange: String = all
        .chars()
        .filter(|c| !c.is_ascii() && !"°±".contains(*c))
        .collect();
    assert_eq!(strange, "");
    for (width, height) in [(1, 1), (20, 5), (40, 12), (79, 23), (200, 60)] {
        drawn(&view, &ascii, now, width, height);
    }
}

#[test]
fn a_small_terminal_has_heading_and_state_first_whatever_is_asked() {
    let now = Instant::now();
    let mut view = fed(
        &[
            json!({"class": "STATE", "cal_state": "degraded", "reason": "learning", "message": "move the board about"}),
            json!({"class": "ATT", "t_s": 1.0, "seq": 1, "mheading": 271.3, "heading_sd": 14.83, "raw_heading": 240.0}),
        ],
        now,
    );
    for (asking, said) in [
        (false, ""),
        (true, ""),
        (false, "that turn calibrates the compass"),
    ] {
        let question = ("is the board level now?", ControlRequest::Cancel {});
        view.asking = asking.then_some(question);
        view.said = said.to_owned();
        for (width, height) in [(20, 5), (20, 2), (40, 12), (63, 24), (80, 20)] {
            let screen = lines(&drawn(&view, &PLAIN, now, width, height));
            let all = screen.join("\n");
            assert!(screen[0].contains("271.3° magnetic"), "{all}");
            assert!(screen[1].contains("degraded  learning"), "{all}");
            let last: Vec<&str> = screen[2..]
                .iter()
                .flat_map(|line| line.split_whitespace())
                .collect();
            let last = last.join(" ");
            assert!(
                !asking || height < 5 || last.contains("level now?"),
                "{all}"
            );
        }
    }
}

#[test]
fn a_lost_daemon_is_told_and_comes_back() {
    let now = Instant::now();
    let mut view = fed(&turning(), now);
    view.take(News::Lost("headingd has closed the socket".into()), now);
    let all = lines(&drawn(&view, &PLAIN, now, 80, 24)).join("\n");
    assert!(
        all.contains(" lost ") && all.contains("headingd has closed"),
        "{all}"
    );
    assert!(all.contains("rates       field -"), "{all}");
    for object in turning() {
        view.take(News::Object(object), now);
    }
    assert_eq!(view.missed, 0);
    let all = lines(&drawn(&view, &PLAIN, now, 80, 24)).join("\n");
    assert!(!all.contains(" lost "), "{all}");
    assert!(all.contains("rates       field 40"), "{all}");
    // What no longer comes has no rate.
    let later = now + Duration::from_secs(3);
    let all = lines(&drawn(&view, &PLAIN, later, 80, 24)).join("\n");
    assert!(
        all.contains("rates       field -, gyro -, headings -"),
        "{all}"
    );
}
