//! Signs of life: a device that falls silent without a word hangs, and one that is known to be away does not.

use std::os::unix::net::UnixDatagram;
use std::time::Duration;

use super::*;
use crate::config::source::Kind;
use crate::frame::Mountings;
use crate::publish::gpsd::Device;
use crate::publish::nmea;
use crate::publish::server::{self, Server};
use crate::store::Identity;

/// What the manager hears, in order.
fn heard(manager: &UnixDatagram) -> Vec<String> {
    let mut words = Vec::new();
    let mut bytes = [0; 4096];
    while let Ok(count) = manager.recv(&mut bytes) {
        words.push(String::from_utf8(bytes[..count].to_vec()).unwrap());
    }
    words
}

/// Goes on until the manager has heard this; gives all that it has heard on the way.
async fn until(
    manager: &UnixDatagram,
    journey: &mut Journey,
    messages: &mut mpsc::Receiver<Message>,
    start: &str,
) -> Vec<String> {
    let mut words = Vec::new();
    let begun = Instant::now();
    let (_, mut orders) = mpsc::channel(1);
    while !words.iter().any(|word: &String| word.starts_with(start)) {
        assert!(begun.elapsed() < Duration::from_secs(30), "{words:?}");
        let _ = tokio::time::timeout(
            Duration::from_millis(20),
            journey.make(messages, &mut orders),
        )
        .await;
        words.extend(heard(manager));
    }
    words
}

#[tokio::test]
async fn a_hung_device_is_left_to_the_watchdog_and_an_absent_one_is_not() {
    let folder = tempfile::tempdir().unwrap();
    let notify = folder.path().join("notify");
    let manager = UnixDatagram::bind(&notify).unwrap();
    manager.set_nonblocking(true).unwrap();
    let patience = Duration::from_millis(100);
    let service = Service::at(notify.to_str().unwrap(), Some(patience)).unwrap();
    let socket = server::Settings {
        socket: folder.path().join("heading.sock"),
        ..server::Settings::default()
    };
    let device = Device {
        path: "test".to_owned(),
        activated: None,
        sensor: None,
        bps: None,
    };
    let server = Server::bind(
        &socket,
        &nmea::Settings::default(),
        device,
        Duration::from_millis(500),
    )
    .unwrap();
    let identity = Identity {
        sensor: "hmc5843".to_owned(),
        mag_axes: Mountings::default().mag,
    };
    let mut config = Config::default();
    config.source.kind = Some(Kind::I2c);
    config.store.directory = "".into();
    let mut journey = Journey::new(
        Pipeline::new(config.setup(&Mountings::default()), None),
        Keeper::open(&config.store, identity).unwrap(),
        None,
        &config,
        "test".to_owned(),
        &Header::default(),
        Lasting::new(server.publisher(), service).unwrap(),
    );
    let (sender, mut messages) = mpsc::channel(8);
    let (_, mut orders) = mpsc::channel(1);

    // Not ready before the device has said anything.
    for _ in 0..3 {
        let making = journey.make(&mut messages, &mut orders);
        let _ = tokio::time::timeout(Duration::from_millis(20), making).await;
    }
    assert_eq!(heard(&manager), Vec::<String>::new());

    let reading = Reading {
        t_s: 0.0,
        field_mgauss: Some([Some(160.0), Some(0.0), Some(500.0)]),
        ..Reading::default()
    };
    let message = Message::Readings(vec![(reading, Instant::now())]);
    sender.send(message).await.unwrap();
    until(&manager, &mut journey, &mut messages, "READY=1").await;
    let hung = until(&manager, &mut journey, &mut messages, "STATUS=stale").await;
    let alive = hung.iter().filter(|word| *word == "WATCHDOG=1").count();
    assert!(alive <= 1, "{hung:?}");

    // It has been silent for five times the watchdog's patience: systemd would have ended it by now.
    let trouble = Trouble {
        code: "no_bus",
        message: "there is no such bus".to_owned(),
    };
    sender.send(Message::Trouble(Some(trouble))).await.unwrap();
    until(&manager, &mut journey, &mut messages, "WATCHDOG=1").await;
    let waiting = until(
        &manager,
        &mut journey,
        &mut messages,
        "STATUS=fault (no_bus)",
    )
    .await;
    assert!(
        waiting.iter().any(|word| word == "WATCHDOG=1"),
        "{waiting:?}"
    );
}
