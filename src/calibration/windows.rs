//! Which samples the swarm sees: RIST's windows, inside full turns.

use std::ops::Range;

use super::coverage::span;
use super::model::Mode;
use super::plane::{Plan, show_space};
use super::request::{FieldSample, Request};
use super::rist;
use super::settings::WindowChoice;

/// One axis during one turn.
struct Swing {
    /// From its lowest to its highest sample, milligauss.
    span_mgauss: f64,
    /// RIST's window.
    window: Range<usize>,
}

/// The swarm's windows: RIST for each axis, inside one full turn. In the plane that is the first turn; in
/// space, for each axis the turn in which it swings most. Where that is one oblique turn for all of them, a
/// turn about another axis comes with it: a single circle does not determine a sphere. Windows that overlap
/// are joined.
pub fn windows<const D: usize>(request: &Request, plan: &Plan) -> Vec<Range<usize>> {
    let whole = plan.samples.clone();
    if request.settings.window != WindowChoice::Rist {
        return vec![whole];
    }
    let turns = match plan.mode {
        Mode::Planar => &request.turns[..request.turns.len().min(1)],
        Mode::Spatial => &request.turns,
    };
    let spans: Vec<Range<usize>> = if turns.is_empty() {
        vec![whole]
    } else {
        turns.iter().map(|turn| turn.samples.clone()).collect()
    };
    let swings: Vec<[Swing; D]> = spans
        .iter()
        .map(|span| swings(&request.samples[span.clone()], span.start, plan))
        .collect();

    let mut windows = Vec::with_capacity(D);
    let mut chosen = Vec::with_capacity(D);
    for axis in 0..D {
        let swung = |turn: &usize| swings[*turn][axis].span_mgauss;
        let most = (0..swings.len()).max_by(|a, b| swung(a).total_cmp(&swung(b)));
        if let Some(turn) = most {
            windows.push(swings[turn][axis].window.clone());
            chosen.push(turn);
        }
    }
    let one_axis = |chosen: &[usize]| {
        let axes = chosen.iter().map(|&turn| turns[turn].axis_body);
        !show_space(axes, &request.settings)
    };
    for index in 0..turns.len() {
        if one_axis(&chosen) && !one_axis(&[chosen[0], index]) {
            let most = swings[index]
                .iter()
                .max_by(|a, b| a.span_mgauss.total_cmp(&b.span_mgauss));
            windows.extend(most.map(|swing| swing.window.clone()));
            chosen.push(index);
        }
    }

    windows.sort_by_key(|window| window.start);
    windows.dedup_by(|next, last| {
        let overlap = next.start <= last.end;
        if overlap {
            last.end = last.end.max(next.end);
        }
        overlap
    });
    windows
}

fn swings<const D: usize>(samples: &[FieldSample], start: usize, plan: &Plan) -> [Swing; D] {
    let points: Vec<[f64; D]> = samples.iter().map(|one| plan.project(one)).collect();
    std::array::from_fn(|axis| {
        let values = || points.iter().map(|point| point[axis]);
        let window = rist::window(values());
        Swing {
            span_mgauss: span(values()),
            window: start + window.start..start + window.end,
        }
    })
}
