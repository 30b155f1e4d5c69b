//! `headingd record` and table `[record]`: raw readings into logs, whatever the disk and the socket do.

use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::os::unix::net::{UnixDatagram, UnixListener};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::thread::JoinHandle;

use crate::rig::{LONG, Process, Rig, leave_dead_socket, long, until};
use headingd::reading::Reading;
use headingd::recording::Header;
use headingd::sensor::replay::Replay;
use headingd::sensor::simulator::{Settings, Simulator};
use rustix::process::{Pid, Resource, Rlimit, prlimit};

fn recorded(log: &Path) -> Vec<Reading> {
    let mut replay = Replay::open(log).unwrap();
    let header = replay.header();
    assert_eq!(header.sensor.as_deref(), Some("hmc5843"));
    assert!(header.truth.iter().any(|(key, _)| key == "recorded_from"));
    let entries = replay.by_ref();
    let readings = entries.map(|entry| entry.unwrap().reading).collect();
    assert_eq!(replay.skips().summary(), None);
    readings
}

fn simulated(settings: Settings) -> impl Iterator<Item = Reading> {
    Simulator::new(settings).map(|entry| entry.reading)
}

fn record(rig: &Rig, out: &Path, more: &[&str]) -> Process {
    let mut command = rig.command(&["record"]);
    rig.spawn(command.arg("--out").arg(out).args(more))
}

/// One whose log is so long by now, bytes.
fn recording(rig: &Rig, out: &Path, bytes: u64) -> Process {
    let process = record(rig, out, &[]);
    until("a recording", || {
        fs::metadata(out).is_ok_and(|log| log.len() > bytes)
    });
    process
}

#[test]
fn a_source_is_recorded_to_its_end_while_the_socket_is_served() {
    let rig = Rig::new(20.0, "");
    let out = rig.path("a.csv");
    let mut process = record(&rig, &out, &[]);
    until("the socket", || rig.path("heading.sock").exists());
    let said = process.ends(0);
    // The configuration has a store, which is not for a recording.
    assert!(
        said.contains("no store: calibrations are neither read nor kept"),
        "{said}"
    );
    assert!(
        recorded(&out)
            .into_iter()
            .eq(simulated(Settings::default()))
    );
}

/// Has a daemon record by itself, too, with this board and more settings; the folder of its logs.
fn into_ring(rig: &Rig, speed: f64, board: &str, more: &str) -> PathBuf {
    let ring = rig.path("ring");
    let more = format!("{board}[record]\ndirectory = {ring:?}\n{more}");
    rig.configure(speed, &rig.path("store"), &more);
    ring
}

/// A service that records by itself, too, with a simulated board that goes on for long.
fn service(rig: &Rig, speed: f64) -> Process {
    into_ring(rig, speed, LONG, "");
    rig.start()
}

/// The log that such a service wrote.
fn by_itself(rig: &Rig) -> PathBuf {
    rig.path("ring/record-000001.csv")
}

/// What it holds from this reading on.
fn by_itself_from(rig: &Rig, first: &Reading) -> Vec<Reading> {
    let mut readings = recorded(&by_itself(rig));
    let from = readings.iter().position(|reading| reading == first);
    readings.split_off(from.unwrap())
}

/// The header of a log, but for when it was begun.
fn header(log: &Path) -> Header {
    let mut header = Replay::open(log).unwrap().header().clone();
    header.truth.retain(|(key, _)| key != "recorded_from");
    header
}

#[test]
fn what_is_recorded_from_a_service_is_what_it_records_by_itself() {
    let rig = Rig::new(1.0, "");
    let mut service = service(&rig, 4.0);
    let mut client = rig.client();
    let out = rig.path("a.csv");
    let mut process = recording(&rig, &out, 20_000);
    // One that ends before the service does.
    let early = rig.path("b.csv");
    let mut second = record(&rig, &early, &["--duration", "0.5"]);
    second.ends(0);
    // Whoever has not asked hears of none of it; and the service goes on.
    let seq = client.find("ATT", |_| true)["seq"].as_u64().unwrap();
    loop {
        let message = client.next().unwrap();
        let class = message["class"].as_str().unwrap();
        assert!(!["READING", "BOARD"].contains(&class), "{message}");
        if message["seq"].as_u64() > Some(seq + 100) {
            break;
        }
    }
    service.stop();
    let said = process.ends(0);
    assert!(
        said.contains("the recording ends: headingd has closed"),
        "{said}"
    );

    for (log, whole) in [(&out, true), (&early, false)] {
        assert_eq!(header(log), header(&by_itself(&rig)));
        let readings = recorded(log);
        let rest = by_itself_from(&rig, &readings[0]);
        assert!(rest.starts_with(&readings));
        assert!(!whole || rest.len() == readings.len());
    }
}

