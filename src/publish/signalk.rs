//! Headings as Signal K deltas. Pure: no I/O and no clock.

use std::f64::consts::TAU;

use serde_json::{Value, json};

use super::gpsd::LINE_END;
use crate::frame::rounded;
use crate::heading::Heading;

/// A heading as a line of Signal K: angles in radians; starboard down, bow up and turns to starboard are positive. Empty where
/// there is no heading to steer by. `time` is that of the reading, RFC 3339 in UTC, if it is known.
pub fn delta(heading: &Heading, time: Option<&str>) -> String {
    let Some(magnetic_deg) = heading.magnetic_deg() else {
        return String::new();
    };
    let mut values = Vec::new();
    let mut put = |path: &str, value: Option<Value>| {
        if let Some(value) = value {
            values.push(json!({"path": format!("navigation.{path}"), "value": value}));
        }
    };
    put("headingMagnetic", bearing(magnetic_deg));
    put("headingTrue", heading.true_deg().and_then(bearing));
    put(
        "magneticVariation",
        heading.declination_deg.and_then(radians),
    );
    let turn_deg_s = heading.turn_deg_min.map(|turn| turn / 60.0);
    put("rateOfTurn", turn_deg_s.and_then(radians));
    let (pitch, roll) = (heading.pitch_deg, heading.roll_deg);
    let attitude = pitch.and_then(radians).zip(roll.and_then(radians));
    put(
        "attitude",
        attitude.map(|(pitch, roll)| json!({"pitch": pitch, "roll": roll})),
    );
    let mut update = json!({"source": {"label": "headingd"}, "values": values});
    if let Some(time) = time {
        update["timestamp"] = time.into();
    }
    json!({"updates": [update]}).to_string() + LINE_END
}

/// To a microradian. `None` where a number is not finite.
fn radians(degrees: f64) -> Option<Value> {
    finite(degrees.to_radians())
}

/// The same within a turn.
fn bearing(degrees: f64) -> Option<Value> {
    // Rounding makes no whole turn of it: 2π itself is rounded down.
    finite(degrees.to_radians().rem_euclid(TAU))
}

fn finite(number: f64) -> Option<Value> {
    let rounded = rounded(number, 6);
    rounded.is_finite().then(|| rounded.into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::condition::Condition;

    #[test]
    fn what_is_known_is_in_the_delta_and_nothing_without_a_heading() {
        let mut one = Heading {
            condition: Condition::Good,
            fused_deg: Some(180.0),
            roll_deg: Some(1.0),
            ..Heading::default()
        };
        assert_eq!(
            delta(&one, None),
            "{\"updates\":[{\"source\":{\"label\":\"headingd\"},\"values\":[{\"path\":\"navigation.headingMagnetic\",\
             \"value\":3.141593}]}]}\r\n"
        );
        one.fused_deg = Some(359.9999);
        one.declination_deg = Some(-20.0);
        one.pitch_deg = Some(-0.0);
        one.turn_deg_min = Some(-60.0);
        let found: Value =
            serde_json::from_str(&delta(&one, Some("2026-11-21T10:00:00.000Z"))).unwrap();
        let update = &found["updates"][0];
        assert_eq!(update["timestamp"], "2026-11-21T10:00:00.000Z");
        let right = json!([
            {"path": "navigation.headingMagnetic", "value": 6.283184},
            {"path": "navigation.headingTrue", "value": 5.934118},
            {"path": "navigation.magneticVariation", "value": -0.349066},
            {"path": "navigation.rateOfTurn", "value": -0.017453},
            {"path": "navigation.attitude", "value": {"pitch": 0.0, "roll": 0.017453}},
        ]);
        assert_eq!(update["values"], right);
        one.condition = Condition::Stale;
        assert_eq!(delta(&one, None), "");
    }
}
