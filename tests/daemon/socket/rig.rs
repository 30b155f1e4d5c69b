//! A running server, clients of it, and something to publish.

use std::time::{Duration, Instant};

use headingd::calibration::outcome::{Outcome, Verdict};
use headingd::condition::{Condition, Report};
use headingd::heading::Heading;
use headingd::publish::gpsd::Device;
use headingd::publish::nmea;
use headingd::publish::server::{BindError, Publisher, Server, Settings};
use serde_json::Value;
use tokio::io::{AsyncBufReadExt, AsyncWriteExt, BufReader};
use tokio::net::UnixStream;
use tokio::net::unix::{OwnedReadHalf, OwnedWriteHalf};
use tokio::sync::oneshot;
use tokio::task::JoinHandle;

use crate::rig::{PATIENCE, folder};

/// Older headings than this are stale.
const STALE: Duration = Duration::from_secs(30);

/// A running server in its own directory.
pub struct Rig {
    pub settings: Settings,
    pub publisher: Publisher,
    pub stop: oneshot::Sender<()>,
    pub task: JoinHandle<std::io::Result<()>>,
    _directory: tempfile::TempDir,
}

fn device() -> Device {
    Device {
        path: "/dev/i2c-1".into(),
        activated: None,
        sensor: Some("hmc5843".into()),
        bps: None,
    }
}

/// Claims the socket.
pub fn serve(settings: &Settings) -> Result<Server, BindError> {
    Server::bind(None, settings, &nmea::Settings::default(), device(), STALE)
}

/// Settings of a socket in a folder of its own.
pub fn settings() -> (tempfile::TempDir, Settings) {
    let directory = folder();
    let settings = Settings {
        socket: directory.path().join("heading.sock"),
        write_timeout_s: 60.0,
        ..Settings::default()
    };
    (directory, settings)
}

pub fn rig(change: impl FnOnce(&mut Settings)) -> Rig {
    let (directory, mut settings) = settings();
    change(&mut settings);
    let server = serve(&settings).unwrap();
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
    pub async fn connect(&self) -> Client {
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
    pub async fn client(&self) -> Client {
        let mut client = self.connect().await;
        assert_eq!(client.next().await["class"], "VERSION");
        client
    }

    /// A client that has asked for `watch` and read the answer.
    pub async fn watcher(&self, watch: &str) -> Client {
        let mut client = self.client().await;
        client.send(&format!("?WATCH={watch};\n")).await;
        assert_eq!(client.next().await["class"], "DEVICES");
        assert_eq!(client.next().await["class"], "WATCH");
        client
    }

    pub fn heading(&self, seq: u64) {
        self.publisher.heading(heading(seq), Instant::now(), None);
    }

    /// Publishes a heading that is stale already.
    pub fn stale_heading(&self, seq: u64) {
        let taken = Instant::now() - STALE - Duration::from_secs(1);
        self.publisher.heading(heading(seq), taken, None);
    }
}

pub struct Client {
    reader: BufReader<OwnedReadHalf>,
    pub writer: OwnedWriteHalf,
}

impl Client {
    pub async fn send(&mut self, text: &str) {
        self.writer.write_all(text.as_bytes()).await.unwrap();
    }

    /// The next line, or `None` once the server has closed the connection.
    pub async fn line(&mut self) -> Option<String> {
        let line = self.raw_line().await;
        assert!(line.is_empty() || line.ends_with("}\r\n"), "{line:?}");
        (!line.is_empty()).then_some(line)
    }

    /// The next line, whatever it is; empty once the server has closed the connection.
    pub async fn raw_line(&mut self) -> String {
        let mut line = String::new();
        let _ = tokio::time::timeout(PATIENCE, self.reader.read_line(&mut line))
            .await
            .expect("the server has gone silent");
        line
    }

    pub async fn next(&mut self) -> Value {
        let line = self.line().await.expect("the server has hung up");
        assert!(line.starts_with(r#"{"class":""#), "{line}");
        serde_json::from_str(&line).unwrap()
    }

    pub async fn ask(&mut self, request: &str) -> Value {
        self.send(request).await;
        self.next().await
    }
}

pub async fn until(what: &str, mut condition: impl FnMut() -> bool) {
    let begun = Instant::now();
    while !condition() {
        assert!(begun.elapsed() < PATIENCE, "waited in vain: {what}");
        tokio::time::sleep(Duration::from_millis(1)).await;
    }
}

pub fn heading(seq: u64) -> Heading {
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
        turn_deg_min: Some(-30.0),
        rate_deg_s: Some([0.1, -0.2, -0.5]),
        specific_force_m_s2: Some([0.0, 0.5, -9.8]),
        dip_deg: Some(72.5),
        field_mgauss: Some([Some(160.0), Some(-20.0), Some(500.0)]),
        strength_mgauss: Some(525.4),
        ..Heading::default()
    }
}

pub fn report(reason: &'static str) -> Report {
    Report {
        condition: Condition::Good,
        reason,
        message: "all is well".into(),
        progress: None,
        t_s: 1.0,
    }
}

pub fn outcome() -> Outcome {
    Outcome {
        verdict: Verdict::Accepted,
        reason: "accepted",
        message: "good".into(),
        heading_sd_deg: Some(0.8),
        bias_mgauss: Some(vec![10.0, 20.0]),
        ..Outcome::begun(1, 0)
    }
}
