//! What a client asks: the requests of the gpsd dialect.

use std::ops::RangeInclusive;

use serde::Deserialize;
use serde_json::{Map, Value, json};

use super::gpsd::WatchPolicy;

/// How much of a request that is not understood its error repeats, characters.
const QUOTED: usize = 60;

/// What a client may ask for. It never gets more headings than there are readings.
const RATES_HZ: RangeInclusive<f64> = 0.1..=1000.0;

/// What else gpsd 3.22 knows in a `?WATCH`: its clients may send it, and it changes nothing.
const GPSD_KEYS: [&str; 7] = [
    "class", "pps", "raw", "remote", "scaled", "split24", "timing",
];

/// One request.
#[derive(Clone, Debug, PartialEq)]
pub enum ClientRequest {
    /// `?WATCH;`: what is being sent?
    Policy,
    /// `?WATCH={…}`: from now on send this.
    Watch(WatchRequest),
    /// `?POLL;`: the latest heading.
    Poll,
    /// `?DEVICES;`: all devices.
    Devices,
    /// `?DEVICE;`: the device.
    Device,
    /// `?VERSION;`: the banner once more.
    Version,
}

/// A change to a client's policy; what is `None` stays as it is. An unknown key is an error: one that is misspelt would
/// leave its sender to wait for what never comes.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WatchRequest {
    /// Whether anything is sent unasked; as in gpsd, unless it is said not to be.
    #[serde(default = "yes")]
    pub enable: bool,
    /// `ATT`.
    pub json: Option<bool>,
    /// NMEA 0183.
    pub nmea: Option<bool>,
    /// So many headings a second at most.
    pub rate_hz: Option<f64>,
    /// `CALIBRATION`.
    pub calibration: Option<bool>,
    /// `STATE`.
    pub state: Option<bool>,
    /// `BOARD` and `READING`.
    pub readings: Option<bool>,
    /// The only device to watch.
    pub device: Option<String>,
}

fn yes() -> bool {
    true
}

impl WatchRequest {
    /// Changes `policy` accordingly. Where `json` is not given, `enable` turns `ATT` on unless NMEA 0183 is on. States,
    /// calibrations and raw readings are independent of both.
    pub fn apply(&self, policy: &mut WatchPolicy) {
        policy.enable = self.enable;
        policy.nmea = self.nmea.unwrap_or(policy.nmea);
        let alone = self.enable && !policy.nmea;
        policy.json = self.json.unwrap_or(policy.json || alone);
        policy.rate_hz = self.rate_hz.or(policy.rate_hz);
        policy.calibration = self.calibration.unwrap_or(policy.calibration);
        policy.state = self.state.unwrap_or(policy.state);
        policy.readings = self.readings.unwrap_or(policy.readings);
    }
}

/// One request without its `;`. An error is a text for the client.
pub(super) fn parse(text: &str) -> Result<ClientRequest, String> {
    let (name, argument) = match text.split_once('=') {
        Some((name, argument)) => (name.trim_end(), Some(argument)),
        None => (text, None),
    };
    match (name, argument) {
        ("?WATCH", None) => Ok(ClientRequest::Policy),
        ("?WATCH", Some(argument)) => watch(argument).map(ClientRequest::Watch),
        ("?POLL", None) => Ok(ClientRequest::Poll),
        ("?DEVICES", None) => Ok(ClientRequest::Devices),
        ("?DEVICE", None) => Ok(ClientRequest::Device),
        ("?VERSION", None) => Ok(ClientRequest::Version),
        ("?DEVICE", Some(_)) => Err(
            "DEVICE cannot be changed by a client: the device is set in headingd's configuration"
                .into(),
        ),
        ("?POLL" | "?DEVICES" | "?VERSION", Some(_)) => {
            Err(format!("{} takes no argument: send {name};", &name[1..]))
        }
        _ => Err(format!(
            "unrecognized request '{}': send ?WATCH={{…}};, ?POLL;, ?DEVICES;, ?DEVICE; or ?VERSION;",
            text.chars().take(QUOTED).collect::<String>()
        )),
    }
}

