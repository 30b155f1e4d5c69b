//! Figures of the field during the turn: its circles, its strength, and the window that RIST chose.

use std::f64::consts::TAU;

use nalgebra::Vector3;

use super::analysis::Judged;
use super::plot::{AxisScale, Band, Chart, Hue, Series};
use super::thin::some;
use super::turn::{Seen, Turned};

/// Points of a kind in a figure.
pub(super) const MOST: usize = 700;

/// Points of a circle.
const CIRCLE: u32 = 120;

/// Raw and corrected field, a figure for each pair of axes (the paper's Figure 6c).
pub(super) fn circles(turned: &Turned) -> String {
    let pairs: &[[usize; 2]] = if turned.axes.len() == 2 {
        &[[0, 1]]
    } else {
        &[[0, 1], [0, 2], [1, 2]]
    };
    let samples = some(&turned.samples, MOST);
    let strengths = turned.samples.iter();
    let strength = mean(strengths.map(|seen| seen.corrected_mgauss.norm()));
    let mut svg = String::new();
    for [a, b] in pairs {
        let dots = |hue, of: fn(&Seen) -> &Vector3<f64>| {
            let points = samples.iter().map(|seen| (of(seen)[*a], of(seen)[*b]));
            Series::dots(hue, points)
        };
        let circle = (0..=CIRCLE).map(|step| {
            let (sin, cos) = (TAU * f64::from(step) / f64::from(CIRCLE)).sin_cos();
            (strength * cos, strength * sin)
        });
        let series = vec![
            Series::line(Hue::Ink, circle),
            dots(Hue::Raw, |seen| &seen.raw_mgauss),
            dots(Hue::Corrected, |seen| &seen.corrected_mgauss),
        ];
        let names = [*a, *b].map(|axis| format!("{}, milligauss", turned.axes[axis]));
        svg += &Chart::square([&names[0], &names[1]], series).svg();
    }
    svg
}

/// Strength of the field before and after (Figure 6b).
pub(super) fn strength(turned: &Turned) -> String {
    let samples = some(&turned.samples, MOST);
    let line = |hue, of: fn(&Seen) -> &Vector3<f64>| {
        Series::line(hue, samples.iter().map(|seen| (seen.t_s, of(seen).norm())))
    };
    let series = vec![
        line(Hue::Raw, |seen| &seen.raw_mgauss),
        line(Hue::Corrected, |seen| &seen.corrected_mgauss),
    ];
    let y = AxisScale::over_y("field, milligauss", &series);
    let x = AxisScale::over("time, seconds", samples.iter().map(|seen| seen.t_s));
    Chart::wide(x, y, series).svg()
}

/// The raw signals, and the window in them that RIST chose (Figure 3).
pub(super) fn window(judged: &Judged) -> String {
    let samples = some(&judged.request.samples, MOST);
    let line = |axis: usize, hue| {
        let points = samples.iter();
        let points = points.map(|sample| (sample.t_s, sample.field_mgauss[axis]));
        Series::line(hue, points)
    };
    let series = vec![
        line(0, Hue::Raw),
        line(1, Hue::Corrected),
        line(2, Hue::Other),
    ];
    let y = AxisScale::over_y("raw field, milligauss", &series);
    let x = AxisScale::over("time, seconds", samples.iter().map(|sample| sample.t_s));
    let mut chart = Chart::wide(x, y, series);
    let time = |index: usize| judged.request.samples.get(index).map(|sample| sample.t_s);
    let swarm = judged.outcome.swarm.iter();
    for window in swarm.flat_map(|swarm| &swarm.windows) {
        if let (Some(from), Some(to)) = (time(window.start), time(window.end.saturating_sub(1))) {
            chart.bands.push(Band {
                from,
                to,
                hue: Hue::Good,
            });
        }
    }
    chart.svg()
}

pub(super) fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
    sum / f64::max(count, 1.0)
}
