//! `headingd run` under a service manager: what it is told, sockets that it hands over, signals and reload.

use std::fs::{self, File};
use std::io::Read;
use std::net::{SocketAddr, TcpStream};
use std::os::fd::OwnedFd;
use std::os::unix::net::{UnixDatagram, UnixListener, UnixStream};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Instant;

use rustix::process::{Pid, Resource, Rlimit, prlimit};

use crate::rig::{FAST, LONG, PATIENCE, Process, Rig, pty};

/// A manager that is told how the daemon is.
struct Manager(UnixDatagram);

impl Manager {
    fn new(rig: &Rig) -> Self {
        let socket = UnixDatagram::bind(rig.path("notify")).unwrap();
        socket.set_read_timeout(Some(PATIENCE)).unwrap();
        Self(socket)
    }

    fn start(&self, rig: &Rig) -> Process {
        rig.spawn(
            rig.command(&["run"])
                .env("NOTIFY_SOCKET", rig.path("notify"))
                .env("WATCHDOG_USEC", "400000"),
        )
    }

    fn next(&self) -> String {
        let mut bytes = [0; 4096];
        let count = self.0.recv(&mut bytes).expect("the daemon tells nothing");
        String::from_utf8(bytes[..count].to_vec()).unwrap()
    }

    /// The next word that begins like this.
    fn find(&self, start: &str) -> String {
        let begun = Instant::now();
        loop {
            let word = self.next();
            if word.starts_with(start) {
                return word;
            }
            assert!(begun.elapsed() < PATIENCE, "waited in vain for {start}");
        }
    }
}

/// The daemon as a shell starts it, which may lay out descriptors as a service manager or a terminal does.
fn start_by_shell(rig: &Rig, script: &str, stdin: Stdio) -> Process {
    let program = env!("CARGO_BIN_EXE_headingd");
    rig.spawn(
        Command::new("sh")
            .args(["-c", script, "sh", program, "run", "--config"])
            .arg(rig.path("headingd.toml"))
            .stdin(stdin),
    )
}

#[test]
fn the_manager_is_told_how_things_stand_until_the_end() {
    let rig = Rig::new(1.0, LONG);
    let manager = Manager::new(&rig);
    let mut process = manager.start(&rig);
    manager.find("READY=1");
    // Ready means that it is there at once.
    UnixStream::connect(rig.path("heading.sock")).unwrap();
    let status = manager.find("STATUS=");
    assert!(status.starts_with("STATUS=uncalibrated ("), "{status}");
    manager.find("WATCHDOG=1");
    process.signal("TERM");
    manager.find("STOPPING=1");
    process.ends(0);
}

#[test]
fn a_start_that_cannot_be_is_told_the_manager_in_one_line() {
    let rig = Rig::new(1.0, "speeed = 1\nkind = \"none\"\n");
    let manager = Manager::new(&rig);
    assert_eq!(manager.start(&rig).wait().code(), Some(78));
    let status = manager.next();
    assert!(
        status.contains("did you mean speed?") && status.contains("source.kind"),
        "{status}"
    );
    assert_eq!(status.lines().count(), 1, "{status}");
}

#[test]
fn a_socket_that_was_handed_over_is_served_on_and_left_behind() {
    let rig = Rig::new(1.0, LONG);
    let listener = UnixListener::bind(rig.path("heading.sock")).unwrap();
    // The shell makes it descriptor 3 of a process whose number it knows.
    let script = "exec 3<&0 </dev/null; export LISTEN_PID=$$ LISTEN_FDS=1 LISTEN_FDNAMES=heading; exec \"$@\"";
    let mut process = start_by_shell(&rig, script, OwnedFd::from(listener).into());
    // It was there before the daemon, so this waits in its queue.
    rig.client().find("ATT", |_| true);
    process.stop();
    assert!(rig.path("heading.sock").exists());
}

#[test]
fn a_reload_keeps_clients_and_the_active_calibration() {
    let rig = Rig::new(FAST, LONG);
    // Nothing but the daemon itself keeps the calibration.
    rig.configure(FAST, Path::new(""), LONG);
    let manager = Manager::new(&rig);
    let mut process = manager.start(&rig);
    let mut client = rig.client();
    client.accepted();
    let seq = |att: &serde_json::Value| att["seq"].as_u64().unwrap();
    let before = client.heading();

    // At real time a turn would take longer than this test.
    rig.configure(
        1.0,
        Path::new(""),
        &format!("{LONG}[log]\nfilter = \"debug\"\n"),
    );
    process.signal("HUP");
    let reloading = manager.find("RELOADING=1");
    assert!(reloading.contains("\nMONOTONIC_USEC="), "{reloading}");
    manager.find("READY=1");
    let after = client.find("ATT", |att| seq(att) < seq(&before));
    assert!(after.get("mheading").is_some(), "{after}");
    let said = process.said();
    assert!(
        said.contains("reloaded: source.speed, log.filter"),
        "{said}"
    );

    process.signal("HUP");
    manager.find("RELOADING=1");
    manager.find("READY=1");
    let said = process.said();
    assert!(said.contains("reloaded: nothing has changed"), "{said}");

    rig.edit("[socket]\n", "[turns]\n[socket]\n");
    process.signal("HUP");
    manager.find("RELOADING=1");
    manager.find("READY=1");
    process.says("all goes on as before");
    process.says("turns: unknown table; did you mean turn?");

    rig.edit("[turns]\n", "");
    rig.edit("backlog = 4096", "backlog = 99");
    process.signal("HUP");
    process.says("changes only with a restart: socket.backlog");
    process.says("reloaded: nothing changes without a restart");
    let said = process.said();
    assert_eq!(said.matches("nothing has changed").count(), 1, "{said}");

    process.signal("USR1");
    process.says("summary: ");
    let said = process.said();
    let summary = said
        .lines()
        .find(|line| line.contains("summary: "))
        .unwrap();
    for part in [
        "calibration=\"",
        "clients=1",
        "calibrations_accepted=1",
        "uptime_s=",
        "faults=0",
    ] {
        assert!(summary.contains(part), "{summary}");
    }
    // No number has more than three decimal places.
    let long = |word: &&str| {
        let number = word.split_once('=').map(|(_, value)| value.parse::<f64>());
        matches!(number, Some(Ok(_))) && word.split_once('.').is_some_and(|(_, d)| d.len() > 3)
    };
    assert!(said.contains("from_s="), "{said}");
    assert_eq!(said.split_whitespace().find(long), None);
    client.heading();
    process.stop();
}

