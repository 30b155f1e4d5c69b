//! Many clients, slow clients, too many clients.

use std::process::Command;
use std::time::{Duration, Instant};

use rustix::io::ioctl_fionread;
use tokio::io::AsyncWriteExt;
use tokio::task::yield_now;

use super::rig::{report, rig, until};
use crate::health::resident_bytes;

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

/// In a process of its own, since the memory of this one is that of all tests.
#[test]
fn a_client_that_never_reads_holds_up_nobody_and_loses_no_event() {
    let output = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "socket::load::a_sleeper_in_a_process_of_its_own"])
        .args(["--ignored", "--nocapture"])
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(
        output.status.success() && said.contains("1 passed"),
        "{said}{}",
        String::from_utf8_lossy(&output.stderr)
    );
}

#[tokio::test]
#[ignore = "the process whose memory is measured; the test above starts it"]
async fn a_sleeper_in_a_process_of_its_own() {
    let rig = rig(|_| {});
    let mut sleeper = rig
        .watcher("{\"enable\":true,\"json\":true,\"state\":true}")
        .await;
    let mut reader = rig.watcher("{\"enable\":true}").await;
    let before = resident_bytes(std::process::id());
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
    let grown = resident_bytes(std::process::id()).saturating_sub(before);
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

#[tokio::test]
async fn little_is_kept_for_a_client_that_takes_nothing() {
    let rig = rig(|_| {});
    let sleeper = rig.watcher("{\"enable\":true}").await;
    let mut reader = rig.watcher("{\"enable\":true}").await;
    for seq in 1..=1000 {
        rig.heading(seq);
        assert_eq!(reader.next().await["seq"], seq);
    }
    let kept = ioctl_fionread(sleeper.writer.as_ref()).unwrap();
    assert!((1..=64 << 10).contains(&kept), "{kept} bytes");
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
async fn nonsense_is_answered_at_a_bounded_rate_and_holds_up_nobody() {
    let rig = rig(|_| {});
    let mut watcher = rig.watcher("{\"enable\":true}").await;
    let mut babbler = rig.client().await;
    let begun = Instant::now();
    // What the daemon does not read waits in the socket.
    babbler.send(&"x;".repeat(2000)).await;
    for seq in 1..=40 {
        assert_eq!(babbler.next().await["class"], "ERROR");
        rig.heading(seq);
        assert_eq!(watcher.next().await["seq"], seq);
    }
    // 10 at once and 50 a second; it is less on a slow machine.
    assert!(begun.elapsed() > Duration::from_millis(500));
    // They count as one client's: nobody else has to wait for an answer, and this one is let go at once.
    for _ in 0..50 {
        assert_eq!(watcher.ask("?VERSION;").await["class"], "VERSION");
    }
    drop(babbler);
    until("the babbler has left", || rig.publisher.clients() == 1).await;
}

#[tokio::test]
async fn a_request_without_a_newline_is_answered_at_the_end_of_many() {
    let rig = rig(|_| {});
    let mut client = rig.client().await;
    client.send(&"?VERSION;".repeat(150)).await;
    client.send("?DEVICES").await;
    client.writer.shutdown().await.unwrap();
    for _ in 0..150 {
        assert_eq!(client.next().await["class"], "VERSION");
    }
    assert_eq!(client.next().await["class"], "DEVICES");
    assert_eq!(client.line().await, None);
}
