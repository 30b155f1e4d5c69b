//! The field against the gyro, and the deviation by heading, before and after, as a compass adjuster's card has it.

use super::field::{MOST, mean};
use super::plot::{AxisScale, Chart, Hue, Series};
use super::thin::some;
use super::turn::{Headings3, Turned};
use crate::frame::{wrap_360, wrap_pi};

/// Headings of the card.
const CARD: usize = 12;

/// One sample compared with the gyro, whose heading is offset to the corrected field's mean.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Held {
    pub(super) t_s: f64,
    /// The heading by the gyro, degrees, [0, 360).
    pub(super) heading_deg: f64,
    /// How far the raw heading is off it, degrees.
    pub(super) before_deg: f64,
    /// How far the corrected one is.
    pub(super) after_deg: f64,
}

/// Compares all samples that have a pose with the gyro, each stretch with its own offset.
pub(super) fn held(turned: &Turned) -> Vec<Held> {
    let samples = turned.samples.iter();
    let known: Vec<(f64, Headings3)> = samples
        .filter_map(|seen| Some((seen.t_s, seen.headings?)))
        .collect();
    let mut held = Vec::with_capacity(known.len());
    for stretch in known.chunk_by(|a, b| a.1.frame_id == b.1.frame_id) {
        let off_rad = stretch
            .iter()
            .map(|(_, it)| (it.corrected - it.gyro).to_radians());
        let east: f64 = off_rad.clone().map(f64::sin).sum();
        let north: f64 = off_rad.map(f64::cos).sum();
        let offset_rad = east.atan2(north);
        for (t_s, it) in stretch {
            let reference = it.gyro.to_radians() + offset_rad;
            let from = |degrees: f64| wrap_pi(degrees.to_radians() - reference).to_degrees();
            held.push(Held {
                t_s: *t_s,
                heading_deg: wrap_360(reference.to_degrees()),
                before_deg: from(it.raw),
                after_deg: from(it.corrected),
            });
        }
    }
    held
}

/// The corrected field against the gyro, over time.
pub(super) fn against_gyro(held: &[Held]) -> String {
    let some = some(held, MOST);
    let points = some.iter().map(|it| (it.t_s, it.after_deg));
    let series = vec![Series::dots(Hue::Corrected, points)];
    let y = AxisScale::over(
        "field less gyro, degrees",
        some.iter().map(|it| it.after_deg).chain([-1.0, 1.0]),
    );
    let x = AxisScale::over("time, seconds", some.iter().map(|it| it.t_s));
    Chart::wide(x, y, series).svg()
}

/// The deviation by heading, before and after.
pub(super) fn by_heading(held: &[Held]) -> String {
    let some = some(held, MOST);
    let dots = |hue, of: fn(&Held) -> f64| {
        Series::dots(hue, some.iter().map(|it| (it.heading_deg, of(it))))
    };
    let series = vec![
        dots(Hue::Raw, |it| it.before_deg),
        dots(Hue::Corrected, |it| it.after_deg),
    ];
    let y = AxisScale::over_y("deviation, degrees", &series);
    Chart::wide(AxisScale::from("heading, degrees", 0.0..360.0), y, series).svg()
}

/// The card: a heading, and the mean deviation about it before and after, where it was seen.
pub(super) fn card(held: &[Held]) -> Vec<(f64, Option<(f64, f64)>)> {
    let width = 360.0 / CARD as f64;
    (0..CARD)
        .map(|index| {
            let heading_deg = index as f64 * width;
            let off_rad = |it: &Held| wrap_pi((it.heading_deg - heading_deg).to_radians()).abs();
            let half_rad = (0.5 * width).to_radians();
            let near: Vec<&Held> = held.iter().filter(|it| off_rad(it) < half_rad).collect();
            let mean_of = |of: fn(&Held) -> f64| mean(near.iter().map(|it| of(it)));
            let deviations = (!near.is_empty())
                .then(|| (mean_of(|it| it.before_deg), mean_of(|it| it.after_deg)));
            (heading_deg, deviations)
        })
        .collect()
}
