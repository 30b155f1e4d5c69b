//! Heading and uncertainty over time, on bands of the daemon's condition.

use super::analysis::{Findings, Point};
use super::plot::{AxisScale, Band, Chart, Hue, Series};
use super::thin::some;
use crate::condition::Condition;

/// Points of a line.
const MOST: usize = 1500;

/// A heading that goes on by more than this has gone over north, and the line is broken there.
const OVER_NORTH_DEG: f64 = 180.0;

/// The band of a condition.
fn hue(condition: Condition) -> Hue {
    match condition {
        Condition::Good => Hue::Good,
        Condition::Degraded | Condition::Disturbed => Hue::Middling,
        Condition::Stale | Condition::Fault => Hue::Bad,
        _ => Hue::Quiet,
    }
}

/// The heading: raw, published, and from true north where that is known.
pub(super) fn headings(found: &Findings) -> String {
    let points = some(&found.points.kept, MOST);
    let mut series = lines(&points, Hue::Raw, |point| point.raw_deg);
    series.extend(lines(&points, Hue::Other, |point| point.true_deg));
    series.extend(lines(&points, Hue::Corrected, |point| point.heading_deg));
    let y = AxisScale::from("heading, degrees", 0.0..360.0);
    let mut chart = Chart::wide(times(&points), y, series);
    chart.bands = bands(found);
    chart.svg()
}

/// What the daemon says of its heading: one standard deviation.
pub(super) fn uncertainty(found: &Findings) -> String {
    let points = some(&found.points.kept, MOST);
    let series = lines(&points, Hue::Corrected, |point| point.sd_deg);
    let most = points
        .iter()
        .filter_map(|point| point.sd_deg)
        .fold(1.0, f64::max);
    let y = AxisScale::from("uncertainty, degrees", 0.0..1.05 * most);
    let mut chart = Chart::wide(times(&points), y, series);
    chart.size.1 = 200;
    chart.bands = bands(found);
    chart.svg()
}

fn times(points: &[&Point]) -> AxisScale {
    AxisScale::over("time, seconds", points.iter().map(|point| point.t_s))
}

fn bands(found: &Findings) -> Vec<Band> {
    let first_s = found.first_s.unwrap_or(0.0);
    let ends = found.changes.iter().skip(1).map(|report| report.t_s);
    let ends = ends.chain([found.now_s]);
    let bands = found.changes.iter().zip(ends).map(|(report, to)| Band {
        from: report.t_s.max(first_s),
        to: to.max(first_s),
        hue: hue(report.condition),
    });
    bands.collect()
}

/// Lines through what is known; they break where it is not, and over north.
fn lines(points: &[&Point], hue: Hue, of: fn(&Point) -> Option<f64>) -> Vec<Series> {
    let mut lines: Vec<Series> = Vec::new();
    let mut last: Option<f64> = None;
    for point in points {
        let value = of(point);
        if let Some(value) = value {
            let goes_on = last.is_some_and(|last| (value - last).abs() < OVER_NORTH_DEG);
            if !goes_on {
                lines.push(Series::line(hue, std::iter::empty()));
            }
            if let Some(line) = lines.last_mut() {
                line.points.push((point.t_s, value));
            }
        }
        last = value;
    }
    lines
}
