//! Two axes of the field, raw and corrected, about the origin.

use std::collections::VecDeque;

use ratatui::layout::Rect;
use ratatui::style::Style as Cell;
use ratatui::symbols::Marker;
use ratatui::text::Line;
use ratatui::widgets::Widget;
use ratatui::widgets::canvas::{Canvas, Points};

use super::palette::Palette;

/// Samples of the field, the oldest first; an axis that is not known is NaN.
pub(super) type FieldTrail = VecDeque<[f64; 3]>;

/// One plane of this area: the axes across and up, and the field at the nearer edges, milligauss.
pub(super) fn scatter(
    axes: [usize; 2],
    reach_mgauss: f64,
    [raw, corrected]: [&FieldTrail; 2],
    style: Palette,
    area: Rect,
) -> impl Widget {
    // A cell is twice as high as it is wide.
    let (columns, rows) = (f64::from(area.width), 2.0 * f64::from(area.height));
    let [across, up] = [columns, rows].map(|size| reach_mgauss * size / columns.min(rows));
    let points = |trail: &FieldTrail| -> Vec<(f64, f64)> {
        let plane = trail.iter().map(|field| (field[axes[0]], field[axes[1]]));
        plane.filter(|(x, y)| (x + y).is_finite()).collect()
    };
    let [raw, corrected] = [raw, corrected].map(points);
    let colour = |cell: Cell| cell.fg.unwrap_or_default();
    Canvas::default()
        .x_bounds([-across, across])
        .y_bounds([-up, up])
        .paint(move |plane| {
            plane.print(0.0, 0.0, Line::styled("+", style.faint()));
            plane.marker(Marker::Custom('.'));
            plane.draw(&Points::new(&raw, colour(style.raw())));
            plane.marker(match style.unicode {
                true => Marker::Braille,
                false => Marker::Custom('o'),
            });
            plane.draw(&Points::new(&corrected, colour(style.corrected())));
        })
}
