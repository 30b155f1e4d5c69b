//! The one table: a row a family or log, each figure beside its limit.

use std::fmt::Write;

use crate::score::{Score, percentile_deg};

/// The limits of a row; what has none is only shown.
#[derive(Clone, Copy)]
pub struct Limits {
    /// First heading after motion starts, in 95 %, seconds.
    pub first_s: Option<f64>,
    /// The same, degrees of turns.
    pub first_deg: Option<f64>,
    /// Least share of samples with a heading from then on.
    pub share: Option<f64>,
    pub rms_deg: Option<f64>,
    pub p95_deg: Option<f64>,
    pub nerr: Option<(f64, f64)>,
    /// Share of time.
    pub false_share: Option<f64>,
    /// Share of good time, from the fault on.
    pub false_of_good: Option<f64>,
    /// Least share of the time free of faults, after learning.
    pub good: Option<f64>,
    /// What has to be said is said within so many seconds in such a share of the runs.
    pub told: Option<(f64, f64)>,
    /// Accepted calibrations are right, as the issue has it for bad turns.
    pub accepted_right: bool,
    /// Least share of runs with an accepted calibration.
    pub accepted: Option<f64>,
    /// What `Score::other` holds, and the most that each may be, by size.
    pub other: &'static [(&'static str, f64)],
}

/// No limit at all.
pub const NONE: Limits = Limits {
    first_s: None,
    first_deg: None,
    share: None,
    rms_deg: None,
    p95_deg: None,
    nerr: None,
    false_share: None,
    false_of_good: None,
    good: None,
    told: None,
    accepted_right: false,
    accepted: None,
    other: &[],
};

/// One row.
pub struct Row {
    cells: [String; COLUMNS.len()],
    /// Whether a limit is missed.
    pub failed: bool,
}

const COLUMNS: [&str; 11] = [
    "log",
    "runs",
    "first heading, s (median, 95 %)",
    "heading for",
    "RMS",
    "95 %",
    "nerr (95 % of runs)",
    "false-sure",
    "good",
    "told after, s (median, worst share)",
    "other",
];

impl Row {
    /// A log that is not here.
    pub fn skipped(name: &str, why: &str) -> Self {
        let mut row = Self::named(name);
        row.cells[1] = "-".to_owned();
        row.cells[10] = format!("skipped: {why}");
        row
    }

    fn named(name: &str) -> Self {
        let mut cells: [String; COLUMNS.len()] = Default::default();
        cells[0] = name.to_owned();
        Self {
            cells,
            failed: false,
        }
    }

    pub fn new(name: &str, scores: &[Score], limits: &Limits) -> Self {
        let mut row = Self::named(name);
        row.cells[1] = scores.len().to_string();
        row.first(scores, limits);
        row.share(scores, limits);
        row.errors(scores, limits);
        row.honesty(scores, limits);
        row.told(scores, limits);
        row.others(scores, limits);
        row
    }

    /// Adds a figure to a cell, with its limit and whether that holds; an unknown figure under a limit has failed.
    fn put(&mut self, column: usize, shown: &str, limit: Option<(String, bool)>) {
        let cell = &mut self.cells[column];
        if !cell.is_empty() {
            cell.push_str("; ");
        }
        cell.push_str(if shown.is_empty() { "-" } else { shown });
        if let Some((limit, holds)) = limit {
            write!(cell, " ({limit} {})", if holds { "ok" } else { "FAIL" }).expect("a string");
            self.failed |= !holds;
        }
    }

