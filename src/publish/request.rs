//! What a client asks: the requests of the gpsd dialect, out of whatever bytes arrive.
//!
//! A request ends at a `;` outside a JSON string, or at the end of its line, so several may share a line
//! and one may arrive in pieces.

use serde_json::{Map, Value};

use super::gpsd::Policy;

/// How much of a request that is not understood its error repeats, characters.
const QUOTED: usize = 60;

/// Keys of a `?WATCH` that are headingd's or have a meaning here.
const KEYS: [&str; 6] = [
    "enable",
    "json",
    "state",
    "calibration",
    "readings",
    "device",
];

/// What else gpsd 3.22 knows there: its clients may send it, and it changes nothing.
const GPSD_KEYS: [&str; 8] = [
    "class", "nmea", "pps", "raw", "remote", "scaled", "split24", "timing",
];

/// One request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Request {
    /// `?WATCH;`: what is being sent?
    Policy,
    /// `?WATCH={…}`: from now on send this.
    Watch(Watch),
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
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Watch {
    /// Whether anything is sent unasked.
    pub enable: bool,
    /// `ATT`.
    pub json: Option<bool>,
    /// `CALIBRATION`.
    pub calibration: Option<bool>,
    /// `STATE`.
    pub state: Option<bool>,
    /// `BOARD` and `READING`.
    pub readings: Option<bool>,
    /// The only device to watch.
    pub device: Option<String>,
}

impl Watch {
    /// Changes `policy` accordingly.
    pub fn apply(&self, policy: &mut Policy) {
        policy.enable = self.enable;
        policy.json = self.json.unwrap_or(policy.json);
        policy.calibration = self.calibration.unwrap_or(policy.calibration);
        policy.state = self.state.unwrap_or(policy.state);
        policy.readings = self.readings.unwrap_or(policy.readings);
    }
}

/// Cuts a client's bytes into requests. It holds no more than one unfinished request, of a bounded length.
#[derive(Debug)]
pub struct Requests {
    pending: Vec<u8>,
    limit_bytes: usize,
    in_string: bool,
    escaped: bool,
    skipping: bool,
}

impl Requests {
    /// Requests of up to `limit_bytes` bytes each.
    pub fn new(limit_bytes: usize) -> Self {
        Self {
            pending: Vec::new(),
            limit_bytes,
            in_string: false,
            escaped: false,
            skipping: false,
        }
    }

    /// The next request that `bytes` complete; what belongs to it is taken from them, and they are all taken where there
    /// is none. One that cannot be understood is an error text for the client; after one that is too long everything up
    /// to the next newline is thrown away.
    pub fn next(&mut self, bytes: &mut &[u8]) -> Option<Result<Request, String>> {
        while let Some((&byte, rest)) = bytes.split_first() {
            *bytes = rest;
            let found = if byte == b'\n' {
                self.skipping = false;
                self.finish()
            } else if self.skipping {
                None
            } else if byte == b';' && !self.in_string {
                self.finish()
            } else if self.pending.len() == self.limit_bytes {
                self.begin_anew();
                self.skipping = true;
                Some(Err(format!(
                    "the request is longer than {} bytes; the rest of its line is ignored",
                    self.limit_bytes
                )))
            } else {
                self.push(byte);
                None
            };
            if found.is_some() {
                return found;
            }
        }
        None
    }

    fn push(&mut self, byte: u8) {
        self.pending.push(byte);
        if self.escaped {
            self.escaped = false;
        } else if self.in_string && byte == b'\\' {
            self.escaped = true;
        } else if byte == b'"' {
            self.in_string = !self.in_string;
        }
    }

    /// The request that the end of the stream completes, if there is one: `printf '?POLL'` sends no newline.
    pub fn finish(&mut self) -> Option<Result<Request, String>> {
        // Whoever sends nothing but ends shall cost nothing.
        if self.pending.is_empty() {
            return None;
        }
        let text = String::from_utf8_lossy(&self.pending);
        let text = text.trim();
        let request = (!text.is_empty()).then(|| parse(text));
        self.begin_anew();
        request
    }

    fn begin_anew(&mut self) {
        self.pending.clear();
        self.in_string = false;
        self.escaped = false;
    }
}