/// The argument of `?WATCH=`.
fn watch(argument: &str) -> Result<WatchRequest, String> {
    let invalid = |error| format!("invalid WATCH: {error}");
    let mut object: Map<String, Value> = serde_json::from_str(argument).map_err(invalid)?;
    object.retain(|key, _| !GPSD_KEYS.contains(&key.as_str()));
    for (key, value) in &object {
        WatchRequest::deserialize(&json!({ key: value }))
            .map_err(|error| format!("invalid WATCH: {key}: {error}"))?;
    }
    let watch = WatchRequest::deserialize(&Value::from(object)).map_err(invalid)?;
    match watch.rate_hz {
        Some(rate_hz) if !RATES_HZ.contains(&rate_hz) => Err(format!(
            "invalid WATCH: rate_hz is {rate_hz}, but must be from 0.1 to 1000 headings a second"
        )),
        _ => Ok(watch),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn watched(text: &str) -> WatchRequest {
        match parse(text) {
            Ok(ClientRequest::Watch(watch)) => watch,
            other => panic!("{other:?}"),
        }
    }

    /// What a client that asks this is sent, and whether it gets anything unasked.
    fn policy(before: WatchPolicy, text: &str) -> WatchPolicy {
        let mut policy = before;
        watched(text).apply(&mut policy);
        policy
    }

    #[test]
    fn json_is_on_unless_it_is_turned_off() {
        let asked = |text| policy(WatchPolicy::default(), text).json;
        assert!(asked("?WATCH={\"enable\":true}"));
        assert!(asked("?WATCH={}"));
        assert!(asked("?WATCH={\"state\":true}"));
        assert!(asked("?WATCH={\"enable\":true,\"raw\":2}"));
        assert!(!asked("?WATCH={\"state\":true,\"json\":false}"));
        assert!(!asked("?WATCH={\"enable\":false}"));
    }

    #[test]
    fn nmea_comes_alone_unless_json_is_asked_for_too() {
        // As OpenCPN asks, Signal K, and gpspipe -r.
        for asked in [
            "?WATCH={\"class\":\"WATCH\", \"nmea\":true}",
            "?WATCH={\"class\":\"WATCH\",\"nmea\":true,\"json\":false}",
            "?WATCH={\"enable\":true,\"nmea\":true}",
        ] {
            let found = policy(WatchPolicy::default(), asked);
            assert!(found.enable && found.nmea && !found.json, "{asked}");
            // Other keys change nothing of it.
            let then = policy(found, "?WATCH={\"state\":true}");
            assert!(then.nmea && !then.json);
            let both = policy(found, "?WATCH={\"json\":true}");
            assert!(both.nmea && both.json);
            let json = policy(found, "?WATCH={\"nmea\":false}");
            assert!(!json.nmea && json.json);
        }
        let both = policy(
            WatchPolicy::default(),
            "?WATCH={\"nmea\":true,\"json\":true}",
        );
        assert!(both.nmea && both.json);
    }

    #[test]
    fn a_rate_stays_until_there_is_another() {
        let slow = policy(WatchPolicy::default(), "?WATCH={\"rate_hz\":5}");
        assert_eq!(slow.rate_hz, Some(5.0));
        assert_eq!(policy(slow, "?WATCH={}").rate_hz, Some(5.0));
        for wrong in ["0", "-1", "1e9"] {
            let text = format!("?WATCH={{\"rate_hz\":{wrong}}}");
            let message = parse(&text).unwrap_err();
            assert!(message.contains("from 0.1 to 1000"), "{message}");
        }
    }

    #[test]
    fn gpsds_keys_are_taken_and_unknown_keys_and_wrong_types_are_named() {
        let all = "?WATCH={\"class\":\"WATCH\",\"enable\":true,\"json\":true,\"nmea\":false,\"raw\":0,\
                   \"scaled\":false,\"timing\":false,\"split24\":false,\"pps\":true,\"remote\":\"a\"}";
        assert!(parse(all).is_ok());
        assert_eq!(
            parse("?WATCH={\"enable\":true,\"calibratoin\":true}"),
            Err(
                "invalid WATCH: calibratoin: unknown field `calibratoin`, expected one of `enable`, `json`, `nmea`, `rate_hz`, \
                 `calibration`, `state`, `readings`, `device`"
                    .into()
            )
        );
        assert_eq!(
            parse("?WATCH={\"json\":\"yes\"}"),
            Err("invalid WATCH: json: invalid type: string \"yes\", expected a boolean".into())
        );
        for text in ["?WATCH=", "?POLL=1", "?DEVICE={}", "?poll"] {
            assert!(parse(text).is_err(), "{text}");
        }
    }
}
