//! What may be asked at the control socket. Pure.

use std::fmt;

use serde_json::{Map, Value};

use super::Answer;
use crate::calibration::policy::Policy;
use crate::store::history::Forget;

/// One request.
#[derive(Clone, Debug, PartialEq)]
pub enum ControlRequest {
    /// How everything stands.
    Status,
    /// All calibrations kept of this sensor.
    List,
    /// One of them, or the active one.
    Show(Option<u64>),
    /// Lock the active calibration.
    Lock,
    /// Unlock it.
    Unlock,
    /// Make an earlier calibration the active one: this one, or the one before.
    Rollback(Option<u64>),
    /// Forget calibrations.
    Forget(Forget),
    /// One calibration as a file, or the active one.
    Export(Option<u64>),
    /// Make the calibration in this file the active one.
    Import(Value),
    /// Calibrate on the next motion.
    Start,
    /// Give that up.
    Cancel,
    /// Calibrate by itself or not from now on; or tell which.
    Mode(Option<Policy>),
    /// Change how the board is mounted, or tell how it is.
    Mounting(Option<Mount>),
}

/// A change of how the board is mounted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Mount {
    /// It is level now, or its magnetic heading is this now, degrees; at least one of both.
    Set {
        /// Whether it is level.
        level: bool,
        /// Its heading.
        heading_deg: Option<f64>,
    },
    /// It is mounted as the configuration says.
    Reset,
}

/// All names, as a refusal lists them.
const NAMES: &str = "status, list, show, lock, unlock, rollback, forget, export, import, start, cancel, mode, \
     mounting";

/// How much of what is not understood is repeated, characters.
const QUOTED: usize = 60;

impl ControlRequest {
    /// Reads one line; the error is the answer.
    ///
    /// # Errors
    ///
    /// The refusal that answers a line that is no request.
    pub fn parse(line: &[u8]) -> Result<Self, Answer> {
        let malformed = |message: String| Answer::refused("malformed", message);
        let value: Value = serde_json::from_slice(line).map_err(|error| {
            malformed(format!(
                "not a line of JSON: {error}; send, for instance, {{\"request\":\"status\"}}"
            ))
        })?;
        let Value::Object(mut keys) = value else {
            return Err(malformed(
                "a request is an object, as {\"request\":\"status\"}".to_owned(),
            ));
        };
        let name = match keys.remove("request") {
            Some(Value::String(name)) => name,
            Some(other) => {
                return Err(malformed(wrong("request", &other, "a name in quotes")));
            }
            None => return Err(malformed("the key \"request\" is missing".to_owned())),
        };
        let request = match name.as_str() {
            "status" => Self::Status,
            "list" => Self::List,
            "show" => Self::Show(number(&mut keys)?),
            "lock" => Self::Lock,
            "unlock" => Self::Unlock,
            "rollback" => Self::Rollback(number(&mut keys)?),
            "forget" => Self::Forget(forget(&mut keys)?),
            "export" => Self::Export(number(&mut keys)?),
            "import" => Self::Import(keys.remove("file").ok_or_else(|| {
                malformed("the key \"file\" is missing: what export gave".to_owned())
            })?),
            "start" => Self::Start,
            "cancel" => Self::Cancel,
            "mode" => Self::Mode(mode(&mut keys)?),
            "mounting" => Self::Mounting(mount(&mut keys)?),
            other => {
                let other: String = other.chars().take(QUOTED).collect();
                return Err(Answer::refused(
                    "unknown_request",
                    format!("there is no request {other:?}; there are {NAMES}"),
                ));
            }
        };
        match keys.keys().next() {
            None => Ok(request),
            Some(key) => {
                let key: String = key.chars().take(QUOTED).collect();
                Err(malformed(format!("{name} takes no key {key:?}")))
            }
        }
    }

    /// Whether it may change anything: that is worth a line in the log.
    pub fn changes(&self) -> bool {
        !matches!(
            self,
            Self::Status
                | Self::List
                | Self::Show(_)
                | Self::Export(_)
                | Self::Mode(None)
                | Self::Mounting(None)
        )
    }
}