/// One request without its `;`.
fn parse(text: &str) -> Result<Request, String> {
    let (name, argument) = match text.split_once('=') {
        Some((name, argument)) => (name.trim_end(), Some(argument)),
        None => (text, None),
    };
    match (name, argument) {
        ("?WATCH", None) => Ok(Request::Policy),
        ("?WATCH", Some(argument)) => watch(argument).map(Request::Watch),
        ("?POLL", None) => Ok(Request::Poll),
        ("?DEVICES", None) => Ok(Request::Devices),
        ("?DEVICE", None) => Ok(Request::Device),
        ("?VERSION", None) => Ok(Request::Version),
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
fn watch(argument: &str) -> Result<Watch, String> {
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
    let mut watch = Watch {
        enable: flag(&object, "enable")?.unwrap_or(true),
        json: flag(&object, "json")?,
        calibration: flag(&object, "calibration")?,
        state: flag(&object, "state")?,
        readings: flag(&object, "readings")?,
        device: match object.get("device") {
            None => None,
            Some(Value::String(path)) => Some(path.clone()),
            Some(other) => return Err(wrong("device", other, "a string")),
        },
    };
    // Headings go out unless json is set to false; states, calibrations and raw readings come beside them. There is
    // no other format: whoever asks for one gets this, and the answer says so.
    if watch.enable {
        watch.json = watch.json.or(Some(true));
    }
    Ok(watch)
}

fn flag(object: &Map<String, Value>, key: &str) -> Result<Option<bool>, String> {
    match object.get(key) {
        None => Ok(None),
        Some(Value::Bool(flag)) => Ok(Some(*flag)),
        Some(other) => Err(wrong(key, other, "true or false")),
    }
}

fn wrong(key: &str, found: &Value, right: &str) -> String {
    let found: String = found.to_string().chars().take(QUOTED).collect();
    format!("invalid WATCH: {key} is {found}, but must be {right}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn fed(requests: &mut Requests, mut bytes: &[u8]) -> Vec<Result<Request, String>> {
        let found = std::iter::from_fn(|| requests.next(&mut bytes)).collect();
        assert!(bytes.is_empty());
        found
    }

    fn requests(text: &str) -> Vec<Result<Request, String>> {
        fed(&mut Requests::new(1024), text.as_bytes())
    }

    fn only(text: &str) -> Result<Request, String> {
        let mut all = requests(text);
        assert_eq!(all.len(), 1, "{all:?}");
        all.remove(0)
    }

    fn watched(text: &str) -> Watch {
        match only(text) {
            Ok(Request::Watch(watch)) => watch,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn every_request_is_known_with_and_without_its_semicolon() {
        for (text, request) in [
            ("?WATCH", Request::Policy),
            ("?POLL", Request::Poll),
            ("?DEVICES", Request::Devices),
            ("?DEVICE", Request::Device),
            ("?VERSION", Request::Version),
        ] {
            for end in [";", "\n", ";\n", ";\r\n", "\r\n", " ; \r\n\r\n"] {
                assert_eq!(only(&format!("{text}{end}")), Ok(request.clone()));
            }
        }
    }

    #[test]
    fn several_requests_share_a_line_and_a_string_may_hold_a_semicolon() {
        assert_eq!(
            requests("?POLL;?WATCH={\"device\":\"a;\\\"b\"}; ?VERSION\n"),
            [
                Ok(Request::Poll),
                Ok(Request::Watch(Watch {
                    enable: true,
                    json: Some(true),
                    device: Some("a;\"b".into()),
                    ..Watch::default()
                })),
                Ok(Request::Version)
            ]
        );
    }

    #[test]
    fn json_is_on_unless_it_is_turned_off() {
        assert_eq!(watched("?WATCH={\"enable\":true};").json, Some(true));
        assert_eq!(watched("?WATCH={};").json, Some(true));
        assert_eq!(watched("?WATCH={\"state\":true};").json, Some(true));
        let states = watched("?WATCH={\"state\":true,\"json\":false};");
        assert_eq!((states.state, states.json), (Some(true), Some(false)));
        for other in ["\"nmea\":true", "\"raw\":2"] {
            let watch = watched(&format!("?WATCH={{\"enable\":true,{other}}};"));
            assert_eq!(watch.json, Some(true), "{other}");
        }
        let none = watched("?WATCH={\"enable\":true,\"nmea\":true,\"json\":false};");
        assert_eq!(none.json, Some(false));
        let off = watched("?WATCH={\"enable\":false};");
        assert_eq!((off.enable, off.json), (false, None));
    }

    #[test]
    fn gpsds_keys_are_taken_and_unknown_keys_and_wrong_types_are_named() {
        let all = "?WATCH={\"class\":\"WATCH\",\"enable\":true,\"json\":true,\"nmea\":false,\"raw\":0,\
                   \"scaled\":false,\"timing\":false,\"split24\":false,\"pps\":true,\"remote\":\"a\"};";
        assert!(only(all).is_ok());
        assert_eq!(
            only("?WATCH={\"enable\":true,\"calibratoin\":true};"),
            Err(
                "invalid WATCH: unknown key \"calibratoin\"; known are enable, json, state, calibration, readings, \
                 device, and gpsd's own"
                    .into()
            )
        );
        assert_eq!(
            only("?WATCH={\"json\":\"yes\"};"),
            Err("invalid WATCH: json is \"yes\", but must be true or false".into())
        );
        assert!(
            only("?WATCH={\"device\":1};")
                .unwrap_err()
                .contains("device is 1")
        );
        for text in [
            "?WATCH=;",
            "?WATCH=[];",
            "?WATCH={\n",
            "?POLL=1;",
            "?DEVICE={};",
            "?poll;",
            "\u{0};",
        ] {
            assert!(only(text).is_err(), "{text}");
        }
    }

    #[test]
    fn an_overlong_request_is_one_error_and_the_next_line_is_read_again() {
        let mut requests = Requests::new(16);
        assert_eq!(fed(&mut requests, &[b'x'; 16]), []);
        assert_eq!(fed(&mut requests, &[b'x'; 5000]).len(), 1);
        assert_eq!(fed(&mut requests, b"?POLL;\"\n?POLL;"), [Ok(Request::Poll)]);
        assert!(requests.pending.capacity() <= 64);
    }

    proptest! {
        #[test]
        fn any_bytes_in_any_pieces_give_the_same_and_never_panic(
            bytes in proptest::collection::vec(
                prop_oneof![any::<u8>(), proptest::sample::select(b"?WATCH={\"enable\":true};\\\n".to_vec())],
                0..200,
            ),
            cut in 0usize..200,
            limit in 1usize..64,
        ) {
            let mut whole = Requests::new(limit);
            let mut expected = fed(&mut whole, &bytes);
            expected.extend(whole.finish());
            let (head, tail) = bytes.split_at(cut.min(bytes.len()));
            let mut pieces = Requests::new(limit);
            let mut found = fed(&mut pieces, head);
            found.extend(fed(&mut pieces, tail));
            found.extend(pieces.finish());
            prop_assert_eq!(found, expected);
        }
    }
}