    fn first(&mut self, scores: &[Score], limits: &Limits) {
        let never = f64::INFINITY;
        let firsts = |pick: fn(&Score) -> Option<f64>| {
            let mut firsts: Vec<f64> = scores.iter().map(|s| pick(s).unwrap_or(never)).collect();
            firsts.sort_by(f64::total_cmp);
            (quantile(&firsts, 0.5), quantile(&firsts, 0.95))
        };
        let (median, late) = firsts(|score| score.first_s);
        let limit = |most| (format!("≤ {most}"), late <= most);
        let shown = format!("{}, {}", time(median), time(late));
        self.put(2, &shown, limits.first_s.map(limit));
        if let Some(most) = limits.first_deg {
            let (median, late) = firsts(|score| score.first_turned_deg);
            let shown = format!("{}, {}°", time(median), time(late));
            self.put(2, &shown, Some((format!("≤ {most}°"), late <= most)));
        }
    }

    fn share(&mut self, scores: &[Score], limits: &Limits) {
        let share = ratio(scores, |s| s.with as f64, |s| s.since as f64);
        let limit = limits.share.map(|least| at_least(share, least));
        self.put(3, &percent(share, 1), limit);
    }

    fn errors(&mut self, scores: &[Score], limits: &Limits) {
        let square = ratio(scores, |s| s.squares, |s| s.errors as f64);
        for (column, found, most) in [
            (4, square.map(f64::sqrt), limits.rms_deg),
            (5, percentile_deg(scores, 0.95), limits.p95_deg),
        ] {
            let shown = found.map_or(String::new(), |deg| format!("{deg:.2}°"));
            let holds = |most| found.is_some_and(|found| found <= most);
            let limit = most.map(|most| (format!("≤ {most}°"), holds(most)));
            self.put(column, &shown, limit);
        }
    }

    fn honesty(&mut self, scores: &[Score], limits: &Limits) {
        let square = ratio(scores, |s| s.normalised_squares, |s| s.normalised as f64);
        let nerr = square.map(f64::sqrt);
        let mut each: Vec<f64> = scores.iter().filter_map(Score::nerr).collect();
        each.sort_by(f64::total_cmp);
        let shown = nerr.map_or(String::new(), |nerr| {
            format!("{nerr:.2}, {:.2}", quantile(&each, 0.95))
        });
        let limit = limits.nerr.map(|(least, most)| {
            let holds = nerr.is_some_and(|nerr| (least..=most).contains(&nerr));
            (format!("{least}–{most}"), holds)
        });
        self.put(6, &shown, limit);

        let seconds: f64 = scores.iter().map(|score| score.false_s).sum();
        let share = ratio(scores, |s| s.false_s, |s| s.time_s);
        let limit = limits.false_share.map(|most| {
            let text = match most {
                0.0 => "0 s".to_owned(),
                most => format!("≤ {} %", 100.0 * most),
            };
            (text, share.is_some_and(|share| share <= most))
        });
        let shown = format!("{seconds:.1} s, {}", percent(share, 3));
        self.put(7, &shown, limit);
        if let Some(most) = limits.false_of_good {
            let share = ratio(scores, |s| s.false_good_s, |s| s.good_s);
            let shown = format!("{} of good", percent(share, 2));
            let holds = share.is_none_or(|share| share <= most);
            self.put(7, &shown, Some((format!("≤ {} %", 100.0 * most), holds)));
        }

        let share = ratio(scores, |s| s.is_good_s, |s| s.should_be_good_s);
        let limit = limits.good.map(|least| at_least(share, least));
        self.put(8, &percent(share, 1), limit);
    }

    fn told(&mut self, scores: &[Score], limits: &Limits) {
        let watches: Vec<_> = scores.iter().filter_map(|s| s.watch.as_ref()).collect();
        if watches.is_empty() {
            return;
        }
        let mut after: Vec<f64> = watches
            .iter()
            .map(|watch| watch.after_s.unwrap_or(f64::INFINITY))
            .collect();
        after.sort_by(f64::total_cmp);
        let within = limits.told.map_or(10.0, |(within, _)| within);
        let in_time = after.iter().filter(|after| **after <= within).count();
        let share = in_time as f64 / after.len() as f64;
        let ready = watches.iter().filter(|watch| watch.ready).count();
        let shown = format!(
            "{}; {} within {within} s; {ready} good before",
            time(quantile(&after, 0.5)),
            percent(Some(share), 1)
        );
        let limit = limits.told.map(|(_, least)| at_least(Some(share), least));
        self.put(9, &shown, limit);
    }