/// Only the socket's path counts then: the source may be a pipe, or a log that only the service may read.
#[test]
fn with_a_service_the_configurations_source_is_not_touched() {
    let rig = Rig::new(1.0, LONG);
    let _service = rig.start();
    rig.client();
    rig.replay(1.0, &rig.path("missing.csv"));
    let out = rig.path("a.csv");
    record(&rig, &out, &["--duration", "0.5"]).ends(0);
    assert!(!recorded(&out).is_empty());
    assert!(!rig.path("missing.csv").exists());
}

/// A log has one header: rows of another board would be replayed wrongly.
#[test]
fn a_recording_ends_where_a_reload_has_brought_another_board() {
    let rig = Rig::new(1.0, LONG);
    let service = rig.start();
    rig.client();
    let out = rig.path("a.csv");
    let mut process = recording(&rig, &out, 2000);
    let before = header(&out);
    rig.edit("turns = 100", "turns = 100\nbias_mgauss = [1, 2, 3]");
    service.signal("HUP");
    let said = process.ends(0);
    assert!(said.contains("reads another board now"), "{said}");
    assert_eq!(header(&out), before);
}

#[test]
fn a_recording_that_is_too_slow_says_how_much_it_lost() {
    let rig = Rig::new(1.0, "");
    let mut service = service(&rig, 50.0);
    let mut client = rig.client();
    let out = rig.path("a.csv");
    let mut process = recording(&rig, &out, 20_000);
    process.signal("STOP");
    let seq = client.find("ATT", |_| true)["seq"].as_u64().unwrap();
    client.find("ATT", |att| att["seq"].as_u64() > Some(seq + 3000));
    process.signal("CONT");
    process.says("too slow");
    service.stop();
    let said = process.ends(0);
    let lost: usize = said
        .split_once("lost on the way into the recording readings=")
        .and_then(|(_, rest)| rest.split_whitespace().next()?.parse().ok())
        .unwrap_or_else(|| panic!("{said}"));
    assert_eq!(said.matches("too slow").count(), 1, "{said}");
    let readings = recorded(&out);
    let rest = by_itself_from(&rig, &readings[0]);
    assert_eq!(readings.len() + lost, rest.len(), "{said}");
    let mut rest = rest.iter();
    assert!(
        readings
            .iter()
            .all(|reading| rest.any(|right| right == reading))
    );
}

/// Something that serves on the rig's socket: it says this to whoever asks it something, and hangs up.
fn answering(rig: &Rig, answer: &str) -> JoinHandle<()> {
    let listener = UnixListener::bind(rig.path("heading.sock")).unwrap();
    let answer = answer.to_owned();
    std::thread::spawn(move || {
        let (mut stream, _) = listener.accept().unwrap();
        BufReader::new(&stream)
            .read_line(&mut String::new())
            .unwrap();
        stream.write_all(answer.as_bytes()).unwrap();
    })
}

#[test]
fn a_service_that_hands_out_no_readings_is_told_of() {
    let endless = format!("{{\"class\":\"{}", "x".repeat(2 << 20));
    for (answer, part) in [
        (
            "{\"class\":\"ERROR\",\"message\":\"32 clients already\"}\r\n",
            "heading.sock refuses: 32 clients already",
        ),
        ("220 mail\r\n", "is not headingd's socket for headings"),
        (&endless, "is not headingd's socket for headings"),
        ("", "headingd has closed"),
        (
            "{\"class\":\"VERSION\"}\r\n{\"class\":\"BOARD\",\"header\":\"mail\"}\r\n",
            "cannot read the board of headingd at",
        ),
    ] {
        let rig = Rig::new(1.0, "");
        let serving = answering(&rig, answer);
        let mut process = record(&rig, &rig.path("a.csv"), &[]);
        let said = process.ends(69);
        assert!(said.contains(part), "{said}");
        assert!(!rig.path("a.csv").exists());
        // What was not taken of the endless line breaks its pipe.
        let _ = serving.join();
    }
}

