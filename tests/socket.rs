//! The gpsd-dialect server at its real edge: a Unix socket, and clients that behave well, badly or not at all.

use std::fs;
use std::os::unix::fs::{FileTypeExt, PermissionsExt};
use std::os::unix::net::{UnixListener, UnixStream as StdStream};
use std::time::{Duration, Instant};

use headingd::calibration::outcome::{Elapsed, Outcome, Samples, Verdict};
use headingd::condition::{Condition, Report};
use headingd::heading::{Heading, MagStatus};
use headingd::publish::gpsd::Device;
use headingd::publish::server::{BindError, Publisher, Server, Settings};
use serde_json::Value;
use tokio::io::{AsyncBufReadExt, AsyncWriteExt, BufReader};
use tokio::net::UnixStream;
use tokio::net::unix::{OwnedReadHalf, OwnedWriteHalf};
use tokio::sync::oneshot;
use tokio::task::{JoinHandle, yield_now};

/// Longer than anything takes on the slowest machine.
const PATIENCE: Duration = Duration::from_secs(30);

/// A running server in its own directory.
struct Rig {
    settings: Settings,
    publisher: Publisher,
    stop: oneshot::Sender<()>,
    task: JoinHandle<std::io::Result<()>>,
    _directory: tempfile::TempDir,
}

fn device() -> Device {
    Device {
        path: "/dev/i2c-1".into(),
        activated: None,
    }
}

fn rig(change: impl FnOnce(&mut Settings)) -> Rig {
    let directory = tempfile::tempdir().unwrap();
    let mut settings = Settings {
        socket: directory.path().join("heading.sock"),
        stale_s: 60.0,
        write_timeout_s: 60.0,
        ..Settings::default()
    };
    change(&mut settings);
    let server = Server::bind(&settings, device()).unwrap();
    let publisher = server.publisher();
    let (stop, stopped) = oneshot::channel();
    let task = tokio::spawn(server.run(async {
        let _ = stopped.await;
    }));
    Rig {
        settings,
        publisher,
        stop,
        task,
        _directory: directory,
    }
}

impl Rig {
    async fn connect(&self) -> Client {
        let (reader, writer) = UnixStream::connect(&self.settings.socket)
            .await
            .unwrap()
            .into_split();
        Client {
            reader: BufReader::new(reader),
            writer,
        }
    }

    /// A client that has read its banner.
    async fn client(&self) -> Client {
        let mut client = self.connect().await;
        assert_eq!(client.next().await["class"], "VERSION");
        client
    }

    /// A client that has asked for `watch` and read the answer.
    async fn watcher(&self, watch: &str) -> Client {
        let mut client = self.client().await;
        client.send(&format!("?WATCH={watch};\n")).await;
        assert_eq!(client.next().await["class"], "DEVICES");
        assert_eq!(client.next().await["class"], "WATCH");
        client
    }

    fn heading(&self, seq: u64) {
        self.publisher.heading(heading(seq), Instant::now(), None);
    }
}

struct Client {
    reader: BufReader<OwnedReadHalf>,
    writer: OwnedWriteHalf,
}

impl Client {
    async fn send(&mut self, text: &str) {
        self.writer.write_all(text.as_bytes()).await.unwrap();
    }

    /// The next line, or `None` once the server has closed the connection.
    async fn line(&mut self) -> Option<String> {
        let mut line = String::new();
        let count = tokio::time::timeout(PATIENCE, self.reader.read_line(&mut line))
            .await
            .expect("the server has gone silent")
            .unwrap_or(0);
        (count > 0).then_some(line)
    }

