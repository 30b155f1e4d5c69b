//! What is wrong between tables, and what a table cannot say of itself.

use std::path::{Path, PathBuf};

use super::{Config, source};
use crate::check::Fault;
use crate::position::Gpsd;

impl Config {
    /// What is wrong between tables that are right in themselves, each fault with the key that it conflicts with. The keys are
    /// `table.key`.
    pub(super) fn check_across(&self) -> Vec<(Fault, &'static str)> {
        let mut faults = Vec::new();
        if self.source.kind == Some(source::Kind::Serial) && self.serial.port.as_os_str().is_empty()
        {
            let right = "the path of the serial port, best one in /dev/serial/by-id";
            faults.push((Fault::new("serial.port", "empty", right), "source.kind"));
        }
        // Beside the heading socket its name may be the longer one.
        if let Some(fault) = self.control.check_path(&self.socket.socket) {
            let key = "control.socket".to_owned();
            faults.push((Fault { key, ..fault }, "socket.socket"));
        }
        faults.extend(self.shared_paths());
        faults
    }

    /// Paths that two keys have. One would replace or hide what the other needs.
    fn shared_paths(&self) -> Vec<(Fault, &'static str)> {
        let paths = self.paths();
        let mut faults = Vec::new();
        for (index, (key, path)) in paths.iter().enumerate() {
            if let Some((other, _)) = paths[..index].iter().find(|(_, used)| used == path) {
                let found = format!("{path:?}, as {other} is");
                faults.push((Fault::new(key, found, "another path"), *other));
            }
        }
        faults
    }

    /// The paths that are in use with this configuration, each with its key. Two folders may be one: their files have names of
    /// their own.
    fn paths(&self) -> Vec<(&'static str, PathBuf)> {
        let gpsd = match Gpsd::parse(&self.true_north.gpsd) {
            Some(Gpsd::Unix(path)) => path,
            _ => PathBuf::new(),
        };
        let of = |kind, path: &Path| match self.source.kind == Some(kind) {
            true => path.to_owned(),
            false => PathBuf::new(),
        };
        let store = self.store.directory().unwrap_or(Path::new(""));
        let record = match self.record.directory == store {
            true => PathBuf::new(),
            false => self.record.directory.clone(),
        };
        let paths = [
            ("socket.socket", self.socket.socket.clone()),
            ("control.socket", self.control.path(&self.socket.socket)),
            ("pty.path", self.pty.path.clone()),
            ("true_north.gpsd", gpsd),
            ("serial.port", of(source::Kind::Serial, &self.serial.port)),
            ("source.log", of(source::Kind::Replay, &self.source.log)),
            ("store.directory", store.to_owned()),
            ("record.directory", record),
        ];
        let in_use = |(_, path): &(_, PathBuf)| !path.as_os_str().is_empty();
        paths.into_iter().filter(in_use).collect()
    }

    /// What is wrong with the address of a gpsd, which its own table cannot parse.
    pub(super) fn check_gpsd(&self) -> Vec<Fault> {
        let gpsd = &self.true_north.gpsd;
        if gpsd.is_empty() || Gpsd::parse(gpsd).is_some() {
            return Vec::new();
        }
        let right =
            "an address in numbers with a port, as \"127.0.0.1:2947\", an absolute path, or empty";
        vec![Fault::new("true_north.gpsd", format!("{gpsd:?}"), right)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_keys_with_one_path_are_both_named_at_the_line_of_the_one_in_the_file() {
        let heading = "\"/run/headingd/heading.sock\"";
        for (text, line, key, other) in [
            (
                format!("[pty]\npath = {heading}\n"),
                2,
                "pty.path",
                "socket.socket",
            ),
            // Written otherwise, and beside a socket that follows from another key.
            (
                "[socket]\nsocket = \"/tmp/a\"\n[pty]\npath = \"/tmp//./control.sock\"\n"
                    .to_owned(),
                4,
                "pty.path",
                "control.socket",
            ),
            (
                format!("[control]\nsocket = {heading}\n"),
                2,
                "control.socket",
                "socket.socket",
            ),
            (
                "[socket]\nsocket = \"/tmp/control.sock\"\n".to_owned(),
                2,
                "control.socket",
                "socket.socket",
            ),
            (
                format!("[true_north]\ngpsd = {heading}\n"),
                2,
                "true_north.gpsd",
                "socket.socket",
            ),
            (
                format!("[source]\nkind = \"serial\"\n[serial]\nport = {heading}\n"),
                4,
                "serial.port",
                "socket.socket",
            ),
            (
                format!("[source]\nkind = \"replay\"\nlog = {heading}\n"),
                3,
                "source.log",
                "socket.socket",
            ),
            (
                format!("[store]\ndirectory = {heading}\n"),
                2,
                "store.directory",
                "socket.socket",
            ),
            (
                format!("[record]\ndirectory = {heading}\n"),
                2,
                "record.directory",
                "socket.socket",
            ),
        ] {
            let error = Config::parse("file.toml", &text).unwrap_err();
            let whose = format!("file.toml:{line}: {key} is \"");
            let as_other = format!("\", as {other} is, but must be another path");
            assert!(
                error.starts_with(&whose) && error.ends_with(&as_other),
                "{error}"
            );
            assert_eq!(error.lines().count(), 1, "{error}");
        }
    }

    #[test]
    fn the_control_socket_beside_a_heading_socket_must_fit_too() {
        let folder = "x".repeat(87);
        let text = format!("[socket]\nsocket = \"/{folder}/h.sock\"\n");
        let error = Config::parse("file.toml", &text).unwrap_err();
        let right = format!(
            "file.toml:2: control.socket is \"/{folder}/control.sock\" (101 bytes), but must be an absolute path of up to 100 \
             bytes"
        );
        assert_eq!(error, right);
        Config::parse(
            "file.toml",
            &(text + "[control]\nsocket = \"/run/c.sock\"\n"),
        )
        .unwrap();
    }

    #[test]
    fn folders_may_be_one_and_what_is_not_used_is_no_conflict() {
        for text in [
            "[store]\ndirectory = \"/var/a\"\n[record]\ndirectory = \"/var/a\"\n",
            "[store]\ndirectory = \"\"\n[record]\ndirectory = \"\"\n",
            "[source]\nkind = \"simulator\"\n[serial]\nport = \"/run/headingd/heading.sock\"\n",
        ] {
            Config::parse("file.toml", text).unwrap();
        }
    }
}