#[test]
fn a_socket_that_says_nothing_of_its_server_is_left_alone() {
    let rig = Rig::new(1.0, "");
    let _other = UnixDatagram::bind(rig.path("heading.sock")).unwrap();
    let mut process = record(&rig, &rig.path("a.csv"), &[]);
    let said = process.ends(69);
    assert!(
        said.contains("cannot find out whether a daemon is serving"),
        "{said}"
    );
    assert!(!rig.path("a.csv").exists());
}

#[test]
fn a_log_that_cannot_be_written_ends_the_command() {
    let rig = Rig::new(1.0, LONG);
    let _socket = leave_dead_socket(rig.path("dead.sock"));
    fs::create_dir(rig.path("folder")).unwrap();
    let [socket, folder] = ["dead.sock", "folder"].map(|name| rig.text(name));
    for (out, status, part) in [
        (
            &socket[..],
            73,
            "dead.sock: it is a socket; name a file, or - for standard output",
        ),
        (&folder, 73, "folder: it is a folder; name a file in it"),
        (
            "/dev/full",
            74,
            "cannot go on with recording /dev/full: No space left",
        ),
        (
            "/none/a.csv",
            73,
            "cannot begin recording /none/a.csv: No such file",
        ),
    ] {
        let mut process = record(&rig, Path::new(out), &[]);
        let said = process.ends(status);
        assert_eq!(said.matches(part).count(), 1, "{said}");
        assert!(!rig.path("heading.sock").exists());
    }
}

/// Nobody opens the other end of the pipe.
#[test]
fn an_output_that_hangs_does_not_hinder_the_end() {
    let rig = Rig::new(1.0, LONG);
    let mut process = record(&rig, &rig.pipe("pipe"), &[]);
    rig.client().find("ATT", |_| true);
    process.signal("INT");
    process.ends(74);
}

fn files(ring: &Path) -> Vec<PathBuf> {
    let mut files: Vec<_> = fs::read_dir(ring)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| !path.ends_with(".lock"))
        .collect();
    files.sort();
    files
}

#[test]
fn the_daemon_keeps_a_ring_of_logs() {
    let rig = Rig::new(1.0, "");
    let ring = into_ring(&rig, 100.0, LONG, "files = 2\nfile_mib = 1\n");
    let mut process = rig.start();
    until("a fourth file", || ring.join("record-000004.csv").exists());
    let said = process.stop();
    let files = files(&ring);
    assert!(
        files.len() == 2 && files[1] >= ring.join("record-000004.csv"),
        "{files:?}"
    );
    assert!(fs::metadata(&files[0]).unwrap().len() < (1 << 20) + (1 << 17));
    // Each is a log of its own, and the later goes on where the earlier ends.
    let [earlier, later] = [recorded(&files[0]), recorded(&files[1])];
    let from_s = earlier[0].t_s;
    let all: Vec<Reading> = earlier.into_iter().chain(later).collect();
    let right = simulated(long()).skip_while(|reading| reading.t_s < from_s);
    assert!(all.iter().copied().eq(right.take(all.len())), "{said}");
}

/// A watchdog starts a daemon again and again whose bus hangs: the logs from before show why.
#[test]
fn a_daemon_that_reads_nothing_removes_no_log_of_its_ring() {
    let rig = Rig::new(1.0, "");
    let no_bus = "kind = \"i2c\"\n[i2c]\nbus = 255\n";
    let ring = into_ring(&rig, 1.0, no_bus, "files = 2\n");
    fs::create_dir(&ring).unwrap();
    let before = [1, 2].map(|number| ring.join(format!("record-00000{number}.csv")));
    for log in &before {
        fs::write(log, "a log").unwrap();
    }
    let (mut process, mut client) = rig.watched();
    client.find("STATE", |state| state["cal_state"] == "fault");
    process.stop();
    assert_eq!(files(&ring), before);
}

