//! What may be asked at the control socket, as the commands write it and the daemon reads it. Pure.

use std::fmt;

use serde::{Deserialize, Deserializer, Serialize, de::Error as _};
use serde_json::Value;

use super::Answer;
use crate::calibration::policy::Policy;

/// One request: `{"request":"rollback","number":3}`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "request", rename_all = "lowercase", deny_unknown_fields)]
pub enum ControlRequest {
    Status {},
    List {},
    /// One of them, or the active one.
    Show {
        #[serde(default, deserialize_with = "number")]
        #[serde(skip_serializing_if = "Option::is_none")]
        number: Option<u64>,
    },
    Lock {},
    Unlock {},
    /// Make an earlier calibration the active one: this one, or the one before.
    Rollback {
        #[serde(default, deserialize_with = "number")]
        #[serde(skip_serializing_if = "Option::is_none")]
        number: Option<u64>,
    },
    /// Forget a calibration, or the active one, or all.
    Forget {
        #[serde(default, deserialize_with = "number")]
        #[serde(skip_serializing_if = "Option::is_none")]
        number: Option<u64>,
        /// All of this sensor; then without a number.
        #[serde(default)]
        all: bool,
    },
    /// One calibration as a file, or the active one.
    Export {
        #[serde(default, deserialize_with = "number")]
        #[serde(skip_serializing_if = "Option::is_none")]
        number: Option<u64>,
    },
    /// Make the calibration in this file the active one.
    Import {
        /// What export gave.
        file: Value,
    },
    Start {},
    /// Give that up.
    Cancel {},
    /// Calibrate by itself or not from now on; or tell which.
    Mode {
        #[serde(default, deserialize_with = "mode")]
        #[serde(skip_serializing_if = "Option::is_none")]
        mode: Option<Policy>,
    },
    /// Change how the board is mounted, or tell how it is.
    Mounting {
        /// It is level now.
        #[serde(default)]
        level: bool,
        /// Its magnetic heading is this now, degrees.
        #[serde(default, deserialize_with = "heading")]
        #[serde(skip_serializing_if = "Option::is_none")]
        heading_deg: Option<f64>,
        /// It is mounted as the configuration says; then without the other keys.
        #[serde(default)]
        reset: bool,
    },
}

const NAMES: [&str; 13] = [
    "status", "list", "show", "lock", "unlock", "rollback", "forget", "export", "import", "start",
    "cancel", "mode", "mounting",
];

/// How much of what is not understood is repeated, characters.
const QUOTED: usize = 60;
/// The longest sentence about a request that is not understood, characters.
const LONGEST_SENTENCE: usize = 240;

impl ControlRequest {
    /// Reads one line; the error is the answer.
    pub fn parse(line: &[u8]) -> Result<Self, Answer> {
        let malformed = |message: String| {
            Answer::refused(
                "malformed",
                message.chars().take(LONGEST_SENTENCE).collect::<String>(),
            )
        };
        let value: Value = serde_json::from_slice(line).map_err(|error| {
            malformed(format!(
                "not a line of JSON: {error}; send, for instance, {{\"request\":\"status\"}}"
            ))
        })?;
        let Some(name) = value["request"].as_str().map(str::to_owned) else {
            return Err(malformed(
                "a request is an object with its name, as {\"request\":\"status\"}".to_owned(),
            ));
        };
        if !NAMES.contains(&name.as_str()) {
            let name: String = name.chars().take(QUOTED).collect();
            let message = format!(
                "there is no request {name:?}; there are {}",
                NAMES.join(", ")
            );
            return Err(Answer::refused("unknown_request", message));
        }
        let request =
            serde_json::from_value(value).map_err(|error| malformed(format!("{name}: {error}")))?;
        match request {
            Self::Forget {
                number: Some(number),
                all: true,
            } => Err(malformed(format!(
                "either number {number} or all can be forgotten: leave out one of the two keys"
            ))),
            Self::Mounting {
                level,
                heading_deg,
                reset: true,
            } if level || heading_deg.is_some() => Err(malformed(
                "reset cannot be combined with level or heading_deg: send it alone".to_owned(),
            )),
            request => Ok(request),
        }
    }

    /// Whether it may change anything: that is worth a line in the log.
    pub fn changes(&self) -> bool {
        !matches!(
            self,
            Self::Status {}
                | Self::List {}
                | Self::Show { .. }
                | Self::Export { .. }
                | Self::Mode { mode: None }
                | Self::Mounting {
                    level: false,
                    heading_deg: None,
                    reset: false
                }
        )
    }
}

/// In words of the protocol: `rollback 3`, `mode locked`. What is imported is too long.
impl fmt::Display for ControlRequest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let keys = serde_json::to_value(self).unwrap_or_default();
        f.write_str(keys["request"].as_str().unwrap_or_default())?;
        for (key, value) in keys.as_object().into_iter().flatten() {
            match (key.as_str(), value) {
                ("request" | "file", _) | (_, Value::Bool(false)) => {}
                (key, Value::Bool(true)) => write!(f, " {key}")?,
                ("heading_deg", _) => write!(f, " heading {}", value.as_f64().unwrap_or_default())?,
                (_, value) => write!(
                    f,
                    " {}",
                    value.as_str().map_or(value.to_string(), str::to_owned)
                )?,
            }
        }
        Ok(())
    }
}

