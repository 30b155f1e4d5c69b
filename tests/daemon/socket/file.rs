//! The socket as a file: who may claim it, and what becomes of it.

use std::fs;
use std::os::unix::fs::{FileTypeExt, PermissionsExt};
use std::os::unix::net::UnixStream;
use std::sync::{Barrier, mpsc};

use headingd::publish::server::BindFault;

use super::rig::{report, rig, serve, settings};
use crate::rig::{PATIENCE, full_socket, leave_dead_socket};

#[tokio::test]
async fn stopping_delivers_what_was_published_and_removes_the_socket() {
    let rig = rig(|_| {});
    let mut idle = rig.client().await;
    let mut watcher = rig.watcher("{\"enable\":true,\"state\":true}").await;
    rig.publisher.state(&report("stopping"));
    rig.stop.send(()).unwrap();
    rig.task.await.unwrap().unwrap();
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
    // And its lock, as long as it is served on.
    assert_eq!(fs::read_dir(directory).unwrap().count(), 2);
    rig.stop.send(()).unwrap();
    rig.task.await.unwrap().unwrap();
    assert_eq!(fs::read_dir(directory).unwrap().count(), 0);
}

#[test]
fn a_daemon_that_has_only_locked_the_socket_so_far_comes_first() {
    let (directory, settings) = settings();
    let path = directory.path().join("heading.sock.lock");
    fs::write(&path, "4321\n").unwrap();
    let lock = fs::File::open(&path).unwrap();
    lock.try_lock().unwrap();
    let refused = serve(&settings).unwrap_err();
    assert!(matches!(refused.why, BindFault::Busy(Some(4321))));
    assert!(refused.to_string().contains("(process 4321)"), "{refused}");
    assert!(!settings.socket.exists());
    // It has died. To close the file would not do while a program that another test is starting has a copy of it.
    lock.unlock().unwrap();
    serve(&settings).unwrap();
}

#[test]
fn of_many_that_start_together_one_serves() {
    let (_directory, settings) = settings();
    for _ in 0..100 {
        leave_dead_socket(&settings.socket);
        let start = Barrier::new(4);
        let bound: Vec<_> = std::thread::scope(|scope| {
            let bind = || {
                start.wait();
                serve(&settings)
            };
            let threads: Vec<_> = (0..4).map(|_| scope.spawn(bind)).collect();
            threads.into_iter().map(|t| t.join().unwrap()).collect()
        });
        let (serving, refused): (Vec<_>, Vec<_>) = bound.into_iter().partition(Result::is_ok);
        assert_eq!(serving.len(), 1);
        for refused in refused {
            let refused = refused.unwrap_err();
            assert!(matches!(refused.why, BindFault::Busy(_)), "{refused}");
        }
    }
}

#[test]
fn a_listener_with_a_full_backlog_is_not_waited_for() {
    let (_directory, settings) = settings();
    let _full = full_socket(&settings.socket);
    let (sender, bound) = mpsc::channel();
    std::thread::spawn(move || {
        // An error means that it is not waited for any more.
        let _ = sender.send(serve(&settings).map(drop));
    });
    let refused = bound.recv_timeout(PATIENCE).expect("it hangs").unwrap_err();
    assert!(matches!(refused.why, BindFault::Busy(_)), "{refused}");
}

#[test]
fn a_file_that_is_no_socket_and_a_folder_that_will_not_do_are_refused() {
    let (directory, mut settings) = settings();
    fs::write(&settings.socket, "precious").unwrap();
    let refused = serve(&settings).unwrap_err();
    let text = refused.to_string();
    assert!(text.contains("a file that is no socket is there"), "{text}");
    assert_eq!(fs::read(&settings.socket).unwrap(), b"precious");

    settings.socket = directory.path().join("missing/heading.sock");
    let text = serve(&settings).unwrap_err().to_string();
    assert!(text.contains("missing does not exist"), "{text}");

    // Nobody may make a file there, not even root.
    settings.socket = "/sys/heading.sock".into();
    let text = serve(&settings).unwrap_err().to_string();
    assert!(text.contains("let this user write to /sys "), "{text}");
}

#[test]
fn a_server_removes_only_its_own_socket() {
    let (directory, settings) = settings();
    let first = serve(&settings).unwrap();
    // Somebody clears up.
    for file in fs::read_dir(directory.path()).unwrap() {
        fs::remove_file(file.unwrap().path()).unwrap();
    }
    let second = serve(&settings).unwrap();
    drop(first);
    UnixStream::connect(&settings.socket).unwrap();
    drop(second);
    assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 0);
}
