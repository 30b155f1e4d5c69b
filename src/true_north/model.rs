//! The earth's field by the World Magnetic Model: what a compass should find at a place and on a day.

use std::time::Duration;

use world_magnetic_model::uom::si::angle::degree;
use world_magnetic_model::uom::si::f32::{Angle, Length, MagneticFluxDensity};
use world_magnetic_model::uom::si::length::meter;
use world_magnetic_model::uom::si::magnetic_flux_density::nanotesla;
use world_magnetic_model::{GeomagneticField, WarningZone};

use crate::date::date;

/// A milligauss is so many nanotesla.
const NANOTESLA: f64 = 100.0;

/// A place on the earth or above it, WGS 84.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Position {
    /// Degrees north of the equator.
    pub latitude_deg: f64,
    /// Degrees east of Greenwich.
    pub longitude_deg: f64,
    /// Metres above the ellipsoid, which is up to 107 m from the level of the sea.
    pub altitude_m: f64,
}

/// A quantity with its standard deviation: the model's own, and that of the rock below, which it does not know.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ValueWithSd {
    /// The model's value.
    pub value: f64,
    /// One standard deviation.
    pub sd: f64,
}

/// The field at a place and on a day.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EarthField {
    /// How far magnetic north is east of true north, degrees.
    pub declination_deg: ValueWithSd,
    /// How far the field points below the horizontal, degrees.
    pub dip_deg: ValueWithSd,
    /// Strength of the whole field, milligauss.
    pub strength_mgauss: ValueWithSd,
    /// Strength of its horizontal part.
    pub horizontal_mgauss: ValueWithSd,
    /// Whether it is near a magnetic pole, where a compass is inaccurate (horizontal field below 60 mG) or not to be relied on
    /// (below 20 mG).
    pub zone: Option<WarningZone>,
}

impl EarthField {
    /// The field there and then.
    ///
    /// # Errors
    ///
    /// The model does not hold on that day, or not at such a place.
    pub fn new(position: &Position, since_1970: Duration) -> Result<Self, String> {
        let field = GeomagneticField::new(
            Length::new::<meter>(position.altitude_m as f32),
            Angle::new::<degree>(position.latitude_deg as f32),
            Angle::new::<degree>(position.longitude_deg as f32),
            date(since_1970),
        )
        .map_err(|error| {
            format!("the World Magnetic Model of this headingd has no answer: {error}")
        })?;
        Ok(Self {
            declination_deg: angle(field.declination(), field.declination_uncertainty()),
            dip_deg: angle(field.inclination(), field.inclination_uncertainty()),
            strength_mgauss: strength(field.f(), field.f_uncertainty()),
            horizontal_mgauss: strength(field.h(), field.h_uncertainty()),
            zone: field.declination_warning(),
        })
    }
}

fn angle(value: Angle, sd: Angle) -> ValueWithSd {
    let degrees = |angle: Angle| f64::from(angle.get::<degree>());
    ValueWithSd {
        value: degrees(value),
        sd: degrees(sd),
    }
}

fn strength(value: MagneticFluxDensity, sd: MagneticFluxDensity) -> ValueWithSd {
    let mgauss = |field: MagneticFluxDensity| f64::from(field.get::<nanotesla>()) / NANOTESLA;
    ValueWithSd {
        value: mgauss(value),
        sd: mgauss(sd),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::date::parse_rfc3339;

    #[test]
    fn what_it_does_not_know_is_an_error_and_near_the_poles_it_warns() {
        let moment = |text: &str| parse_rfc3339(text).unwrap();
        let at = |latitude_deg, longitude_deg| Position {
            latitude_deg,
            longitude_deg,
            altitude_m: 0.0,
        };
        let now = moment("2026-11-21T00:00:00Z");
        for (day, place, part) in [
            ("2019-12-31", at(51.0, -114.0), "(2020-01-01 to 2029-12-31)"),
            ("2030-01-01", at(51.0, -114.0), "(2020-01-01 to 2029-12-31)"),
            ("2026-11-21", at(91.0, 0.0), "invalid latitude"),
            ("2026-11-21", at(0.0, 181.0), "invalid longitude"),
            ("2026-11-21", at(f64::NAN, 0.0), "invalid latitude"),
        ] {
            let moment = moment(&format!("{day}T00:00:00Z"));
            let error = EarthField::new(&place, moment).unwrap_err();
            assert!(error.contains(part), "{error}");
        }
        for (place, zone) in [
            (at(51.0, -114.0), None),
            (at(80.0, 135.0), Some(WarningZone::CautionZone)),
            (at(86.0, 139.0), Some(WarningZone::BlackoutZone)),
            (at(-64.0, 136.0), Some(WarningZone::BlackoutZone)),
        ] {
            let field = EarthField::new(&place, now).unwrap();
            assert_eq!(field.zone, zone, "{place:?}: {field:?}");
        }
    }
}
