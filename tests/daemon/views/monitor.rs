//! `headingd monitor` on a terminal of its own, and `headingd report` of a running daemon.

use std::fs::File;
use std::io::{ErrorKind, Read, Write};
use std::os::unix::net::UnixListener;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, channel};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags};
use rustix::fs::{Mode, OFlags};
use rustix::termios::{LocalModes, Winsize, tcgetattr, tcsetwinsize};

use crate::control::link::Link;
use crate::rig::{
    ENDLESS, FAST, LONG, PATIENCE, Process, Rig, finished, headingd, program, pty, spawn_on,
};

/// A screen that draws nothing for so long has drawn all: it is drawn five times a second.
const SETTLED: Duration = Duration::from_millis(50);

/// A terminal with the program on it.
struct Screen {
    master: File,
    shown: Receiver<Vec<u8>>,
    reader: JoinHandle<()>,
    hung_up: Arc<AtomicBool>,
    seen: String,
    columns: u16,
    process: Process,
}

/// A terminal's size.
fn lines_of(columns: u16) -> Winsize {
    Winsize {
        ws_row: 24,
        ws_col: columns,
        ws_xpixel: 0,
        ws_ypixel: 0,
    }
}

impl Screen {
    fn monitor(rig: &Rig) -> Self {
        Self::on("xterm", rig)
    }

    /// On a terminal of this kind.
    fn on(kind: &str, rig: &Rig) -> Self {
        let (pty, name) = pty();
        let open = || {
            let node = rustix::fs::open(&name, OFlags::RDWR | OFlags::NOCTTY, Mode::empty());
            File::from(node.unwrap())
        };
        let mut command = program();
        command
            .args(["monitor", "--socket", &rig.text("heading.sock")])
            .env("TERM", kind)
            .env("LC_ALL", "C.UTF-8")
            .env("NO_COLOR", "1")
            .stdin(open());
        tcsetwinsize(&pty, lines_of(80)).unwrap();
        let process = spawn_on(rig.folder.path(), &mut command, open(), Some(open()));
        let master = File::from(pty);
        let (sender, shown) = channel();
        let mut other = master.try_clone().unwrap();
        let hung_up = Arc::new(AtomicBool::new(false));
        let ends = hung_up.clone();
        let reader = thread::spawn(move || {
            let mut bytes = [0; 4096];
            while !ends.load(Ordering::Relaxed) {
                let patience = SETTLED.try_into().unwrap();
                let mut waiting = [PollFd::new(&other, PollFlags::IN)];
                if rustix::event::poll(&mut waiting, Some(&patience)) == Ok(0) {
                    continue;
                }
                match other.read(&mut bytes) {
                    Ok(0) => break,
                    Ok(count) if sender.send(bytes[..count].to_vec()).is_ok() => {}
                    Err(error) if error.kind() == ErrorKind::Interrupted => {}
                    // The other end is closed.
                    _ => break,
                }
            }
        });
        Self {
            master,
            shown,
            reader,
            hung_up,
            seen: String::new(),
            columns: 80,
            process,
        }
    }

    /// Waits until this is on the screen. Only what has changed is drawn, so each drawing finds the screen wider than the
    /// one before: then all of it is drawn.
    fn shows(&mut self, part: &str) {
        let begun = Instant::now();
        self.seen.clear();
        while !self.seen.contains(part) {
            assert!(
                begun.elapsed() < PATIENCE,
                "{part} is not shown: {}",
                self.seen
            );
            self.widen();
            let mut patience = PATIENCE;
            while let Ok(bytes) = self.shown.recv_timeout(patience) {
                self.seen += &String::from_utf8_lossy(&bytes);
                patience = SETTLED;
            }
        }
    }

    fn widen(&mut self) {
        self.columns += 1;
        tcsetwinsize(&self.master, lines_of(self.columns)).unwrap();
    }

    fn press(&mut self, key: &str) {
        self.master.write_all(key.as_bytes()).unwrap();
    }

    /// The terminal's window is closed, or its line is cut.
    fn hang_up(self) -> Process {
        self.hung_up.store(true, Ordering::Relaxed);
        self.reader.join().unwrap();
        drop(self.master);
        self.process
    }
}

#[test]
fn the_screen_shows_the_daemon_and_keys_reach_it() {
    let rig = Rig::new(FAST, ENDLESS);
    let (mut process, mut client) = rig.watched();
    client.accepted();
    let mut link = Link::new(&rig);
    let mut screen = Screen::monitor(&rig);
    screen.shows("hmc5843");
    screen.press("l");
    link.status("the lock", |status| status["mode"] == "locked");
    screen.shows("mode locked");
    screen.press("l");
    link.status("the end of it", |status| status["mode"] == "on");
    // Ctrl-L, which draws a screen anew elsewhere.
    screen.press("\u{c}");
    // A key that changes much is asked about, and any other key is a no, and nothing else: the next turn is still wanted.
    screen.press("r");
    screen.shows("y: yes");
    screen.press("l");
    screen.press("c");
    screen.shows("turn the board once");
    assert_eq!(link.told("status")["mode"], "on");
    // Without colour there is none, and it is no reason to hide the daemon's end.
    process.stop();
    screen.shows("lost");
    screen.press("q");
    screen.process.ends(0);
    // The terminal is as it was.
    let modes = tcgetattr(&screen.master).unwrap().local_modes;
    assert!(modes.contains(LocalModes::ICANON | LocalModes::ECHO));
}