fn number<'de, D: Deserializer<'de>>(from: D) -> Result<Option<u64>, D::Error> {
    let right = "the number of a calibration, as list shows them";
    told(from, "number", right, |value| {
        value.as_u64().filter(|&number| number > 0)
    })
}

fn mode<'de, D: Deserializer<'de>>(from: D) -> Result<Option<Policy>, D::Error> {
    let right = "\"on\", \"off\" or \"locked\"";
    told(from, "mode", right, |value| Policy::deserialize(value).ok())
}

fn heading<'de, D: Deserializer<'de>>(from: D) -> Result<Option<f64>, D::Error> {
    let right = "the magnetic heading of now, 0 to 360 degrees";
    let within = |degrees: &f64| (0.0..=360.0).contains(degrees);
    told(from, "heading_deg", right, |value| {
        value.as_f64().filter(within)
    })
}

/// A key that is there, and has to be right.
fn told<'de, D: Deserializer<'de>, T>(
    from: D,
    key: &str,
    right: &str,
    read: impl FnOnce(&Value) -> Option<T>,
) -> Result<Option<T>, D::Error> {
    let found = Value::deserialize(from)?;
    let value = read(&found).ok_or_else(|| {
        let found: String = found.to_string().chars().take(QUOTED).collect();
        D::Error::custom(format!("{key} is {found}, but must be {right}"))
    })?;
    Ok(Some(value))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn parse(text: &str) -> Result<ControlRequest, Answer> {
        ControlRequest::parse(text.as_bytes())
    }

    #[test]
    fn every_request_is_known() {
        for name in NAMES.iter().filter(|name| **name != "import") {
            let request = parse(&format!("{{\"request\":{name:?}}}")).unwrap();
            assert_eq!(request.to_string(), *name);
        }
        for (text, words) in [
            (r#"{"request":"show","number":3}"#, "show 3"),
            (r#"{"number":3,"request":"rollback"}"#, "rollback 3"),
            (r#"{"request":"forget"}"#, "forget"),
            (r#"{"request":"forget","all":true}"#, "forget all"),
            (r#"{"request":"forget","number":2,"all":false}"#, "forget 2"),
            (r#"{"request":"mode","mode":"off"}"#, "mode off"),
            (
                r#"{"request":"mounting","level":true,"heading_deg":90}"#,
                "mounting heading 90 level",
            ),
            (r#"{"request":"mounting","reset":true}"#, "mounting reset"),
        ] {
            let request = parse(text).unwrap();
            assert_eq!(request.to_string(), words);
            let written = serde_json::to_string(&request).unwrap();
            assert_eq!(parse(&written), Ok(request), "{written}");
        }
        let import = ControlRequest::Import { file: 7.into() };
        assert_eq!(import.to_string(), "import");
        assert_eq!(parse(r#"{"request":"import","file":7}"#), Ok(import));
    }

    #[test]
    fn whatever_is_wrong_is_named_with_what_would_be_right() {
        let unnamed = "a request is an object with its name";
        for (text, sentence) in [
            ("", "not a line of JSON"),
            ("status", "{\"request\":\"status\"}"),
            ("[]", unnamed),
            ("{}", unnamed),
            (r#"{"request":1}"#, unnamed),
            (r#"{"request":"stat"}"#, "there are status, list"),
            (r#"{"request":"show","number":0}"#, "number is 0"),
            (r#"{"request":"show","number":-1}"#, "number is -1"),
            (
                r#"{"request":"lock","number":1}"#,
                "lock: unknown field `number`",
            ),
            (
                r#"{"request":"forget","number":1,"all":true}"#,
                "either number 1 or all",
            ),
            (
                r#"{"request":"forget","all":"yes"}"#,
                "forget: invalid type: string \"yes\", expected a boolean",
            ),
            (
                r#"{"request":"mode","mode":"of"}"#,
                "\"on\", \"off\" or \"locked\"",
            ),
            (
                r#"{"request":"mounting","heading_deg":361}"#,
                "heading_deg is 361, but must be",
            ),
            (
                r#"{"request":"mounting","level":true,"reset":true}"#,
                "send it alone",
            ),
            (r#"{"request":"import"}"#, "missing field `file`"),
        ] {
            let answer = parse(text).unwrap_err();
            let code = match text.contains("stat\"") {
                true => "unknown_request",
                false => "malformed",
            };
            assert_eq!((answer.ok, answer.code), (false, code), "{text}");
            assert!(answer.message.contains(sentence), "{}", answer.message);
        }
    }

    proptest! {
        #[test]
        fn no_bytes_make_it_panic(bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
            let _ = ControlRequest::parse(&bytes);
        }

        #[test]
        fn neither_does_any_value(text in r#"\{"request":"(show|forget|mode|import|mounting)","(number|all|mode|file|level|heading_deg)":[-0-9a-z."\[\]]{0,9}\}"#) {
            let _ = ControlRequest::parse(text.as_bytes());
        }
    }
}
