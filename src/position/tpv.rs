//! A `TPV` object of a gpsd: time, position, velocity.

use std::time::Duration;

use serde::Deserialize;

use crate::date;
use crate::true_north::{ALTITUDE_M, Position};

/// gpsd's `mode` of a 2D fix, which has latitude and longitude; a 3D fix has the altitude too.
const FIX_2D: u8 = 2;

#[derive(Deserialize)]
struct Tpv {
    class: String,
    #[serde(default)]
    mode: u8,
    time: Option<String>,
    lat: Option<f64>,
    lon: Option<f64>,
    /// Above the ellipsoid, metres; before gpsd 3.20 that was `alt`.
    #[serde(rename = "altHAE")]
    alt_hae: Option<f64>,
    alt: Option<f64>,
}

/// Position, and time since 1970, of a line that has a fix in it.
pub(super) fn read(line: &[u8]) -> Option<(Position, Option<Duration>)> {
    let tpv: Tpv = serde_json::from_slice(line).ok()?;
    if tpv.class != "TPV" || tpv.mode < FIX_2D {
        return None;
    }
    let within = |value: f64, most: f64| (value.abs() <= most).then_some(value);
    let position = Position {
        latitude_deg: within(tpv.lat?, 90.0)?,
        longitude_deg: within(tpv.lon?, 180.0)?,
        altitude_m: tpv
            .alt_hae
            .or(tpv.alt)
            .filter(|altitude_m| ALTITUDE_M.contains(altitude_m))
            .unwrap_or(0.0),
    };
    let time = tpv.time.and_then(|time| date::parse_rfc3339(&time));
    Some((position, time.filter(|time| *time >= date::CREDIBLE)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fix_is_read_and_nothing_else_is() {
        let line = br#"{"class":"TPV","device":"/dev/ttyACM0","mode":3,"time":"2026-11-22T14:00:00.000Z","leapseconds":18,"ept":0.005,"lat":51.08,"lon":-114.13,"altHAE":1100.2,"altMSL":1117.0,"alt":1117.0,"track":10.3}"#;
        let (position, time) = read(line).unwrap();
        let right = Position {
            latitude_deg: 51.08,
            longitude_deg: -114.13,
            altitude_m: 1100.2,
        };
        assert_eq!(position, right);
        assert_eq!(time.unwrap().as_secs(), 1_795_356_000);
        let weeks_ago = br#"{"class":"TPV","mode":3,"time":"2007-04-08T14:00:00.000Z","lat":51.08,"lon":-114.13,"alt":1100.2}"#;
        assert_eq!(read(weeks_ago), Some((right, None)));
        for (line, altitude_m) in [
            (r#"{"class":"TPV","mode":2,"lat":1,"lon":2}"#, Some(0.0)),
            (
                r#"{"class":"TPV","mode":3,"lat":1,"lon":2,"alt":5}"#,
                Some(5.0),
            ),
            (
                r#"{"class":"TPV","mode":3,"lat":1,"lon":2,"alt":1e300}"#,
                Some(0.0),
            ),
            (r#"{"class":"TPV","mode":1,"lat":1,"lon":2}"#, None),
            (r#"{"class":"TPV","mode":3,"lat":91,"lon":2}"#, None),
            (r#"{"class":"TPV","mode":3,"lat":1}"#, None),
            (r#"{"class":"TPV","mode":3,"lat":"1","lon":2}"#, None),
            (r#"{"class":"ATT","mode":3,"lat":1,"lon":2}"#, None),
            (r#"{"class":"TPV","mode":3,"lat":1,"lon":2"#, None),
            ("", None),
        ] {
            let found = read(line.as_bytes()).map(|(position, _)| position.altitude_m);
            assert_eq!(found, altitude_m, "{line}");
        }
    }
}
