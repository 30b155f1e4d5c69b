//! One figure as SVG. Each hue is a unique RGB placeholder; the style sheet replaces it.

use std::ops::Range;

use plotters::prelude::*;
use plotters::style::FontTransform;

/// What a colour is for. The style sheet says which it is, with the code `#0102nn` for each: `nn` is 01 for the first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Hue {
    Ink,
    Grid,
    Raw,
    Corrected,
    Other,
    Good,
    Middling,
    Bad,
    Quiet,
}

impl Hue {
    /// The colour that stands for it in the SVG.
    fn rgb(self) -> RGBColor {
        RGBColor(1, 2, 1 + self as u8)
    }
}

#[derive(Clone, Debug)]
pub(super) struct Series {
    pub(super) points: Vec<(f64, f64)>,
    hue: Hue,
    /// Else a line through the points.
    is_dots: bool,
}

impl Series {
    pub(super) fn line(hue: Hue, points: impl Iterator<Item = (f64, f64)>) -> Self {
        Self {
            points: points.collect(),
            hue,
            is_dots: false,
        }
    }

    pub(super) fn dots(hue: Hue, points: impl Iterator<Item = (f64, f64)>) -> Self {
        Self {
            is_dots: true,
            ..Self::line(hue, points)
        }
    }
}

/// A stretch of the x axis, from the bottom to the top.
#[derive(Clone, Debug)]
pub(super) struct Band {
    pub(super) from: f64,
    pub(super) to: f64,
    pub(super) hue: Hue,
}

/// An axis with its name and unit.
#[derive(Clone, Debug)]
pub(super) struct AxisScale {
    pub(super) name: String,
    pub(super) range: Range<f64>,
    /// The numbers are powers of ten.
    pub(super) logarithmic: bool,
}

impl AxisScale {
    /// From the least to the most, with a little room.
    pub(super) fn over(name: &str, values: impl Iterator<Item = f64>) -> Self {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for value in values.filter(|value| value.is_finite()) {
            (low, high) = (low.min(value), high.max(value));
        }
        if low > high {
            (low, high) = (0.0, 1.0);
        }
        let room = (0.04 * (high - low)).max(1e-6);
        Self::from(name, low - room..high + room)
    }

    /// The same over the y of all points of these series.
    pub(super) fn over_y(name: &str, series: &[Series]) -> Self {
        let points = series.iter().flat_map(|series| &series.points);
        Self::over(name, points.map(|point| point.1))
    }

    pub(super) fn from(name: &str, range: Range<f64>) -> Self {
        Self {
            name: name.to_owned(),
            range,
            logarithmic: false,
        }
    }
}

#[derive(Clone, Debug)]
pub(super) struct Chart {
    pub(super) size: (u32, u32),
    pub(super) x: AxisScale,
    pub(super) y: AxisScale,
    pub(super) bands: Vec<Band>,
    pub(super) series: Vec<Series>,
}

impl Chart {
    pub(super) fn wide(x: AxisScale, y: AxisScale, series: Vec<Series>) -> Self {
        Self {
            size: (860, 320),
            x,
            y,
            bands: Vec::new(),
            series,
        }
    }

    /// A square one, whose axes have the same scale and hold all points.
    pub(super) fn square(names: [&str; 2], series: Vec<Series>) -> Self {
        let points = || series.iter().flat_map(|series| &series.points);
        let middle = |range: Range<f64>| 0.5 * (range.start + range.end);
        let x = AxisScale::over(names[0], points().map(|point| point.0));
        let y = AxisScale::over(names[1], points().map(|point| point.1));
        let half = 0.5 * (x.range.end - x.range.start).max(y.range.end - y.range.start);
        let about = |centre: f64| centre - half..centre + half;
        Self {
            size: (430, 420),
            x: AxisScale::from(names[0], about(middle(x.range))),
            y: AxisScale::from(names[1], about(middle(y.range))),
            bands: Vec::new(),
            series,
        }
    }

    pub(super) fn svg(&self) -> String {
        let mut svg = String::new();
        draw(self, &mut svg).expect("a text takes whatever is drawn into it");
        svg
    }
}

fn draw(chart: &Chart, svg: &mut String) -> Result<(), Box<dyn std::error::Error>> {
    let root = SVGBackend::with_string(svg, chart.size).into_drawing_area();
    let mut on = ChartBuilder::on(&root)
        .margin(8)
        .margin_right(16)
        .x_label_area_size(46)
        .y_label_area_size(70)
        .build_cartesian_2d(chart.x.range.clone(), chart.y.range.clone())?;
    let bottom_to_top = (chart.y.range.start, chart.y.range.end);
    for band in &chart.bands {
        let corners = [(band.from, bottom_to_top.0), (band.to, bottom_to_top.1)];
        on.draw_series([Rectangle::new(corners, band.hue.rgb().mix(0.25).filled())])?;
    }
    let font = |size: u32| ("sans-serif", size).into_font();
    let ink = Hue::Ink.rgb();
    let (x_step, y_step) = (step(&chart.x), step(&chart.y));
    on.configure_mesh()
        .axis_style(ink)
        .bold_line_style(Hue::Grid.rgb())
        .light_line_style(TRANSPARENT)
        .label_style(font(13).color(&ink))
        .axis_desc_style(font(14).transform(FontTransform::None).color(&ink))
        .x_desc(chart.x.name.as_str())
        .y_desc(chart.y.name.as_str())
        .x_label_formatter(&|value| label(&chart.x, *value, x_step))
        .y_label_formatter(&|value| label(&chart.y, *value, y_step))
        .draw()?;
    for series in &chart.series {
        let hue = series.hue.rgb();
        let points = series.points.iter().copied();
        if series.is_dots {
            on.draw_series(points.map(|point| Circle::new(point, 2, hue.mix(0.8).filled())))?;
        } else {
            on.draw_series(LineSeries::new(points, hue.stroke_width(2)))?;
        }
    }
    root.present()?;
    Ok(())
}

/// How far labels are apart, about.
fn step(axis: &AxisScale) -> f64 {
    (axis.range.end - axis.range.start) / 10.0
}

/// A number of an axis, with as many digits as tell it from its neighbours.
fn label(axis: &AxisScale, value: f64, step: f64) -> String {
    if axis.logarithmic {
        let number = 10f64.powf(value);
        // Three digits at most: a longer number would run into the axis' name.
        return match number {
            10.0..1e4 => format!("{number:.0}"),
            0.1..10.0 => format!("{number:.1}"),
            _ => format!("{number:.1e}"),
        };
    }
    let decimals = (-step.log10()).ceil().clamp(0.0, 6.0) as usize;
    format!("{:.decimals$}", value + 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_style_sheet_has_each_hue_by_its_code() {
        let style = include_str!("style.css");
        for hue in [
            Hue::Ink,
            Hue::Grid,
            Hue::Raw,
            Hue::Corrected,
            Hue::Other,
            Hue::Good,
            Hue::Middling,
            Hue::Bad,
            Hue::Quiet,
        ] {
            let RGBColor(r, g, b) = hue.rgb();
            let name = format!("{hue:?}").to_lowercase();
            let rule = format!("[fill=\"#{r:02X}{g:02X}{b:02X}\"]{{fill:var(--{name})}}");
            assert!(style.contains(&rule), "{rule}");
        }
    }
}