    async fn next(&mut self) -> Value {
        let line = self.line().await.expect("the server has hung up");
        assert!(line.starts_with(r#"{"class":""#), "{line}");
        serde_json::from_str(&line).unwrap()
    }

    async fn ask(&mut self, request: &str) -> Value {
        self.send(request).await;
        self.next().await
    }
}

async fn until(what: &str, mut condition: impl FnMut() -> bool) {
    let begun = Instant::now();
    while !condition() {
        assert!(begun.elapsed() < PATIENCE, "waited in vain: {what}");
        tokio::time::sleep(Duration::from_millis(1)).await;
    }
}

fn heading(seq: u64) -> Heading {
    Heading {
        seq,
        t_s: seq as f64 * 0.02,
        condition: Condition::Good,
        fused_deg: Some(123.456),
        instantaneous_deg: Some(123.0),
        raw_deg: Some(150.0),
        sd_deg: Some(1.0),
        pitch_deg: Some(2.0),
        roll_deg: Some(-3.0),
        field_mgauss: Some([Some(160.0), Some(-20.0), Some(500.0)]),
        strength_mgauss: Some(525.4),
        mag_status: MagStatus::Normal,
    }
}

fn report(reason: &'static str) -> Report {
    Report {
        condition: Condition::Good,
        reason,
        message: "all is well".into(),
        progress: None,
        t_s: 1.0,
    }
}

fn outcome() -> Outcome {
    Outcome {
        verdict: Verdict::Accepted,
        reason: "accepted",
        message: "good".into(),
        mode: None,
        model: None,
        reference_mgauss: None,
        residual_mgauss: None,
        heading_sd_deg: Some(0.8),
        gyro_rms_deg: None,
        seed: 1,
        basis: None,
        bias_mgauss: Some(vec![10.0, 20.0]),
        scale: None,
        matrix: None,
        samples: Samples::default(),
        window: None,
        swarm: None,
        elapsed_us: Elapsed::default(),
        calibration: None,
    }
}

#[tokio::test]
async fn the_banner_comes_first_and_each_question_is_answered() {
    let rig = rig(|_| {});
    let mut client = rig.connect().await;
    let banner = client.next().await;
    assert_eq!(banner["class"], "VERSION");
    assert_eq!(banner["proto_major"], 3);
    assert_eq!(client.ask("?VERSION;").await, banner);
    let devices = client.ask("?DEVICES;\r\n").await;
    assert_eq!(devices["devices"][0]["path"], "/dev/i2c-1");
    assert_eq!(devices["devices"][0]["driver"], "headingd");
    assert_eq!(client.ask("?DEVICE;\n").await, devices["devices"][0]);
    assert_eq!(rig.publisher.clients(), 1);
}

#[tokio::test]
async fn watch_streams_headings_until_it_is_turned_off() {
    let rig = rig(|_| {});
    let mut client = rig.client().await;
    assert_eq!(client.ask("?WATCH;").await["class"], "DEVICES");
    assert_eq!(client.next().await["enable"], false);
    client
        .send("?WATCH={\"enable\":true,\"json\":true}\n")
        .await;
    assert_eq!(client.next().await["class"], "DEVICES");
    let watch = client.next().await;
    assert_eq!(
        (&watch["enable"], &watch["json"], &watch["state"]),
        (&true.into(), &true.into(), &false.into())
    );
    for seq in 1..=50 {
        rig.heading(seq);
    }
    for seq in 1..=50 {
        let line = client.line().await.unwrap();
        assert!(line.starts_with(r#"{"class":"ATT","device":"/dev/i2c-1","#));
        let att: serde_json::Map<String, Value> = serde_json::from_str(&line).unwrap();
        assert!(
            att.values().all(|v| v.is_number() || v.is_string()),
            "{line}"
        );
        assert_eq!(att["seq"], seq);
        assert_eq!(att["mheading"], 123.46);
    }
    client.send("?WATCH={\"enable\":false};").await;
    assert_eq!(client.next().await["class"], "DEVICES");
    assert_eq!(client.next().await["enable"], false);
    rig.heading(51);
    assert_eq!(client.ask("?VERSION;").await["class"], "VERSION");
}

#[tokio::test]
async fn an_uncalibrated_compass_publishes_no_heading() {
    let rig = rig(|_| {});
    let mut client = rig.watcher("{\"enable\":true}").await;
    let mut uncalibrated = heading(1);
    uncalibrated.condition = Condition::Uncalibrated;
    rig.publisher.heading(uncalibrated, Instant::now(), None);
    let att = client.next().await;
    assert_eq!(att["cal_state"], "uncalibrated");
    assert!(att.get("mheading").is_none() && att.get("heading").is_none());
}

#[tokio::test]
async fn poll_gives_the_latest_heading_while_it_is_fresh() {
    let rig = rig(|settings| settings.stale_s = 30.0);
    let mut client = rig.client().await;
    let poll = client.ask("?POLL;").await;
    assert_eq!(
        (&poll["active"], poll["att"].as_array().map(Vec::len)),
        (&0.into(), Some(0))
    );
    assert!(poll.get("time").is_none());

    rig.heading(1);
    let ago = Instant::now() - Duration::from_secs(2);
    let time = "2026-11-21T10:00:00.000Z".to_owned();
    rig.publisher.heading(heading(2), ago, Some(time.clone()));
    let poll = client.ask("?POLL;").await;
    assert_eq!(poll["active"], 1);
    assert_eq!(poll["time"], time);
    assert_eq!(poll["att"][0]["seq"], 2);
    assert!(poll["att"][0]["age_ms"].as_u64().unwrap() >= 2000);
    assert_eq!(poll["tpv"], Value::Array(vec![]));

    rig.publisher
        .heading(heading(3), Instant::now() - Duration::from_secs(31), None);
    let poll = client.ask("?POLL;").await;
    assert_eq!(
        (&poll["active"], poll["att"].as_array().map(Vec::len)),
        (&0.into(), Some(0))
    );
}

#[tokio::test]
async fn a_stale_heading_is_sent_to_nobody() {
    let rig = rig(|settings| settings.stale_s = 30.0);
    let mut client = rig.watcher("{\"enable\":true}").await;
    rig.publisher
        .heading(heading(1), Instant::now() - Duration::from_secs(31), None);
    rig.heading(2);
    assert_eq!(client.next().await["seq"], 2);
}

#[tokio::test]
async fn state_and_calibration_come_to_those_who_ask() {
    let rig = rig(|_| {});
    let mut plain = rig.watcher("{\"enable\":true}").await;
    rig.publisher.state(&report("first"));
    rig.publisher.state(&report("second"));
    rig.publisher.calibration(&outcome());
    // The latest at once …
    let mut both = rig
        .watcher("{\"enable\":true,\"json\":true,\"state\":true,\"calibration\":true}")
        .await;
    assert_eq!(both.next().await["reason"], "second");
    let calibration = both.next().await;
    assert_eq!(calibration["class"], "CALIBRATION");
    assert_eq!(calibration["bias_mgauss"][1], 20.0);
    // … then each as it happens, in order …
    rig.publisher.state(&report("third"));
    rig.heading(1);
    rig.publisher.state(&report("fourth"));
    assert_eq!(both.next().await["reason"], "third");
    assert_eq!(both.next().await["class"], "ATT");
    assert_eq!(both.next().await["reason"], "fourth");
    // … and nothing of it to others.
    assert_eq!(plain.next().await["class"], "ATT");
    // Asking again while it is on repeats nothing; off and on again does.
    both.send("?WATCH={\"json\":true};").await;
    both.next().await;
    both.next().await;
    assert_eq!(both.ask("?DEVICE;").await["class"], "DEVICE");
    both.send("?WATCH={\"state\":false};?WATCH={\"state\":true};")
        .await;
    for class in ["DEVICES", "WATCH", "DEVICES", "WATCH", "STATE"] {
        assert_eq!(both.next().await["class"], class);
    }
}

#[tokio::test]
async fn garbage_is_answered_and_the_connection_lives() {
    let rig = rig(|_| {});
    let mut client = rig.client().await;
    for garbage in [
        "hello\n",
        "?WATCH={\"enable\":1};",
        "?WATCH={\"device\":\"/dev/other\"};",
        "?DEVICE={\"bps\":4800};",
        "\u{0}\u{1}\n",
    ] {
        assert_eq!(client.ask(garbage).await["class"], "ERROR", "{garbage:?}");
    }
    client.writer.write_all(b"\xff\xfe\n").await.unwrap();
    assert_eq!(client.next().await["class"], "ERROR");
    let long = format!("?WATCH={{\"x\":\"{}\"}};?POLL;\n", "y".repeat(100_000));
    assert_eq!(client.ask(&long).await["class"], "ERROR");
    assert_eq!(client.ask("?VERSION;").await["class"], "VERSION");
}

#[tokio::test]
async fn requests_may_be_cut_anywhere_and_share_a_line() {
    let rig = rig(|_| {});
    let mut client = rig.client().await;
    let requests = "?WATCH={\"enable\":false,\"note\":\"a;b\"};?POLL;\r\n";
    for cut in 0..=requests.len() {
        client.send(&requests[..cut]).await;
        yield_now().await;
        client.send(&requests[cut..]).await;
        for class in ["DEVICES", "WATCH", "POLL"] {
            assert_eq!(client.next().await["class"], class, "cut at {cut}");
        }
    }
    // Without any terminator the end of the stream is one.
    client.send("?DEVICE").await;
    client.writer.shutdown().await.unwrap();
    assert_eq!(client.next().await["class"], "DEVICE");
    assert_eq!(client.line().await, None);
}

#[tokio::test]
async fn many_clients_each_get_everything() {
    let rig = rig(|settings| settings.max_clients = 64);
    let mut clients = Vec::new();
    for _ in 0..64 {
        clients.push(rig.watcher("{\"enable\":true,\"json\":true}").await);
    }
    assert_eq!(rig.publisher.clients(), 64);
    for round in 0..4 {
        for seq in 1..=50 {
            rig.heading(round * 50 + seq);
        }
        for client in &mut clients {
            for seq in 1..=50 {
                assert_eq!(client.next().await["seq"], round * 50 + seq);
            }
        }
    }
    drop(clients);
    until("all have left", || rig.publisher.clients() == 0).await;
}

#[tokio::test]
async fn a_client_that_never_reads_holds_up_nobody_and_loses_no_event() {
    let rig = rig(|_| {});
    let mut sleeper = rig
        .watcher("{\"enable\":true,\"json\":true,\"state\":true}")
        .await;
    let mut reader = rig.watcher("{\"enable\":true}").await;
    let before = resident_bytes();
    rig.heading(1);
    assert_eq!(reader.next().await["seq"], 1);
    for seq in 2..=100_000 {
        if seq == 50_000 {
            rig.publisher.state(&report("missed"));
        }
        rig.heading(seq);
        if seq % 32 == 0 {
            yield_now().await;
        }
    }
    let mut last = 1;
    while last < 100_000 {
        let seq = reader.next().await["seq"].as_u64().unwrap();
        assert!(seq > last, "{seq} after {last}");
        last = seq;
    }
    // Kept without bound, the lines alone would take more than 25 MB.
    let grown = resident_bytes().saturating_sub(before);
    assert!(grown < 20_000_000, "memory grew by {grown} bytes");

    let (mut states, mut last) = (0, 0);
    while last < 100_000 {
        let object = sleeper.next().await;
        match object["seq"].as_u64() {
            Some(seq) => last = seq,
            None => {
                assert_eq!(object["reason"], "missed");
                states += 1;
            }
        }
    }
    assert_eq!(states, 1);
}

fn resident_bytes() -> usize {
    let statm = fs::read_to_string("/proc/self/statm").unwrap();
    let pages: usize = statm.split(' ').nth(1).unwrap().parse().unwrap();
    pages * 4096
}

#[tokio::test]
async fn a_client_that_takes_nothing_is_let_go() {
    let rig = rig(|settings| settings.write_timeout_s = 0.1);
    let _sleeper = rig.watcher("{\"enable\":true}").await;
    assert_eq!(rig.publisher.clients(), 1);
    until("the sleeper is let go", || {
        for seq in 0..50 {
            rig.heading(seq);
        }
        rig.publisher.clients() == 0
    })
    .await;
}

#[tokio::test]
async fn one_client_too_many_is_told_so() {
    let rig = rig(|settings| settings.max_clients = 2);
    let mut first = rig.client().await;
    let _second = rig.client().await;
    let mut third = rig.connect().await;
    assert_eq!(third.next().await["class"], "ERROR");
    assert_eq!(third.line().await, None);
    assert_eq!(first.ask("?VERSION;").await["class"], "VERSION");
    drop(first);
    until("the first has left", || rig.publisher.clients() == 1).await;
    rig.client().await;
}

#[tokio::test]
async fn stopping_delivers_what_was_published_and_removes_the_socket() {
    let rig = rig(|_| {});
    let mut idle = rig.client().await;
    let mut watcher = rig.watcher("{\"enable\":true,\"state\":true}").await;
    rig.publisher.state(&report("stopping"));
    let begun = Instant::now();
    rig.stop.send(()).unwrap();
    rig.task.await.unwrap().unwrap();
    assert!(begun.elapsed() < Duration::from_secs(1));
    assert!(!rig.settings.socket.exists());
    assert_eq!(watcher.next().await["reason"], "stopping");
    assert_eq!(watcher.line().await, None);
    assert_eq!(idle.line().await, None);
    assert_eq!(rig.publisher.clients(), 0);
}

#[tokio::test]
async fn the_socket_has_the_permissions_set_and_nothing_else_is_left() {
    let rig = rig(|settings| settings.mode = "0640".into());
    let found = fs::metadata(&rig.settings.socket).unwrap();
    assert!(found.file_type().is_socket());
    assert_eq!(found.permissions().mode() & 0o777, 0o640);
    let directory = rig.settings.socket.parent().unwrap();
    assert_eq!(fs::read_dir(directory).unwrap().count(), 1);
}

#[tokio::test]
async fn a_dead_daemons_socket_is_replaced_and_a_living_ones_respected() {
    let rig = rig(|settings| drop(UnixListener::bind(&settings.socket).unwrap()));
    rig.client().await;
    let refused = Server::bind(&rig.settings, device()).unwrap_err();
    assert!(matches!(refused, BindError::Busy { .. }), "{refused}");
    assert!(refused.to_string().contains("another daemon is serving"));
    rig.client().await;
}

#[test]
fn a_file_that_is_no_socket_and_a_missing_directory_are_refused() {
    let directory = tempfile::tempdir().unwrap();
    let mut settings = Settings {
        socket: directory.path().join("file"),
        ..Settings::default()
    };
    fs::write(&settings.socket, "precious").unwrap();
    let refused = Server::bind(&settings, device()).unwrap_err();
    assert!(matches!(refused, BindError::NotASocket { .. }), "{refused}");
    assert_eq!(fs::read(&settings.socket).unwrap(), b"precious");

    settings.socket = directory.path().join("missing/heading.sock");
    let refused = Server::bind(&settings, device()).unwrap_err();
    assert!(
        matches!(refused, BindError::NoDirectory { .. }),
        "{refused}"
    );
}

#[test]
fn a_server_removes_only_its_own_socket() {
    let directory = tempfile::tempdir().unwrap();
    let settings = Settings {
        socket: directory.path().join("heading.sock"),
        ..Settings::default()
    };
    let first = Server::bind(&settings, device()).unwrap();
    fs::remove_file(&settings.socket).unwrap();
    let second = Server::bind(&settings, device()).unwrap();
    drop(first);
    StdStream::connect(&settings.socket).unwrap();
    drop(second);
    assert!(!settings.socket.exists());
}