#[test]
fn a_hangup_ends_it_only_when_its_terminal_has_gone() {
    let rig = Rig::new(1.0, LONG);
    let (terminal, name) = pty();
    let stderr = File::options().write(true).open(name).unwrap();
    let script = "exec \"$@\" 2>&0 0</dev/null";
    let mut process = start_by_shell(&rig, script, stderr.into());
    let mut client = rig.client();
    client.find("ATT", |_| true);
    rig.configure(2.0, &rig.path("store"), LONG);
    process.signal("HUP");
    // A reload begins the simulation anew.
    client.find("ATT", |att| att["seq"].as_u64().unwrap() < 3);
    drop(terminal);
    process.signal("HUP");
    process.ends(0);
    assert!(!rig.path("heading.sock").exists());
}

/// The configuration as it is installed: nobody has said yet where the readings come from.
#[test]
fn without_a_source_it_does_not_start_and_says_what_to_set() {
    let rig = Rig::new(1.0, LONG);
    let installed = include_str!("../../config/headingd.toml")
        .replace("/run/headingd/", &rig.path("").display().to_string());
    fs::write(rig.path("headingd.toml"), installed).unwrap();
    let manager = Manager::new(&rig);
    let mut process = manager.start(&rig);
    process.ends(78);
    let status = manager.next();
    for part in [
        "headingd.toml: source.kind is not set",
        "\"i2c\"",
        "\"serial\"",
    ] {
        assert!(status.contains(part), "{status}");
    }
    assert_eq!(status.lines().count(), 1, "{status}");
    assert!(!rig.path("heading.sock").exists());
    // The unit tries again only what another start may mend.
    let unit = include_str!("../../systemd/headingd.service");
    let key = "RestartPreventExitStatus=";
    let line = unit.lines().find_map(|line| line.strip_prefix(key));
    assert!(line.unwrap().split(' ').any(|status| status == "78"));
}

#[test]
fn it_may_open_as_many_files_as_the_system_allows() {
    let rig = Rig::new(1.0, LONG);
    let process = start_by_shell(&rig, "ulimit -Sn 64; exec \"$@\"", Stdio::null());
    rig.client().find("ATT", |_| true);
    let limits = fs::read_to_string(format!("/proc/{}/limits", process.id())).unwrap();
    let line = limits.lines().find(|line| line.starts_with("Max open"));
    let words: Vec<_> = line.unwrap().split_whitespace().collect();
    assert_eq!(words[3], words[4], "{limits}");
}

#[test]
fn lines_left_out_of_the_log_are_counted_at_the_end() {
    let rig = Rig::new(1.0, LONG);
    rig.edit("backlog = 4096", "backlog = 4096\nmax_clients = 1");
    let (mut process, mut client) = rig.watched();
    client.find("ATT", |_| true);
    for _ in 0..40 {
        let mut refused = rig.connect("heading.sock");
        refused.read_to_end(&mut Vec::new()).unwrap();
    }
    let said = process.stop();
    let last = "more such lines were left out, the last: refused a client";
    assert!(said.contains(last), "{said}");
}

#[test]
fn without_files_for_clients_of_tcp_it_warns_once() {
    // Each process has its own loopback address, and this port is not among those that the kernel gives away.
    let [.., high, middle, low] = std::process::id().to_be_bytes();
    let address = SocketAddr::from(([127, high, middle, low.max(2)], 10113));
    let rig = Rig::new(FAST, &format!("{LONG}[tcp]\nlisten = \"{address}\"\n"));
    let (mut process, mut client) = rig.watched();
    process.says("serving NMEA 0183 over TCP");
    // It has been accepted.
    client.find("ATT", |_| true);
    let pid = Pid::from_raw(process.id() as i32);
    let files = |current| {
        let limit = Rlimit {
            current: Some(current),
            maximum: Some(1024),
        };
        prlimit(pid, Resource::Nofile, limit).unwrap();
    };
    files(3);
    let mut waiting = TcpStream::connect(address).unwrap();
    process.says("cannot accept a client of TCP, will try again");
    // It tries every second; this takes two and a half.
    let first = client.find("ATT", |_| true)["t_s"].as_f64().unwrap();
    client.find("ATT", |att| {
        att["t_s"].as_f64().unwrap() > first + 2.5 * FAST
    });
    files(1024);
    waiting.set_read_timeout(Some(PATIENCE)).unwrap();
    waiting.read_exact(&mut [0]).unwrap();
    let said = process.stop();
    assert_eq!(said.matches("cannot accept").count(), 1, "{said}");
}