/// A service whose recording fails: no file may become longer than 64 KiB, which is what a full disk is, without filling one.
fn on_a_full_disk(rig: &Rig) -> Process {
    let script = "ulimit -S -f 64; exec \"$0\" run --config \"$1\"";
    let process = rig.spawn(
        Command::new("bash")
            .args(["-c", script])
            .arg(env!("CARGO_BIN_EXE_headingd"))
            .arg(rig.path("headingd.toml")),
    );
    process.says("until that is done nothing is recorded");
    process
}

/// Removes a log of a service's ring, and waits until the service has closed it and goes on in another.
fn removed(process: &Process, log: &Path) {
    fs::remove_file(log).unwrap();
    until("another log", || {
        fs::metadata(log).is_ok_and(|log| log.len() > 0)
    });
    let open = fs::read_dir(format!("/proc/{}/fd", process.id())).unwrap();
    let files = open.filter_map(|file| fs::read_link(file.unwrap().path()).ok());
    let gone = format!("{} (deleted)", log.display());
    assert!(files.into_iter().all(|file| file != Path::new(&gone)));
}

/// The disk has no room for anything until the file is closed.
#[test]
fn a_log_that_is_removed_is_closed_on_a_full_disk_too() {
    let rig = Rig::new(1.0, "");
    let service = service(&rig, 1.0);
    let log = by_itself(&rig);
    until("a log", || {
        fs::metadata(&log).is_ok_and(|log| log.len() > 0)
    });
    removed(&service, &log);
    drop(service);

    let rig = Rig::new(1.0, "");
    into_ring(&rig, 50.0, LONG, "");
    let process = on_a_full_disk(&rig);
    removed(&process, &by_itself(&rig));
}

#[test]
fn a_full_disk_interrupts_the_recording_and_not_the_headings() {
    let rig = Rig::new(1.0, "");
    let ring = into_ring(&rig, 50.0, LONG, "");
    let process = on_a_full_disk(&rig);
    let mut client = rig.client();
    let first = client.find("ATT", |_| true)["seq"].as_u64().unwrap();
    client.find("ATT", |att| att["seq"].as_u64() > Some(first + 100));
    let said = process.said();
    assert_eq!(
        said.matches("cannot go on with recording").count(),
        1,
        "{said}"
    );
    let [file] = &files(&ring)[..] else {
        panic!("{:?}", files(&ring));
    };
    assert!(fs::metadata(file).unwrap().len() <= 64 << 10);

    let unlimited = Rlimit {
        current: None,
        maximum: None,
    };
    prlimit(
        Pid::from_raw(process.id() as i32),
        Resource::Fsize,
        unlimited,
    )
    .unwrap();
    process.says("recording again");
    until("the file to grow", || {
        fs::metadata(file).unwrap().len() > 80 << 10
    });
    let mut replay = Replay::open(file).unwrap();
    assert!(replay.by_ref().map(Result::unwrap).count() > 1000);
    assert_eq!(replay.skips().summary(), None);
}

#[test]
fn a_log_is_not_recorded_over_itself() {
    let rig = Rig::new(1.0, "");
    let log = rig.path("a.csv");
    let simulator = Simulator::new(Settings::default());
    let before = crate::rig::log(&simulator.header(), simulator);
    fs::write(&log, &before).unwrap();
    rig.replay(1000.0, &log);
    let link = rig.path("link.csv");
    std::os::unix::fs::symlink(&log, &link).unwrap();
    let said = record(&rig, &link, &[]).ends(73);
    assert!(said.contains("it is the log that is read"), "{said}");
    assert!(fs::read(&log).unwrap() == before);
}

