//! Signs of life: a device that falls silent without a word hangs, and one that is known to be away does not.

use std::os::unix::net::UnixDatagram;
use std::path::Path;
use std::time::Duration;

use tokio::time::timeout;

use super::batch::Events;
use super::*;
use crate::condition::{Condition, SourceFault};
use crate::config::source::Kind;
use crate::heading::Heading;
use crate::publish::control::ControlRequest;
use crate::reading::Reading;
use crate::sensor::SourceEvent;

/// What the manager hears, in order.
fn heard(manager: &UnixDatagram) -> Vec<String> {
    let mut words = Vec::new();
    let mut bytes = [0; 4096];
    while let Ok(count) = manager.recv(&mut bytes) {
        words.push(String::from_utf8(bytes[..count].to_vec()).unwrap());
    }
    words
}

/// Waits until the manager has heard this; gives all that it has heard on the way.
async fn until(manager: &UnixDatagram, start: &str) -> Vec<String> {
    let mut words = Vec::new();
    let begun = Instant::now();
    while !words.iter().any(|word: &String| word.starts_with(start)) {
        assert!(begun.elapsed() < Duration::from_secs(30), "{words:?}");
        tokio::time::sleep(Duration::from_millis(2)).await;
        words.extend(heard(manager));
    }
    words
}

/// A daemon, and what feeds it.
fn fed(folder: &Path, service: Service) -> (Daemon, mpsc::Sender<Events>) {
    let mut config = Config::default();
    config.socket.socket = folder.join("heading.sock");
    config.source.kind = Some(Kind::I2c);
    config.store.directory = "".into();
    let mut daemon = Daemon::open(&config, service).unwrap();
    let (sender, source) = SourceTask::fed("test");
    daemon.session.source = source;
    (daemon, sender)
}

fn reading() -> SourceEvent {
    let reading = Reading {
        t_s: 0.0,
        field_mgauss: Some([Some(160.0), Some(0.0), Some(500.0)]),
        ..Reading::default()
    };
    SourceEvent::Reading(reading, Instant::now())
}

#[tokio::test]
async fn the_status_counts_headings_without_a_gyro_and_has_what_was_reported_last() {
    let folder = tempfile::tempdir().unwrap();
    let (mut daemon, _) = fed(folder.path(), Service::default());
    daemon.take(Some(vec![reading(), SourceEvent::NewStretch]));
    daemon.carry_out(Action::Publish(Heading {
        condition: Condition::Good,
        instantaneous_deg: Some(90.0),
        ..Heading::default()
    }));
    let (answer, mut status) = oneshot::channel();
    let request = ControlRequest::Status {};
    daemon.order(ControlCall { request, answer });
    let status = status.try_recv().unwrap().more;
    assert_eq!(status["cal_state"], "uncalibrated");
    assert_eq!(status["counts"]["headings"], 1);
}

#[tokio::test]
async fn a_hung_device_is_left_to_the_watchdog_and_an_absent_one_is_not() {
    let folder = tempfile::tempdir().unwrap();
    let notify = folder.path().join("notify");
    let manager = UnixDatagram::bind(&notify).unwrap();
    manager.set_nonblocking(true).unwrap();
    let patience = Duration::from_millis(100);
    let service = Service::at(notify.to_str().unwrap(), Some(patience)).unwrap();
    let (daemon, sender) = fed(folder.path(), service);
    let script = async {
        // Not ready before the device has said anything.
        for _ in 0..3 {
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
        assert_eq!(heard(&manager), Vec::<String>::new());

        sender.send(vec![reading()]).await.unwrap();
        until(&manager, "READY=1").await;
        let hung = until(&manager, "STATUS=stale").await;
        let alive = hung.iter().filter(|word| *word == "WATCHDOG=1").count();
        assert!(alive <= 1, "{hung:?}");

        // It has been silent for five times the watchdog's patience: systemd would have ended it by now.
        let fault = SourceFault {
            code: "no_bus",
            message: "there is no such bus".to_owned(),
        };
        sender
            .send(vec![SourceEvent::Fault(Some(fault))])
            .await
            .unwrap();
        until(&manager, "WATCHDOG=1").await;
        let waiting = until(&manager, "STATUS=fault (no_bus)").await;
        assert!(
            waiting.iter().any(|word| word == "WATCHDOG=1"),
            "{waiting:?}"
        );
    };
    let ended = timeout(Duration::from_secs(60), daemon.run_until(script)).await;
    ended.unwrap().unwrap();
}
