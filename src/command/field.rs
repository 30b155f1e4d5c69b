//! `headingd field`: the earth's field at a place and on a day.

use std::time::Duration;

use serde_json::json;

use super::{Failure, number, print, print_json, tell};
use crate::date;
use crate::frame::rounded;
use crate::true_north::{EarthField, Position, ValueWithSd};
use crate::wall_clock;

/// Print the earth's field at a place: declination, dip and strength
///
/// By the World Magnetic Model. The declination is how far magnetic north is east of true north: a magnetic heading and
/// the declination make the true heading. The ± is one standard deviation. It covers the rock below, which the model does
/// not know, but no iron nearby.
#[derive(Clone, Debug, clap::Args)]
#[command(
    allow_negative_numbers = true,
    after_help = "Example: headingd field --lat 51.08 --lon -114.13 --alt 1100"
)]
pub struct Args {
    /// Degrees north of the equator; the south is negative
    #[arg(long, value_name = "DEGREES", value_parser = number("a number of degrees", -90.0..=90.0))]
    pub lat: f64,

    /// Degrees east of Greenwich; the west is negative
    #[arg(long, value_name = "DEGREES", value_parser = number("a number of degrees", -180.0..=180.0))]
    pub lon: f64,

    /// Metres above the ellipsoid of WGS 84, which is near the level of the sea
    #[arg(long, value_name = "METRES", default_value_t = 0.0)]
    pub alt: f64,

    /// The day, as 2026-11-21; today if it is left out
    #[arg(long, value_name = "DATE", value_parser = day)]
    pub date: Option<Duration>,

    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

fn day(text: &str) -> Result<Duration, String> {
    date::parse_rfc3339(&format!("{text}T00:00:00Z"))
        .ok_or_else(|| "must be a day since 1970, as 2026-11-21".to_owned())
}

pub fn run(args: &Args) -> Result<(), Failure> {
    let position = Position {
        latitude_deg: args.lat,
        longitude_deg: args.lon,
        altitude_m: args.alt,
    };
    let since_1970 = args.date.or_else(wall_clock::now).ok_or_else(|| {
        let message = "the system's clock was never set: name the day with --date";
        Failure::new(Failure::UNAVAILABLE, message)
    })?;
    let field = EarthField::new(&position, since_1970)
        .map_err(|error| Failure::new(Failure::REFUSED, error))?;
    let day = date::date(since_1970).to_string();
    if args.json {
        return print_json(&as_json(&position, &day, &field));
    }
    if let Some(warning) = field.warning() {
        tell(warning);
    }
    print(&as_text(&position, &day, &field))
}

fn as_text(position: &Position, day: &str, field: &EarthField) -> String {
    let sided = |value: f64, plus, minus| {
        let side = if value < 0.0 { minus } else { plus };
        format!("{}° {side}", value.abs())
    };
    let row = |name: &str, known: ValueWithSd, unit: &str, more: &str| {
        let ValueWithSd { value, sd } = known;
        let value = rounded(value, 2);
        format!("{name:<12}{value:>8.2} ± {sd:.2}{unit}{more}\n")
    };
    let declination = if field.declination_deg.value < 0.0 {
        ", magnetic north is west of true north"
    } else {
        ", magnetic north is east of true north"
    };
    let dip = if field.dip_deg.value < 0.0 {
        ", upward"
    } else {
        ", downward"
    };
    let mut text = format!(
        "{}, {}, {} m, on {day}\n",
        sided(position.latitude_deg, "N", "S"),
        sided(position.longitude_deg, "E", "W"),
        position.altitude_m,
    );
    text += &row("declination", field.declination_deg, "°", declination);
    text += &row("dip", field.dip_deg, "°", dip);
    text += &row("strength", field.strength_mgauss, " mG", "");
    text += &row("horizontal", field.horizontal_mgauss, " mG", "");
    text
}

fn as_json(position: &Position, day: &str, field: &EarthField) -> serde_json::Value {
    let hundredths = |value| rounded(value, 2);
    let mut all = json!({
        "latitude_deg": position.latitude_deg,
        "longitude_deg": position.longitude_deg,
        "altitude_m": position.altitude_m,
        "date": day,
        "declination_deg": hundredths(field.declination_deg.value),
        "declination_sd_deg": hundredths(field.declination_deg.sd),
        "dip_deg": hundredths(field.dip_deg.value),
        "dip_sd_deg": hundredths(field.dip_deg.sd),
        "total_mgauss": hundredths(field.strength_mgauss.value),
        "total_sd_mgauss": hundredths(field.strength_mgauss.sd),
        "horizontal_mgauss": hundredths(field.horizontal_mgauss.value),
        "horizontal_sd_mgauss": hundredths(field.horizontal_mgauss.sd),
    });
    if let Some(warning) = field.warning() {
        all["warning"] = warning.into();
    }
    all
}
