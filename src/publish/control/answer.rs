//! The answer to one request.

use serde::Serialize;
use serde_json::{Map, Value};

/// What a client is told: whether it was done, a code, a sentence, and whatever else was asked for.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Answer {
    /// Whether what was asked was done, and is kept where it is to be kept.
    pub ok: bool,
    /// For programs: `ok`, or why not.
    pub code: &'static str,
    pub message: String,
    #[serde(flatten)]
    pub more: Map<String, Value>,
}

impl Answer {
    pub fn done(message: impl Into<String>) -> Self {
        Self {
            ok: true,
            code: "ok",
            message: message.into(),
            more: Map::new(),
        }
    }

    pub fn refused(code: &'static str, message: impl Into<String>) -> Self {
        Self {
            ok: false,
            code,
            ..Self::done(message)
        }
    }

    /// Adds a key; null means unknown, and is left out.
    pub fn with(mut self, key: &str, value: impl Into<Value>) -> Self {
        let value = value.into();
        if !value.is_null() {
            self.more.insert(key.to_owned(), value);
        }
        self
    }

    /// Adds all keys of `what`, without nulls.
    pub(crate) fn with_all(mut self, what: &impl Serialize) -> Self {
        // What a command reads can always be written.
        let mut value = serde_json::to_value(what).unwrap_or_default();
        leave_out_null(&mut value);
        if let Value::Object(mut keys) = value {
            self.more.append(&mut keys);
        }
        self
    }

    pub(super) fn line(&self) -> String {
        // A map with text for keys can always be written.
        let mut line = serde_json::to_string(self).unwrap_or_default();
        line.push('\n');
        line
    }
}

fn leave_out_null(value: &mut Value) {
    match value {
        Value::Object(keys) => {
            keys.retain(|_, value| !value.is_null());
            keys.values_mut().for_each(leave_out_null);
        }
        Value::Array(all) => all.iter_mut().for_each(leave_out_null),
        _ => {}
    }
}
