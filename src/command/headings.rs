//! A client of the socket for headings: what the commands that show the running daemon read.

use std::io::{BufRead, BufReader, ErrorKind, Read, Write};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::time::Duration;

use serde_json::Value;

use super::control::{PATIENCE, connect, is_timeout, unreachable};
use super::{Failure, OrFail, config_file};
use crate::config::Config;
use crate::publish::raw::{self, Object};
use crate::recording::Header;

/// No message is longer, bytes: that of a board with all its remarks is the longest.
const LONGEST: u64 = 1 << 20;

#[derive(Clone, Debug, Default, clap::Args)]
pub struct HeadingTarget {
    /// The daemon's socket for headings; without it, that of the configuration
    #[arg(long, value_name = "PATH", conflicts_with = "config")]
    pub socket: Option<PathBuf>,
    /// The daemon's configuration file [default: $HEADINGD_CONFIG, else /etc/headingd/headingd.toml, if there is one]
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
}

/// The two sockets of a daemon.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DaemonSockets {
    pub headings: PathBuf,
    pub control: PathBuf,
}

impl HeadingTarget {
    /// Where its sockets are. Without a configuration the control socket is where it is by default: beside the other.
    pub fn sockets(&self) -> Result<DaemonSockets, Failure> {
        let config = match self.socket {
            Some(_) => Config::default(),
            None => config_file::load_for_client(self.config.as_deref())?,
        };
        let headings = self.socket.as_ref().unwrap_or(&config.socket.socket);
        Ok(DaemonSockets::beside(headings, &config))
    }
}

impl DaemonSockets {
    /// With the control socket where the configuration has it, or else beside that for headings.
    pub fn beside(headings: &Path, config: &Config) -> Self {
        Self {
            headings: headings.to_owned(),
            control: config.control.path(headings),
        }
    }
}

/// A connection to the socket for headings.
#[derive(Debug)]
pub struct Headings {
    path: PathBuf,
    reader: BufReader<UnixStream>,
    /// Buffer of the current line; complete once it ends with a newline.
    bytes: Vec<u8>,
    line: String,
    /// Nothing has come since the daemon was asked for its version.
    asked: bool,
}

impl Headings {
    /// Connects, and asks for what `watch` says: the argument of a `?WATCH`.
    pub fn open(path: &Path, watch: &str) -> Result<Self, Failure> {
        let stream = connect(path).map_err(|error| unreachable(path, &error))?;
        Self::greet(path, stream, watch)
    }

    /// The same on a connection that the daemon has taken.
    pub fn greet(path: &Path, mut stream: UnixStream, watch: &str) -> Result<Self, Failure> {
        match stream.write_all(format!("?WATCH={watch};\n").as_bytes()) {
            // A daemon that has hung up may have said why: one that is full does.
            Err(error) if error.kind() == ErrorKind::BrokenPipe => {}
            sent => sent.map_err(|error| unreachable(path, &error))?,
        }
        let mut headings = Self {
            path: path.to_owned(),
            reader: BufReader::new(stream),
            bytes: Vec::new(),
            line: String::new(),
            // Each daemon greets at once: there is nothing to ask.
            asked: true,
        };
        headings.set_patience(PATIENCE)?;
        headings.line()?;
        if headings.parsed()?.unwrap_or_default()["class"] == "VERSION" {
            return Ok(headings);
        }
        let message = format!(
            "{} is not headingd's socket for headings: name the configuration with --config, or the socket with --socket where \
             the command takes it",
            path.display()
        );
        Err(Failure::new(Failure::DATA, message))
    }

    /// The board whose raw readings follow. A daemon that is asked for readings sends it at once.
    pub fn board(&mut self) -> Result<Header, Failure> {
        while let Some(object) = self.object_in_time()? {
            if let Ok(Object::Board { header }) = serde_json::from_value(object) {
                let what = format!(
                    "cannot read the board of headingd at {}",
                    self.path.display()
                );
                return raw::header(&header).or_fail(Failure::DATA, what);
            }
        }
        Err(unreachable(&self.path, &ErrorKind::TimedOut.into()))
    }

    /// What comes after the board, or [`Object::Other`] where nothing comes within the patience that is set. Another board ends the
    /// readings of the first, and becomes a `Failure`.
    pub fn raw_in_time(&mut self) -> Result<Object, Failure> {
        let object = self.object_in_time()?.unwrap_or_default();
        match serde_json::from_value(object) {
            Ok(Object::Board { .. }) => {
                let path = self.path.display();
                let message = format!(
                    "headingd at {path} reads another board now: start again for its readings"
                );
                Err(Failure::new(Failure::UNAVAILABLE, message))
            }
            object => Ok(object.unwrap_or(Object::Other)),
        }
    }