/// In words of the protocol: `rollback 3`, `mode locked`. What is imported is too long.
impl fmt::Display for ControlRequest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (name, number) = match self {
            Self::Status => ("status", None),
            Self::List => ("list", None),
            Self::Show(number) => ("show", *number),
            Self::Lock => ("lock", None),
            Self::Unlock => ("unlock", None),
            Self::Rollback(number) => ("rollback", *number),
            Self::Forget(Forget::Active) => ("forget", None),
            Self::Forget(Forget::Number(number)) => ("forget", Some(*number)),
            Self::Forget(Forget::All) => ("forget all", None),
            Self::Export(number) => ("export", *number),
            Self::Import(_) => ("import", None),
            Self::Start => ("start", None),
            Self::Cancel => ("cancel", None),
            Self::Mode(None) => ("mode", None),
            Self::Mode(Some(mode)) => return write!(f, "mode {}", mode.word()),
            Self::Mounting(None) => ("mounting", None),
            Self::Mounting(Some(Mount::Reset)) => ("mounting reset", None),
            Self::Mounting(Some(Mount::Set { level, heading_deg })) => {
                f.write_str("mounting")?;
                if *level {
                    f.write_str(" level")?;
                }
                return match heading_deg {
                    Some(heading_deg) => write!(f, " heading {heading_deg}"),
                    None => Ok(()),
                };
            }
        };
        match number {
            Some(number) => write!(f, "{name} {number}"),
            None => f.write_str(name),
        }
    }
}

fn number(keys: &mut Map<String, Value>) -> Result<Option<u64>, Answer> {
    let Some(value) = keys.remove("number") else {
        return Ok(None);
    };
    let right = "the number of a calibration, as list shows them";
    let number = value.as_u64().filter(|&number| number > 0);
    number
        .map(Some)
        .ok_or_else(|| Answer::refused("malformed", wrong("number", &value, right)))
}

fn forget(keys: &mut Map<String, Value>) -> Result<Forget, Answer> {
    let number = number(keys)?;
    match (number, flag(keys, "all")?) {
        (None, true) => Ok(Forget::All),
        (Some(number), true) => Err(Answer::refused(
            "malformed",
            format!(
                "either number {number} or all can be forgotten: leave out one of the two keys"
            ),
        )),
        (Some(number), false) => Ok(Forget::Number(number)),
        (None, false) => Ok(Forget::Active),
    }
}

fn flag(keys: &mut Map<String, Value>, key: &str) -> Result<bool, Answer> {
    match keys.remove(key) {
        None => Ok(false),
        Some(Value::Bool(flag)) => Ok(flag),
        Some(other) => {
            let message = wrong(key, &other, "true or false");
            Err(Answer::refused("malformed", message))
        }
    }
}

fn mount(keys: &mut Map<String, Value>) -> Result<Option<Mount>, Answer> {
    let (level, reset) = (flag(keys, "level")?, flag(keys, "reset")?);
    let heading = keys.remove("heading_deg");
    let heading_deg = heading.map(|value| {
        let degrees = value
            .as_f64()
            .filter(|degrees| (0.0..=360.0).contains(degrees));
        let right = "the magnetic heading of now, 0 to 360 degrees";
        degrees.ok_or_else(|| Answer::refused("malformed", wrong("heading_deg", &value, right)))
    });
    match (reset, level, heading_deg.transpose()?) {
        (true, false, None) => Ok(Some(Mount::Reset)),
        (true, ..) => Err(Answer::refused(
            "malformed",
            "reset leaves nothing to be level or ahead: send it alone",
        )),
        (false, false, None) => Ok(None),
        (false, level, heading_deg) => Ok(Some(Mount::Set { level, heading_deg })),
    }
}

