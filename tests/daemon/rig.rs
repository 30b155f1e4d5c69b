//! A daemon in a process and a folder of its own, and a client of it.

use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus};
use std::time::{Duration, Instant};

use headingd::recording::{Entry, Header, written};
use headingd::sensor::simulator::{Scenario, Settings};
use rustix::net::{AddressFamily, SocketAddrUnix, SocketType, bind, listen, socket};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use serde_json::Value;

#[path = "../domain/shared.rs"]
mod shared;
pub use shared::*;

/// Longer than anything takes on the slowest machine.
pub const PATIENCE: Duration = Duration::from_secs(30);

pub const SEE_ALL: &str = r#"{"enable":true,"json":true,"state":true,"calibration":true}"#;

/// So many times faster than in real time that a turn takes a third of a second.
pub const FAST: f64 = 20.0;

/// A board that turns for as long as a test may take, and then moves on until the daemon is stopped.
pub const LONG: &str = "[simulator]\nscenario = \"endless\"\nturns = 100\n";

/// The same for a simulator of the test.
pub fn long() -> Settings {
    Settings {
        scenario: Scenario::Endless,
        turns: 100.0,
        ..Settings::default()
    }
}

/// A board that moves until the daemon is stopped.
pub const ENDLESS: &str = "[simulator]\nscenario = \"endless\"\n";

/// A process that is killed if a test fails.
pub struct Process {
    child: Child,
    stderr: PathBuf,
}

/// Runs the program with these arguments to its end: exit status, standard output and standard error.
pub fn headingd(arguments: &[&str]) -> (i32, String, String) {
    finished(program().args(arguments))
}

/// The program with these arguments; what it says goes into `folder`, which is also its TMPDIR.
pub fn start(folder: &Path, arguments: &[&str]) -> Process {
    spawn(folder, program().args(arguments))
}

/// The same for a command that starts the program.
fn spawn(folder: &Path, command: &mut Command) -> Process {
    let stdout = fs::File::create(folder.join("stdout")).unwrap();
    spawn_on(folder, command, stdout, None)
}

/// The same with another standard output, and perhaps another standard error.
pub fn spawn_on(
    folder: &Path,
    command: &mut Command,
    stdout: fs::File,
    other_stderr: Option<fs::File>,
) -> Process {
    let temporary = folder.join("tmp");
    fs::create_dir_all(&temporary).unwrap();
    let stderr = tempfile::Builder::new().tempfile_in(folder).unwrap();
    let child = command
        .env("TMPDIR", temporary)
        .env_remove("RUST_LOG")
        .stdout(stdout)
        .stderr(other_stderr.unwrap_or_else(|| stderr.reopen().unwrap()))
        .spawn()
        .unwrap();
    let (_, stderr) = stderr.keep().unwrap();
    Process { child, stderr }
}

impl Process {
    pub fn id(&self) -> u32 {
        self.child.id()
    }

    pub fn signal(&self, name: &str) {
        let number = self.id().to_string();
        let sent = Command::new("kill").args(["-s", name, &number]).status();
        assert!(sent.unwrap().success());
    }

    pub fn wait(&mut self) -> ExitStatus {
        let mut status = None;
        until("the end of the process", || {
            status = self.child.try_wait().unwrap();
            status.is_some()
        });
        status.unwrap()
    }

    pub fn said(&self) -> String {
        fs::read_to_string(&self.stderr).unwrap()
    }

    /// Waits until it has said this.
    pub fn says(&self, part: &str) {
        until(part, || self.said().contains(part));
    }

    /// Waits until it has ended, with this exit status; all that it has said.
    pub fn ends(&mut self, status: i32) -> String {
        let found = self.wait();
        let said = self.said();
        assert_eq!(found.code(), Some(status), "{said}");
        said
    }

