//! The compass rose: the heading as a needle, its uncertainty on the ring, and the raw heading beside it.

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::style::Style as Cell;
use ratatui::widgets::Widget;

use super::directions::Directions;
use super::palette::Palette;

/// How far the needles reach, as shares of the ring's radius.
const NEEDLE: f64 = 0.8;
const RAW_NEEDLE: f64 = 0.55;

/// Steps along the ring and along a needle: more than there are cells.
const RING_STEPS: u32 = 360;
const NEEDLE_STEPS: u32 = 40;

/// The rose, north up.
pub(super) struct Rose<'a> {
    /// The heading and its uncertainty, degrees.
    pub(super) heading: Option<(f64, Option<f64>)>,
    /// The uncorrected one, degrees.
    pub(super) raw_deg: Option<f64>,
    /// Directions that have been shown.
    pub(super) directions: &'a Directions,
    pub(super) style: Palette,
}

impl Widget for Rose<'_> {
    fn render(self, area: Rect, buffer: &mut Buffer) {
        if area.width < 9 || area.height < 5 {
            return;
        }
        // A cell is twice as high as it is wide.
        let down = f64::from(area.height - 1) / 2.0;
        let down = down.min(f64::from(area.width - 1) / 4.0);
        let mut put = |degrees: f64, share: f64, symbol: &str, cell: Cell| {
            let (sin, cos) = degrees.to_radians().sin_cos();
            let x = f64::from(area.width - 1) / 2.0 + 2.0 * down * share * sin;
            let y = f64::from(area.height - 1) / 2.0 - down * share * cos;
            let at = (area.x + x.round() as u16, area.y + y.round() as u16);
            if let Some(place) = buffer.cell_mut(at) {
                place.set_symbol(symbol).set_style(cell);
            }
        };
        for step in 0..RING_STEPS {
            let degrees = f64::from(step);
            if self.directions.has(degrees) {
                put(degrees, 1.0, "o", self.style.corrected());
            } else {
                put(degrees, 1.0, ".", self.style.faint());
            }
        }
        for (degrees, name) in [(0.0, "N"), (90.0, "E"), (180.0, "S"), (270.0, "W")] {
            put(degrees, 1.0, name, self.style.strong());
        }
        if let Some((heading_deg, sd_deg)) = self.heading {
            let sd_deg = sd_deg.unwrap_or_default().min(180.0);
            for step in 0..=RING_STEPS {
                let offset = sd_deg * (2.0 * f64::from(step) / f64::from(RING_STEPS) - 1.0);
                put(heading_deg + offset, 1.0, "=", self.style.strong());
            }
        }
        let mut needle = |degrees: f64, length: f64, symbol: &str, cell: Cell| {
            for step in 1..=NEEDLE_STEPS {
                let share = length * f64::from(step) / f64::from(NEEDLE_STEPS);
                put(degrees, share, symbol, cell);
            }
        };
        if let Some(raw_deg) = self.raw_deg {
            needle(raw_deg, RAW_NEEDLE, ":", self.style.raw());
        }
        if let Some((heading_deg, _)) = self.heading {
            needle(heading_deg, NEEDLE, "#", self.style.strong());
        }
        put(0.0, 0.0, "+", self.style.strong());
    }
}
