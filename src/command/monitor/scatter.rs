//! Two axes of the field, raw and corrected, about the origin.

use std::collections::VecDeque;

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::widgets::Widget;

use super::palette::Palette;

/// The dots of a Braille character, by column and row.
const DOTS: [[u32; 4]; 2] = [[0x01, 0x02, 0x04, 0x40], [0x08, 0x10, 0x20, 0x80]];

/// Samples of the field, the oldest first; an axis that is not known is NaN.
pub(super) type FieldTrail = VecDeque<[f64; 3]>;

/// One plane.
pub(super) struct Scatter<'a> {
    /// The axes across and up.
    pub(super) axes: [usize; 2],
    /// The field at the edge, milligauss.
    pub(super) reach_mgauss: f64,
    pub(super) raw: &'a FieldTrail,
    pub(super) corrected: &'a FieldTrail,
    pub(super) style: Palette,
}

impl Widget for Scatter<'_> {
    fn render(self, area: Rect, buffer: &mut Buffer) {
        if area.width < 3 || area.height < 3 {
            return;
        }
        let columns = f64::from(area.width);
        let rows = f64::from(area.height);
        // A cell has two dots across and four down, which makes the dots square.
        let per_mgauss = (2.0 * columns).min(4.0 * rows) / 2.0 / self.reach_mgauss;
        // The cell of a sample, and the dot within it.
        let dot = |sample: &[f64; 3]| {
            let across = columns + sample[self.axes[0]] * per_mgauss;
            let down = 2.0 * rows - sample[self.axes[1]] * per_mgauss;
            let inside =
                (0.0..2.0 * columns).contains(&across) && (0.0..4.0 * rows).contains(&down);
            inside.then_some((across as u16, down as u16))
        };
        if let Some(cell) = buffer.cell_mut((area.x + area.width / 2, area.y + area.height / 2)) {
            cell.set_symbol("+").set_style(self.style.faint());
        }
        for (across, down) in self.raw.iter().filter_map(dot) {
            if let Some(cell) = buffer.cell_mut((area.x + across / 2, area.y + down / 4)) {
                cell.set_symbol(".").set_style(self.style.raw());
            }
        }
        for (across, down) in self.corrected.iter().filter_map(dot) {
            let Some(cell) = buffer.cell_mut((area.x + across / 2, area.y + down / 4)) else {
                continue;
            };
            let bit = DOTS[usize::from(across % 2)][usize::from(down % 4)];
            let before = cell.symbol().chars().next().map_or(0, u32::from);
            let bits = if (0x2800..0x2900).contains(&before) {
                before
            } else {
                0x2800
            } | bit;
            match char::from_u32(bits).filter(|_| self.style.unicode) {
                Some(braille) => cell.set_char(braille),
                None => cell.set_symbol("o"),
            }
            .set_style(self.style.corrected());
        }
    }
}