    /// Has it end, well; all that it has said.
    pub fn stop(&mut self) -> String {
        self.signal("TERM");
        self.ends(0)
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        // It has ended already, as a rule.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// In memory where that is possible: a disk that others keep busy may take seconds for a save, and the daemon says so.
pub fn folder() -> tempfile::TempDir {
    tempfile::tempdir_in("/dev/shm")
        .or_else(|_| tempfile::tempdir())
        .unwrap()
}

/// A folder with a configuration in it.
pub struct Rig {
    pub folder: tempfile::TempDir,
}

impl Rig {
    pub fn new(speed: f64, more: &str) -> Self {
        let rig = Self { folder: folder() };
        rig.configure(speed, &rig.path("store"), more);
        rig
    }

    /// `more` begins with a table, or is empty.
    pub fn configure(&self, speed: f64, store: &Path, more: &str) {
        let socket = self.path("heading.sock");
        // Keys of [source] may be first in it.
        let (own, _) = more.split_once('[').unwrap_or((more, ""));
        let kind = if own.contains("kind = ") {
            ""
        } else {
            "kind = \"simulator\"\n"
        };
        let text = format!(
            "[socket]\nsocket = {socket:?}\nbacklog = 4096\n[store]\ndirectory = {store:?}\n\
             [source]\n{kind}speed = {speed}\n{more}"
        );
        fs::write(self.path("headingd.toml"), text).unwrap();
    }

    /// Has it replay a log.
    pub fn replay(&self, speed: f64, log: &Path) {
        let more = format!("kind = \"replay\"\nlog = {log:?}\n");
        self.configure(speed, &self.path("store"), &more);
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// The same as text, for an argument.
    pub fn text(&self, name: &str) -> String {
        self.path(name).to_str().unwrap().to_owned()
    }

    /// A new named pipe.
    pub fn pipe(&self, name: &str) -> PathBuf {
        let pipe = self.path(name);
        let made = Command::new("mkfifo").arg(&pipe).status();
        assert!(made.unwrap().success());
        pipe
    }

    /// The program with these arguments and the rig's configuration.
    pub fn command(&self, arguments: &[&str]) -> Command {
        let mut command = program();
        command.args(arguments).arg("--config");
        command.arg(self.path("headingd.toml"));
        command
    }

    pub fn start(&self) -> Process {
        self.spawn(&mut self.command(&["run"]))
    }

    /// Starts the program with these arguments.
    pub fn run(&self, arguments: &[&str]) -> Process {
        start(self.folder.path(), arguments)
    }

    /// Starts a command that is, or starts, the program.
    pub fn spawn(&self, command: &mut Command) -> Process {
        spawn(self.folder.path(), command)
    }

    /// Changes the text of the configuration.
    pub fn edit(&self, from: &str, to: &str) {
        let config = self.path("headingd.toml");
        let text = fs::read_to_string(&config).unwrap();
        fs::write(&config, text.replace(from, to)).unwrap();
    }

    /// A daemon and a client that watches it.
    pub fn watched(&self) -> (Process, Client) {
        let process = self.start();
        (process, self.client())
    }

    /// A client that watches the daemon that is running, or soon will be.
    pub fn client(&self) -> Client {
        Client::watch(self.connect("heading.sock"))
    }

    /// A connection to a socket that is there, or soon will be.
    pub fn connect(&self, name: &str) -> UnixStream {
        let mut stream = None;
        until(name, || {
            stream = UnixStream::connect(self.path(name)).ok();
            stream.is_some()
        });
        let stream = stream.unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        stream
    }
}

pub struct Client {
    reader: BufReader<UnixStream>,
}

impl Client {
    fn watch(mut stream: UnixStream) -> Self {
        writeln!(stream, "?WATCH={SEE_ALL};").unwrap();
        Self {
            reader: BufReader::new(stream),
        }
    }

    /// The next message, or `None` when the daemon has hung up.
    pub fn next(&mut self) -> Option<Value> {
        let mut line = String::new();
        let count = self.reader.read_line(&mut line).unwrap();
        (count > 0).then(|| serde_json::from_str(&line).unwrap())
    }

    /// The next calibration that is accepted.
    pub fn accepted(&mut self) -> Value {
        self.find("CALIBRATION", |outcome| outcome["verdict"] == "accepted")
    }

    /// The next heading that may be steered by.
    pub fn heading(&mut self) -> Value {
        self.find("ATT", |att| att["mheading"].is_number())
    }

    /// The next message that is of this class and of which this is true.
    pub fn find(&mut self, class: &str, wanted: impl Fn(&Value) -> bool) -> Value {
        let begun = Instant::now();
        loop {
            let message = self.next().expect("the daemon has hung up");
            if message["class"] == class && wanted(&message) {
                return message;
            }
            assert!(begun.elapsed() < PATIENCE, "waited in vain for {class}");
        }
    }
}

/// Leaves a socket there at which nobody listens. Nobody ever did: a listener of this process would go on for as long
/// as a program that another test is just starting has a copy of it.
pub fn leave_dead_socket(path: impl AsRef<Path>) -> OwnedFd {
    let socket = socket(AddressFamily::UNIX, SocketType::STREAM, None).unwrap();
    bind(&socket, &SocketAddrUnix::new(path.as_ref()).unwrap()).unwrap();
    socket
}

/// A socket that takes no connections, and the first that waits, which has filled its queue: a second would have to wait.
pub fn full_socket(path: impl AsRef<Path>) -> (OwnedFd, UnixStream) {
    let listener = leave_dead_socket(&path);
    listen(&listener, 0).unwrap();
    (listener, UnixStream::connect(path).unwrap())
}

/// A log as bytes.
pub fn log(header: &Header, entries: impl IntoIterator<Item = Entry>) -> Vec<u8> {
    written(header, entries).unwrap()
}

/// Says that the machine could not do a test. What is printed by a test that passes is shown to nobody.
pub fn not_run(why: &str) {
    std::io::stderr()
        .write_all(format!("not run: {why}\n").as_bytes())
        .unwrap();
}

/// A pseudo-terminal, and the path of its other side.
pub fn pty() -> (OwnedFd, String) {
    let pty = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).unwrap();
    grantpt(&pty).unwrap();
    unlockpt(&pty).unwrap();
    let name = ptsname(&pty, Vec::new()).unwrap();
    (pty, name.into_string().unwrap())
}

pub fn until(what: &str, mut condition: impl FnMut() -> bool) {
    let begun = Instant::now();
    while !condition() {
        assert!(begun.elapsed() < PATIENCE, "waited in vain: {what}");
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// How many files and folders there are.
pub fn entries(folder: &Path) -> usize {
    fs::read_dir(folder).unwrap().count()
}
