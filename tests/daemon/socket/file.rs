//! The socket as a file: who may claim it, and what becomes of it.

use std::fs;
use std::os::unix::fs::{FileTypeExt, PermissionsExt};
use std::os::unix::net::{UnixListener, UnixStream};
use std::time::{Duration, Instant};

use headingd::publish::server::{BindError, Server, Settings};

use super::rig::{STALE, device, report, rig};

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
    let refused = Server::bind(&rig.settings, device(), STALE).unwrap_err();
    assert!(matches!(refused, BindError::Busy { .. }), "{refused}");
    assert!(refused.to_string().contains("another daemon is serving"));
    rig.client().await;
}

#[test]
fn a_file_that_is_no_socket_and_a_folder_that_will_not_do_are_refused() {
    let directory = tempfile::tempdir().unwrap();
    let mut settings = Settings {
        socket: directory.path().join("file"),
        ..Settings::default()
    };
    fs::write(&settings.socket, "precious").unwrap();
    let refused = Server::bind(&settings, device(), STALE).unwrap_err();
    assert!(matches!(refused, BindError::NotASocket { .. }), "{refused}");
    assert_eq!(fs::read(&settings.socket).unwrap(), b"precious");

    settings.socket = directory.path().join("missing/heading.sock");
    let refused = Server::bind(&settings, device(), STALE).unwrap_err();
    assert!(
        matches!(refused, BindError::NoDirectory { .. }),
        "{refused}"
    );

    // Nobody may make a file there, not even root.
    settings.socket = "/sys/heading.sock".into();
    let refused = Server::bind(&settings, device(), STALE).unwrap_err();
    assert!(
        matches!(refused, BindError::NotAllowed { .. })
            && refused.to_string().contains("let this user write to /sys "),
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
    let first = Server::bind(&settings, device(), STALE).unwrap();
    fs::remove_file(&settings.socket).unwrap();
    let second = Server::bind(&settings, device(), STALE).unwrap();
    drop(first);
    UnixStream::connect(&settings.socket).unwrap();
    drop(second);
    assert!(!settings.socket.exists());
}
