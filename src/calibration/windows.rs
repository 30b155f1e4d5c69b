//! The samples that the swarm sees.

use std::ops::Range;

use super::model::Mode;
use super::plane::Plan;
use super::settings::WindowChoice;
use super::{Request, Sample, rist};

/// The swarm's windows: RIST for each axis, inside one full turn. In the plane that is the first
/// turn; in space, for each axis the turn in which it swings most. Windows that overlap are joined.
pub fn windows<const D: usize>(
    request: &Request,
    plan: &Plan,
    project: &dyn Fn(&Sample) -> [f64; D],
) -> Vec<Range<usize>> {
    let turns: Vec<Range<usize>> = request
        .turns
        .iter()
        .map(|turn| turn.samples.clone())
        .collect();
    let whole = plan.stretch.clone();
    if request.settings.window != WindowChoice::Rist {
        return vec![whole];
    }
    let turns = match plan.mode {
        Mode::Planar => turns.into_iter().take(1).collect(),
        Mode::Spatial => turns,
    };
    let turns = if turns.is_empty() { vec![whole] } else { turns };
    let values = |turn: &Range<usize>, axis: usize| -> Vec<f64> {
        request.samples[turn.clone()]
            .iter()
            .map(|s| project(s)[axis])
            .collect()
    };
    let swing = |turn: &Range<usize>, axis: usize| {
        let values = values(turn, axis);
        let high = values.iter().copied().fold(f64::MIN, f64::max);
        high - values.iter().copied().fold(f64::MAX, f64::min)
    };
    let mut windows: Vec<Range<usize>> = (0..D)
        .filter_map(|axis| {
            let turn = turns
                .iter()
                .max_by(|a, b| swing(a, axis).total_cmp(&swing(b, axis)))?;
            let window = rist::window(values(turn, axis));
            Some(turn.start + window.start..turn.start + window.end)
        })
        .collect();
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