    fn others(&mut self, scores: &[Score], limits: &Limits) {
        for (index, (what, most)) in limits.other.iter().enumerate() {
            let mut found: Vec<f64> = scores
                .iter()
                .map(|score| score.other.get(index).map_or(f64::NAN, |value| value.abs()))
                .collect();
            found.sort_by(f64::total_cmp);
            // NaN, unknown, is sorted last.
            let worst = found.last().copied().unwrap_or(f64::NAN);
            let shown = format!("{what} {}", number(worst));
            self.put(10, &shown, Some((format!("≤ {most}"), worst <= *most)));
        }
        let accepted: Vec<_> = scores
            .iter()
            .flat_map(|s| s.accepted.iter().copied())
            .collect();
        let runs = scores
            .iter()
            .filter(|score| !score.accepted.is_empty())
            .count();
        if limits.accepted_right || limits.accepted.is_some() {
            let mut ratios: Vec<f64> = accepted
                .iter()
                .map(|(claim, error)| error / claim)
                .collect();
            ratios.sort_by(f64::total_cmp);
            let late = quantile(&ratios, 0.95);
            let shown = format!("{runs} accepted, error / claimed {} in 95 %", number(late));
            let right =
                |limit: &str, holds| limits.accepted_right.then(|| (limit.to_owned(), holds));
            self.put(10, &shown, right("≤ 2.5", ratios.is_empty() || late <= 2.5));
            let wrong = accepted
                .iter()
                .filter(|(claim, error)| *error > 5.0 && *claim < 2.0);
            let share = wrong.count() as f64 / accepted.len().max(1) as f64;
            let shown = format!("{} wrong", percent(Some(share), 1));
            self.put(10, &shown, right("< 1 %", share < 0.01));
        }
        if let Some(least) = limits.accepted {
            let share = Some(runs as f64 / scores.len() as f64);
            let shown = format!("{} accepted", percent(share, 1));
            self.put(10, &shown, Some(at_least(share, least)));
        }
    }

    /// As a row of a Markdown table.
    pub fn line(&self) -> String {
        format!("| {} |", self.cells.join(" | "))
    }
}

/// The limit of a share, and whether it holds.
fn at_least(share: Option<f64>, least: f64) -> (String, bool) {
    (format!("≥ {:.0} %", 100.0 * least), share >= Some(least))
}

/// The table's head.
pub fn head() -> String {
    format!(
        "| {} |\n|{}",
        COLUMNS.join(" | "),
        "---|".repeat(COLUMNS.len())
    )
}

fn ratio(scores: &[Score], over: fn(&Score) -> f64, under: fn(&Score) -> f64) -> Option<f64> {
    let under: f64 = scores.iter().map(under).sum();
    (under > 0.0).then(|| scores.iter().map(over).sum::<f64>() / under)
}

/// The least value that this share of the sorted values does not exceed.
fn quantile(sorted: &[f64], share: f64) -> f64 {
    let index = (share * sorted.len() as f64).ceil() as usize;
    sorted.get(index.max(1) - 1).copied().unwrap_or(f64::NAN)
}

fn number(value: f64) -> String {
    if value.is_finite() {
        format!("{value:.2}")
    } else {
        "-".to_owned()
    }
}

fn time(seconds: f64) -> String {
    if seconds.is_finite() {
        format!("{seconds:.1}")
    } else {
        "never".to_owned()
    }
}

fn percent(share: Option<f64>, digits: usize) -> String {
    share.map_or(String::new(), |share| {
        format!("{:.digits$} %", 100.0 * share)
    })
}