fn mode(keys: &mut Map<String, Value>) -> Result<Option<Policy>, Answer> {
    let Some(value) = keys.remove("mode") else {
        return Ok(None);
    };
    let known = |word: &str| Policy::ALL.into_iter().find(|mode| mode.word() == word);
    let mode = value.as_str().and_then(known);
    mode.map(Some).ok_or_else(|| {
        let right = "\"on\", \"off\" or \"locked\"";
        Answer::refused("malformed", wrong("mode", &value, right))
    })
}

fn wrong(key: &str, found: &Value, right: &str) -> String {
    let found: String = found.to_string().chars().take(QUOTED).collect();
    format!("{key} is {found}, but must be {right}")
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
        for name in NAMES.split(", ").filter(|name| *name != "import") {
            let request = parse(&format!("{{\"request\":{name:?}}}")).unwrap();
            assert_eq!(request.to_string(), name);
        }
        for (text, request, words) in [
            (
                r#"{"request":"show","number":3}"#,
                ControlRequest::Show(Some(3)),
                "show 3",
            ),
            (
                r#"{"number":3,"request":"rollback"}"#,
                ControlRequest::Rollback(Some(3)),
                "rollback 3",
            ),
            (
                r#"{"request":"forget"}"#,
                ControlRequest::Forget(Forget::Active),
                "forget",
            ),
            (
                r#"{"request":"forget","all":true}"#,
                ControlRequest::Forget(Forget::All),
                "forget all",
            ),
            (
                r#"{"request":"forget","number":2,"all":false}"#,
                ControlRequest::Forget(Forget::Number(2)),
                "forget 2",
            ),
            (
                r#"{"request":"mode","mode":"off"}"#,
                ControlRequest::Mode(Some(Policy::Off)),
                "mode off",
            ),
            (
                r#"{"request":"mounting","level":true,"heading_deg":90}"#,
                ControlRequest::Mounting(Some(Mount::Set {
                    level: true,
                    heading_deg: Some(90.0),
                })),
                "mounting level heading 90",
            ),
            (
                r#"{"request":"mounting","reset":true}"#,
                ControlRequest::Mounting(Some(Mount::Reset)),
                "mounting reset",
            ),
            (
                r#"{"request":"import","file":7}"#,
                ControlRequest::Import(7.into()),
                "import",
            ),
        ] {
            assert_eq!(request.to_string(), words);
            assert_eq!(parse(text), Ok(request));
        }
    }

    #[test]
    fn whatever_is_wrong_is_named_with_what_would_be_right() {
        for (text, code, sentence) in [
            ("", "malformed", "not a line of JSON"),
            ("status", "malformed", "{\"request\":\"status\"}"),
            ("[]", "malformed", "a request is an object"),
            ("{}", "malformed", "\"request\" is missing"),
            (
                r#"{"request":1}"#,
                "malformed",
                "request is 1, but must be a name",
            ),
            (
                r#"{"request":"stat"}"#,
                "unknown_request",
                "there are status, list",
            ),
            (
                r#"{"request":"show","number":0}"#,
                "malformed",
                "number is 0",
            ),
            (
                r#"{"request":"show","number":-1}"#,
                "malformed",
                "number is -1",
            ),
            (
                r#"{"request":"lock","number":1}"#,
                "malformed",
                "lock takes no key \"number\"",
            ),
            (
                r#"{"request":"forget","number":1,"all":true}"#,
                "malformed",
                "either number 1 or all",
            ),
            (
                r#"{"request":"forget","all":"yes"}"#,
                "malformed",
                "all is \"yes\", but must be true or false",
            ),
            (
                r#"{"request":"mode","mode":"of"}"#,
                "malformed",
                "\"on\", \"off\" or \"locked\"",
            ),
            (
                r#"{"request":"mounting","heading_deg":361}"#,
                "malformed",
                "heading_deg is 361, but must be",
            ),
            (
                r#"{"request":"mounting","level":true,"reset":true}"#,
                "malformed",
                "send it alone",
            ),
            (
                r#"{"request":"import"}"#,
                "malformed",
                "\"file\" is missing",
            ),
        ] {
            let answer = parse(text).unwrap_err();
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