#[test]
fn a_signal_ends_it_and_gives_the_terminal_back() {
    let rig = Rig::new(1.0, ENDLESS);
    let (_process, _client) = rig.watched();
    let mut screen = Screen::monitor(&rig);
    screen.shows("heading");
    screen.process.stop();
    let modes = tcgetattr(&screen.master).unwrap().local_modes;
    assert!(modes.contains(LocalModes::ICANON | LocalModes::ECHO));
}

#[test]
fn a_terminal_without_escape_sequences_gets_none() {
    let rig = Rig::new(FAST, LONG);
    let (_process, mut client) = rig.watched();
    client.heading();
    let mut screen = Screen::on("dumb", &rig);
    screen.shows("° magnetic ± ");
    assert!(!screen.seen.contains('\u{1b}'), "{}", screen.seen);
    assert!(screen.seen.contains("headingd watch"), "{}", screen.seen);
}

#[test]
fn it_ends_with_its_terminal() {
    let rig = Rig::new(1.0, ENDLESS);
    let (_process, _client) = rig.watched();
    let mut screen = Screen::monitor(&rig);
    screen.shows("heading");
    // It has no terminal to work on.
    assert_eq!(screen.hang_up().wait().code(), Some(74));
}

#[test]
fn without_a_terminal_or_a_daemon_it_says_so() {
    let (status, _, err) = headingd(&["monitor"]);
    assert_eq!(status, 2);
    assert!(err.contains("headingd watch"), "{err}");
}

/// A report on the rig's daemon: exit status, standard output and standard error.
fn report(rig: &Rig, out: &str, more: &[&str]) -> (i32, String, String) {
    let socket = rig.text("heading.sock");
    let report = ["report", "--socket", &socket, "--out", out];
    headingd(&[&report[..], more].concat())
}

#[test]
fn a_report_on_a_daemon_that_ends_has_what_there_was() {
    let rig = Rig::new(5.0, "");
    let (_process, _client) = rig.watched();
    let out = rig.text("report.html");
    let (status, _, err) = report(&rig, &out, &[]);
    assert_eq!(status, 0, "{err}");
    assert!(
        err.contains("the page ends early: headingd has closed"),
        "{err}"
    );
    assert!(std::fs::read_to_string(&out).unwrap().contains("<figure>"));
}

#[test]
fn a_report_on_a_daemon_that_is_locked_calibrates_on_no_turn() {
    let rig = Rig::new(FAST, LONG);
    let (_process, mut client) = rig.watched();
    client.accepted();
    Link::new(&rig).told("lock");
    // The file that every command finds is that of another daemon, and says nothing of this one's place.
    let usual = rig.text("usual.toml");
    std::fs::write(&usual, "[true_north]\ndeclination_deg = 9\n").unwrap();
    let socket = rig.text("heading.sock");
    let report = [
        "report",
        "--socket",
        &socket,
        "--duration",
        "3",
        "--out",
        "-",
    ];
    let (status, page, err) = finished(program().env("HEADINGD_CONFIG", usual).args(report));
    assert_eq!(status, 0, "{err}");
    assert!(page.contains("No full turn has calibrated"));
    assert!(!page.contains("the declination added"));
}

#[test]
fn a_running_daemon_is_reported_on() {
    let rig = Rig::new(FAST, ENDLESS);
    let (_process, mut client) = rig.watched();
    client.accepted();
    let out = rig.text("report.html");
    let (status, _, err) = report(&rig, &out, &["--duration", "3"]);
    assert_eq!(status, 0, "{err}");
    let page = std::fs::read_to_string(&out).unwrap();
    assert!(page.contains("hmc5843") && page.contains("<figure>"));
    // With a place, its headings are true ones, too.
    let gpsd = UnixListener::bind(rig.path("gpsd.sock")).unwrap();
    let config = rig.text("north.toml");
    let north = format!("[true_north]\ngpsd = {:?}\n", rig.path("gpsd.sock"));
    std::fs::write(&config, north).unwrap();
    thread::spawn(move || {
        let (mut stream, _) = gpsd.accept().unwrap();
        stream
            .write_all(b"{\"class\":\"TPV\",\"mode\":2,\"lat\":51.08,\"lon\":-114.13}\n")
            .unwrap();
        // Until the report ends.
        let _ = stream.read_to_end(&mut Vec::new());
    });
    let north = ["--duration", "10", "--config", &config];
    let (status, page, err) = report(&rig, "-", &north);
    assert_eq!(status, 0, "{err}");
    for part in [
        "°, magnetic north is east of true north",
        "<b class=other>true</b>",
    ] {
        assert!(page.contains(part), "{part} is missing");
    }
    let (status, _, err) = headingd(&["report", "--socket", "/none.sock", "--out", "-"]);
    assert_eq!(status, 69, "{err}");
    // What cannot be written is refused before a day of listening.
    let day = ["--duration", "86400"];
    let (status, _, err) = report(&rig, &rig.text(""), &day);
    assert!(status == 73 && err.contains("it is a folder"), "{err}");
    // Not even root can replace this one.
    let (status, _, err) = report(&rig, "/proc/version", &day);
    let why = "cannot write /proc/version";
    assert!(status == 73 && err.contains(why), "{err}");
}
