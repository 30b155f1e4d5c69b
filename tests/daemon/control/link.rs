//! A client of the control socket.

use std::io::{BufRead, BufReader, ErrorKind, Write};
use std::os::unix::net::UnixStream;

use serde_json::{Value, json};

use crate::rig::{Rig, until};

pub struct Link {
    reader: BufReader<UnixStream>,
}

impl Link {
    /// A client of the daemon that is running, or soon will be.
    pub fn new(rig: &Rig) -> Self {
        Self {
            reader: BufReader::new(rig.connect("control.sock")),
        }
    }

    pub fn writer(&self) -> UnixStream {
        self.reader.get_ref().try_clone().unwrap()
    }

    pub fn send(&mut self, bytes: &[u8]) {
        match self.reader.get_mut().write_all(bytes) {
            // It has hung up already, and what it said of that comes next.
            Err(error) if error.kind() == ErrorKind::BrokenPipe => {}
            sent => sent.unwrap(),
        }
    }

    /// The next answer, or `None` when the daemon has hung up.
    pub fn next(&mut self) -> Option<Value> {
        let mut line = String::new();
        // A daemon that hangs up with something of ours unread resets the connection.
        let count = self.reader.read_line(&mut line).unwrap_or(0);
        (count > 0).then(|| {
            let answer: Value = serde_json::from_str(&line).unwrap();
            assert!(answer["ok"].is_boolean(), "{line}");
            assert!(answer["code"].is_string(), "{line}");
            assert!(answer["message"].as_str().unwrap().len() > 8, "{line}");
            assert_eq!(answer["ok"] == true, answer["code"] == "ok", "{line}");
            answer
        })
    }

    pub fn ask(&mut self, request: &Value) -> Value {
        self.send(format!("{request}\n").as_bytes());
        self.next().expect("the daemon has hung up")
    }

    /// Asks for what needs nothing but its name, and gets a yes.
    pub fn told(&mut self, request: &str) -> Value {
        let answer = self.ask(&json!({ "request": request }));
        assert_eq!(answer["ok"], true, "{answer}");
        answer
    }

    /// Is refused, with this code.
    pub fn refused(&mut self, request: Value, code: &str) -> String {
        let answer = self.ask(&request);
        assert_eq!(answer["code"], code, "{request}: {answer}");
        answer["message"].as_str().unwrap().to_owned()
    }

    /// Waits until the status is so.
    pub fn status(&mut self, what: &str, wanted: impl Fn(&Value) -> bool) -> Value {
        let mut status = Value::Null;
        until(what, || {
            status = self.told("status");
            wanted(&status)
        });
        status
    }
}