#[test]
fn it_is_said_where_readings_come_from_and_how_many_they_were() {
    let rig = Rig::new(1.0, "[log]\nfilter = \"off\"\n");
    let out = rig.path("a.csv");
    let mut process = record(&rig, &out, &["--duration", "0.5"]);
    let said = process.ends(0);
    let lines: Vec<&str> = said.lines().collect();
    let [first, last] = lines[..] else {
        panic!("{said}");
    };
    assert_eq!(
        first,
        format!(
            "headingd: recording a simulated board into {}",
            out.display()
        )
    );
    let count = recorded(&out).len();
    let start = format!("headingd: {count} readings in ");
    assert!(last.starts_with(&start), "{last}");
    // On a busy machine it may take longer than was asked for.
    let taken_s = last[start.len()..].split(' ').next().unwrap();
    assert!(taken_s.parse::<f64>().unwrap() >= 0.5, "{last}");
}

#[test]
fn without_a_service_and_a_source_there_is_nothing_to_record() {
    let rig = Rig::new(1.0, "");
    rig.edit("kind = \"simulator\"\n", "");
    let out = rig.path("a.csv");
    let mut process = record(&rig, &out, &["--duration", "0.5"]);
    let said = process.ends(78);
    for part in [&rig.text("heading.sock"), "source.kind is not set"] {
        assert!(said.contains(part), "{said}");
    }
    assert!(!out.exists());
}

#[test]
fn a_recording_without_a_reading_is_a_failure_and_the_log_before_it_stays() {
    let rig = Rig::new(1.0, "kind = \"i2c\"\n[i2c]\nbus = 255\n");
    let out = rig.path("keep.csv");
    fs::write(&out, "a log").unwrap();
    let said = record(&rig, &out, &["--duration", "0.5"]).ends(74);
    let last = said.lines().last().unwrap();
    for part in [
        "headingd: 0 readings in ",
        "nothing came from /dev/i2c-255",
        "and the log stays as it was",
    ] {
        assert!(last.contains(part), "{said}");
    }
    assert!(!said.contains("headingd: recording"), "{said}");
    assert_eq!(fs::read(&out).unwrap(), b"a log");
    // What could not be replaced is refused without a reading, too.
    let program = Path::new("/proc/self/exe");
    let said = record(&rig, program, &["--duration", "0.5"]).ends(73);
    assert!(
        said.contains("cannot begin recording /proc/self/exe: "),
        "{said}"
    );

    let rig = Rig::new(1.0, "");
    let said = record(&rig, &out, &["--duration", "0.5"]).ends(0);
    assert!(said.contains("keep.csv, which is replaced"), "{said}");
    assert!(!recorded(&out).is_empty());
}

/// What the first reader of a pipe has taken is lost to a second.
#[test]
fn without_its_socket_it_records_all_the_same_and_opens_a_pipe_once() {
    let rig = Rig::new(1.0, "");
    let pipe = rig.pipe("pipe");
    rig.replay(20.0, &pipe);
    rig.edit("heading.sock", "none/heading.sock");
    let out = rig.path("a.csv");
    let mut process = record(&rig, &out, &[]);
    let simulator = Simulator::new(Settings::default());
    let log = crate::rig::log(&simulator.header(), simulator);
    fs::write(&pipe, log).unwrap();
    let said = process.ends(0);
    let part = "recording with a socket in a temporary folder";
    assert!(said.contains(part), "{said}");
    assert!(
        recorded(&out)
            .into_iter()
            .eq(simulated(Settings::default()))
    );
}

#[test]
fn a_full_service_says_so_itself() {
    let rig = Rig::new(1.0, LONG);
    rig.edit("[socket]\n", "[socket]\nmax_clients = 1\n");
    let mut service = rig.start();
    let _only = rig.client();
    // It hangs up before or after it is asked.
    for _ in 0..5 {
        let mut process = record(&rig, &rig.path("a.csv"), &[]);
        let said = process.ends(69);
        let part = "refuses: headingd serves 1 clients already";
        assert!(said.contains(part), "{said}");
    }
    service.stop();
}

#[test]
fn a_hyphen_is_standard_output_and_nothing_else_goes_there() {
    let rig = Rig::new(1.0, "");
    let mut process = record(&rig, Path::new("-"), &["--duration", "0.5"]);
    let said = process.ends(0);
    assert!(said.contains("into standard output"));
    assert!(!Path::new("-").exists());
    let readings = recorded(&rig.path("stdout"));
    assert!(readings.len() > 10);
}
