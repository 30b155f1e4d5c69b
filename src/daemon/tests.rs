//! The daemon's task: status, watchdog and reloads.

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
use crate::service::tests::{heard, manager};

/// All that the manager hears, in order.
fn all_heard(manager: &UnixDatagram) -> Vec<String> {
    std::iter::from_fn(|| heard(manager)).collect()
}

/// Waits until the manager has heard this; gives all that it has heard on the way.
async fn until(manager: &UnixDatagram, start: &str) -> Vec<String> {
    let mut words = Vec::new();
    let begun = Instant::now();
    while !words.iter().any(|word: &String| word.starts_with(start)) {
        assert!(begun.elapsed() < Duration::from_secs(30), "{words:?}");
        tokio::time::sleep(Duration::from_millis(2)).await;
        words.extend(all_heard(manager));
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

/// Reloads to a session with another source, which sends nothing before the next wait.
async fn reload(daemon: &mut Daemon) {
    let mut config = daemon.session.config.clone();
    config.store.history = config.store.history % 100 + 1;
    daemon.begin_reload(NewConfig {
        load: Box::new(move || Ok(config)),
        applied: Box::new(|_| ()),
    });
    daemon.reload.prepared().await;
    daemon.end_reload().await.unwrap();
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
    daemon.take(vec![reading(), SourceEvent::NewStretch]);
    daemon.carry_out(Action::Publish(Heading {
        condition: Condition::Good,
        instantaneous_deg: Some(90.0),
        ..Heading::default()
    }));
    let (answer, mut status) = oneshot::channel();
    let request = ControlRequest::Status {};
    daemon.answer(ControlCall { request, answer });
    let status = status.try_recv().unwrap().more;
    assert_eq!(status["cal_state"], "uncalibrated");
    assert_eq!(status["counts"]["headings"], 1);
}

#[tokio::test]
async fn a_hung_device_is_left_to_the_watchdog_and_an_absent_one_is_not() {
    let folder = tempfile::tempdir().unwrap();
    let (_notify, manager, service) = manager(Some(Duration::from_millis(100)));
    let (daemon, sender) = fed(folder.path(), service);
    let script = async {
        // Not ready before the device has said anything.
        for _ in 0..3 {
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
        assert_eq!(heard(&manager), None);

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

#[tokio::test]
async fn after_a_reload_the_watchdog_begins_anew() {
    let folder = tempfile::tempdir().unwrap();
    // No other sign of life is due in the time of the test.
    let (_notify, manager, service) = manager(Some(Duration::from_secs(3600)));
    let (mut daemon, _) = fed(folder.path(), service);
    let fresh = daemon.take(vec![reading()]);
    daemon.tick(fresh);
    assert!(all_heard(&manager).contains(&"WATCHDOG=1".to_owned()));
    reload(&mut daemon).await;
    let words = all_heard(&manager);
    assert!(words[0].starts_with("RELOADING=1"), "{words:?}");
    assert_eq!(words[1..], ["WATCHDOG=1"]);
}

#[tokio::test]
async fn sessions_that_have_ended_are_forgotten() {
    let folder = tempfile::tempdir().unwrap();
    let (mut daemon, _) = fed(folder.path(), Service::default());
    for _ in 0..5 {
        reload(&mut daemon).await;
        // The one before has nothing to write, and ends now.
        tokio::task::yield_now().await;
    }
    assert_eq!(daemon.closing.len(), 1);
}

#[tokio::test]
async fn the_end_waits_for_a_reload_that_holds_the_store() {
    let folder = tempfile::tempdir().unwrap();
    let (mut daemon, _) = fed(folder.path(), Service::default());
    let mut config = daemon.session.config.clone();
    config.store.directory = folder.path().join("store");
    let open = |config: &Config, running: &RunningStore| {
        let source = SourceTask::open(config).unwrap();
        Session::open(source, config.clone(), running).unwrap()
    };
    daemon.session = open(&config, &RunningStore::default());

    // A reload to the same folder, which ends when it is told to.
    let running = daemon.session.store.running();
    let (holds, held) = oneshot::channel();
    let (go, told) = std::sync::mpsc::channel();
    daemon.begin_reload(NewConfig {
        load: Box::new(move || {
            let _session = open(&config, &running);
            holds.send(()).unwrap();
            told.recv().unwrap();
            Err("told to end".to_owned())
        }),
        applied: Box::new(|_| ()),
    });
    held.await.unwrap();
    assert!(daemon.session.store.is_shared());
    let patience = Duration::from_secs(30);
    let release = async { go.send(()).unwrap() };
    let (closed, ()) = tokio::join!(daemon.reload.close(patience), release);
    assert!(closed);
    assert!(!daemon.session.store.is_shared());
}
