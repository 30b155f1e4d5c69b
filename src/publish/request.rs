//! What a client asks: the requests of the gpsd dialect.

use std::ops::RangeInclusive;

use serde::de::DeserializeOwned;
use serde_json::{Map, Value};

use super::gpsd::WatchPolicy;

/// How much of a request that is not understood its error repeats, characters.
const QUOTED: usize = 60;

/// Keys of a `?WATCH` that are headingd's or have a meaning here.
const KEYS: [&str; 8] = [
    "enable",
    "json",
    "nmea",
    "rate_hz",
    "state",
    "calibration",
    "readings",
    "device",
];

/// What a client may ask for. It never gets more headings than there are readings.
const RATES_HZ: RangeInclusive<f64> = 0.1..=1000.0;

/// What else gpsd 3.22 knows there: its clients may send it, and it changes nothing.
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

/// A change to a client's policy; what is `None` stays as it is.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WatchRequest {
    /// Whether anything is sent unasked.
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

impl WatchRequest {
    /// Changes `policy` accordingly. With each `enable` headings go out as `ATT` unless `json` is set to false, or as NMEA
    /// 0183 alone unless it is set to true; states, calibrations and raw readings come beside them.
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

/// The argument of `?WATCH=`. As in gpsd, `enable` is true unless it is said not to be. An unknown key is an error: one
/// that is misspelt would leave its sender to wait for what never comes.
fn watch(argument: &str) -> Result<WatchRequest, String> {
    let object: Map<String, Value> = serde_json::from_str(argument)
        .map_err(|error| format!("invalid WATCH: not a JSON object: {error}"))?;
    if let Some(key) = object
        .keys()
        .find(|key| !KEYS.iter().chain(&GPSD_KEYS).any(|known| key == known))
    {
        return Err(format!(
            "invalid WATCH: unknown key {:?}; known are {}, and gpsd's own",
            key.chars().take(QUOTED).collect::<String>(),
            KEYS.join(", ")
        ));
    }
    let flag = |key| value(&object, key, "true or false", |_: &bool| true);
    let right_rate = "from 0.1 to 1000 headings a second";
    let device = value(&object, "device", "a string", |_: &String| true)?;
    Ok(WatchRequest {
        enable: flag("enable")?.unwrap_or(true),
        json: flag("json")?,
        nmea: flag("nmea")?,
        rate_hz: value(&object, "rate_hz", right_rate, |hz| RATES_HZ.contains(hz))?,
        calibration: flag("calibration")?,
        state: flag("state")?,
        readings: flag("readings")?,
        // An empty one is all devices, to gpsd.
        device: device.filter(|path| !path.is_empty()),
    })
}

/// The value of a key, if it is there; `right` says what it must be, to the client.
fn value<T: DeserializeOwned>(
    object: &Map<String, Value>,
    key: &str,
    right: &str,
    is_right: impl FnOnce(&T) -> bool,
) -> Result<Option<T>, String> {
    let Some(found) = object.get(key) else {
        return Ok(None);
    };
    let value = T::deserialize(found).ok().filter(is_right);
    value.map(Some).ok_or_else(|| {
        let found: String = found.to_string().chars().take(QUOTED).collect();
        format!("invalid WATCH: {key} is {found}, but must be {right}")
    })
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
        for wrong in ["0", "-1", "1e9", "\"5\"", "true", "null"] {
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
        // So does gpsd's own library from 3.24 on, for all devices.
        assert_eq!(watched("?WATCH={\"device\":\"\"}").device, None);
        assert_eq!(
            parse("?WATCH={\"enable\":true,\"calibratoin\":true}"),
            Err(
                "invalid WATCH: unknown key \"calibratoin\"; known are enable, json, nmea, rate_hz, state, calibration, \
                 readings, device, and gpsd's own"
                    .into()
            )
        );
        assert_eq!(
            parse("?WATCH={\"json\":\"yes\"}"),
            Err("invalid WATCH: json is \"yes\", but must be true or false".into())
        );
        let wrong = parse("?WATCH={\"device\":1}").unwrap_err();
        assert!(wrong.contains("device is 1"), "{wrong}");
        for text in ["?WATCH=", "?POLL=1", "?DEVICE={}", "?poll"] {
            assert!(parse(text).is_err(), "{text}");
        }
    }
}