    /// Passes over everything that the daemon has sent so far.
    pub fn pass_over(&mut self) -> Result<(), Failure> {
        self.ask()?;
        while self.object()?["class"] != "VERSION" {}
        Ok(())
    }

    /// Asks for something that is always answered.
    fn ask(&mut self) -> Result<(), Failure> {
        self.asked = true;
        let sent = self.reader.get_mut().write_all(b"?VERSION;\n");
        sent.map_err(|error| unreachable(&self.path, &error))
    }

    /// After a silence: a daemon whose source is silent has nothing to send, but answers.
    fn ask_once(&mut self) -> Result<(), Failure> {
        if self.asked {
            return Err(unreachable(&self.path, &ErrorKind::TimedOut.into()));
        }
        self.ask()
    }

    /// The last line that was read, without its end.
    pub fn text(&self) -> &str {
        self.line.trim_end()
    }

    /// The next line, without its end.
    pub fn line(&mut self) -> Result<&str, Failure> {
        while !self.read()? {
            self.ask_once()?;
        }
        Ok(self.text())
    }

    /// How long to wait for a line: see [`Headings::object_in_time`].
    pub fn set_patience(&mut self, patience: Duration) -> Result<(), Failure> {
        let set = self.reader.get_ref().set_read_timeout(Some(patience));
        set.map_err(|error| unreachable(&self.path, &error))
    }

    /// Reads until a newline. Returns false on timeout.
    fn read(&mut self) -> Result<bool, Failure> {
        if self.bytes.ends_with(b"\n") {
            self.bytes.clear();
        }
        let read = (&mut self.reader)
            .take(LONGEST)
            .read_until(b'\n', &mut self.bytes);
        match read {
            Ok(0) => {
                let path = self.path.display();
                let message = format!(
                    "headingd has closed {path}: it has stopped, or its source is at its end"
                );
                Err(Failure::new(Failure::UNAVAILABLE, message))
            }
            Ok(_) => {
                self.asked = false;
                self.line = String::from_utf8_lossy(&self.bytes).into_owned();
                // A longer line than any of the daemon's is passed over in pieces.
                if !self.bytes.ends_with(b"\n") {
                    self.bytes.clear();
                }
                Ok(true)
            }
            Err(error) if is_timeout(&error) => Ok(false),
            Err(error) => Err(unreachable(&self.path, &error)),
        }
    }

    /// The next object; lines that are none are passed over.
    pub fn object(&mut self) -> Result<Value, Failure> {
        loop {
            if let Some(object) = self.object_in_time()? {
                return Ok(object);
            }
            self.ask_once()?;
        }
    }

    /// The next object, or `None` where it does not come within the patience that is set.
    pub fn object_in_time(&mut self) -> Result<Option<Value>, Failure> {
        while self.read()? {
            let object = self.parsed()?;
            if object.is_some() {
                return Ok(object);
            }
        }
        Ok(None)
    }

    /// The last line as an object, if it is one. An `ERROR` becomes a `Failure`.
    fn parsed(&self) -> Result<Option<Value>, Failure> {
        let object: Option<Value> = serde_json::from_str(self.text()).ok();
        match object {
            Some(error) if error["class"] == "ERROR" => {
                let why = error["message"].as_str().unwrap_or("an error");
                let message = format!("headingd at {} refuses: {why}", self.path.display());
                Err(Failure::new(Failure::UNAVAILABLE, message))
            }
            object => Ok(object),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::io;

    use super::*;

    #[test]
    fn after_a_silence_the_daemon_is_asked_and_after_another_given_up() {
        let (stream, mut daemon) = UnixStream::pair().unwrap();
        let version = r#"{"class":"VERSION"}"#;
        writeln!(daemon, "{version}").unwrap();
        let mut headings = Headings::greet(Path::new("/s"), stream, "{}").unwrap();
        headings.set_patience(Duration::from_millis(10)).unwrap();
        for _ in 0..2 {
            let failure = headings.line().unwrap_err();
            assert!(
                failure.message.contains("does not answer at /s"),
                "{failure}"
            );
            writeln!(daemon, "{version}").unwrap();
            assert_eq!(headings.line().unwrap(), version);
        }
        drop(headings);
        let asked = io::read_to_string(daemon).unwrap();
        assert_eq!(asked, "?WATCH={};\n?VERSION;\n?VERSION;\n");
    }

    #[test]
    fn a_daemon_that_has_hung_up_already_is_heard() {
        let (stream, mut daemon) = UnixStream::pair().unwrap();
        let refusal = r#"{"class":"ERROR","message":"headingd serves 2 clients already"}"#;
        writeln!(daemon, "{refusal}").unwrap();
        drop(daemon);
        let failure = Headings::greet(Path::new("/s"), stream, "{}").unwrap_err();
        assert_eq!(
            failure.message,
            "headingd at /s refuses: headingd serves 2 clients already"
        );
    }
}
