//! NMEA 0183 to those who do not ask: UDP, TCP, and what looks like a serial port.

use std::fs::{self, File};
use std::io::Read;
use std::net::{SocketAddr, TcpListener, TcpStream as StdTcpStream};
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use headingd::check::Check;
use headingd::heading::Heading;
use headingd::publish::nmea::sentences;
use headingd::publish::outputs::{self, Format, pty, tcp, udp};
use rustix::io::ioctl_fionread;
use serde_json::Value;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpStream, UdpSocket};
use tokio::time::timeout;

use super::rig::{Rig, heading, rig, until};
use crate::rig::PATIENCE;

/// Publishes a heading in so many degrees, in its turn: ten a second go out.
fn publish(rig: &Rig, degrees: f64) -> String {
    let one = Heading {
        fused_deg: Some(degrees),
        ..heading(1)
    };
    let taken = Instant::now() + Duration::from_secs_f64(degrees);
    rig.publisher.heading(one.clone(), taken, None);
    sentences("HC", &one)
}

fn udp_to(to: impl ToString) -> udp::Settings {
    udp::Settings {
        to: to.to_string(),
        ..udp::Settings::default()
    }
}

fn tcp_on(listen: impl ToString) -> tcp::Settings {
    tcp::Settings {
        listen: listen.to_string(),
        ..tcp::Settings::default()
    }
}

/// Of an output that is off.
fn off<T: Default>() -> T {
    T::default()
}

/// Somebody to whom datagrams go.
async fn receiver() -> (UdpSocket, udp::Settings) {
    let receiver = UdpSocket::bind("127.0.0.1:0").await.unwrap();
    let to = udp_to(receiver.local_addr().unwrap());
    (receiver, to)
}

/// The next datagram.
async fn received(receiver: &UdpSocket) -> String {
    let mut bytes = [0; 1500];
    let count = timeout(PATIENCE, receiver.recv(&mut bytes)).await;
    String::from_utf8(bytes[..count.unwrap().unwrap()].into()).unwrap()
}

/// An address that nobody else listens at: each process has its own loopback address, and this port is not among those
/// that the kernel gives away. A port that was asked for and given back would not do: a process that another test is
/// starting has a copy of each descriptor until it executes its program, and keeps the port for so long.
fn own_address() -> SocketAddr {
    let [.., high, middle, low] = std::process::id().to_be_bytes();
    SocketAddr::from(([127, high, middle, low.max(2)], 10110))
}

#[tokio::test]
async fn each_heading_is_a_datagram() {
    let rig = rig(|_| {});
    let (receiver, udp) = receiver().await;
    let mut outputs = outputs::open(&udp, &off(), &off(), &rig.publisher);
    for right in [1.0, 2.0, 3.0].map(|degrees| publish(&rig, degrees)) {
        assert_eq!(received(&receiver).await, right);
    }
    outputs.shutdown().await;
}

#[tokio::test]
async fn signal_k_comes_as_deltas() {
    let rig = rig(|_| {});
    let (receiver, mut udp) = receiver().await;
    udp.format = Format::SignalK;
    let mut port = own_address();
    port.set_port(10112);
    let mut tcp = tcp_on(port);
    tcp.format = Format::SignalK;
    let mut outputs = outputs::open(&udp, &tcp, &off(), &rig.publisher);
    publish(&rig, 57.0);
    let delta: Value = serde_json::from_str(&received(&receiver).await).unwrap();
    let first = &delta["updates"][0]["values"][0];
    assert_eq!(first["path"], "navigation.headingMagnetic");
    assert_eq!(first["value"], 0.994838);
    let client = TcpStream::connect(port).await.unwrap();
    let (mut degrees, mut bytes) = (57.0, [0; 11]);
    until("a delta over TCP", || {
        degrees += 1.0;
        publish(&rig, degrees);
        client.try_read(&mut bytes).is_ok()
    })
    .await;
    assert_eq!(&bytes, b"{\"updates\":");
    outputs.shutdown().await;
}

#[tokio::test]
async fn whoever_connects_gets_what_comes_from_then_on() {
    let rig = rig(|_| {});
    let port = own_address();
    let mut outputs = outputs::open(&off(), &tcp_on(port), &off(), &rig.publisher);
    let mut clients = Vec::new();
    for _ in 0..8 {
        let client = TcpStream::connect(port).await.unwrap();
        // What it says is thrown away; and it is being served once something has come.
        client.try_write(b"$GPGGA,nonsense\r\n").unwrap();
        let mut byte = [0];
        let begun = Instant::now();
        let mut degrees = 10.0;
        while client.try_read(&mut byte).is_err() {
            publish(&rig, degrees);
            degrees += 1.0;
            assert!(begun.elapsed() < PATIENCE);
            tokio::time::sleep(Duration::from_millis(1)).await;
        }
        assert_eq!(&byte, b"$");
        clients.push(client);
    }
    // One too many.
    let mut refused = TcpStream::connect(port).await.unwrap();
    assert_eq!(refused.read(&mut [0]).await.unwrap_or(0), 0);
    let right = publish(&rig, 300.0);
    for client in &mut clients {
        let mut text = String::new();
        while !text.ends_with(&right) {
            let mut bytes = [0; 4096];
            let count = timeout(PATIENCE, client.read(&mut bytes)).await;
            let count = count.unwrap().unwrap();
            assert!(count > 0, "{text}");
            text += std::str::from_utf8(&bytes[..count]).unwrap();
        }
    }
    // One that closes its sending side is sent away, as is one of the socket.
    clients[0].shutdown().await.unwrap();
    let rest = timeout(PATIENCE, clients[0].read_to_end(&mut Vec::new())).await;
    rest.expect("it is served on").unwrap();
    outputs.shutdown().await;
    until("the port to close", || StdTcpStream::connect(port).is_err()).await;
}

#[tokio::test]
async fn a_port_has_the_newest_heading_alone_until_it_is_read() {
    let rig = rig(|_| {});
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("nmea");
    // What an earlier daemon left.
    symlink("/dev/pts/nowhere", &path).unwrap();
    let settings = pty::Settings { path: path.clone() };
    let mut outputs = outputs::open(&off(), &off(), &settings, &rig.publisher);
    // A second daemon goes without, and leaves the link.
    assert!(outputs::open(&off(), &off(), &settings, &rig.publisher).is_empty());
    let mut port = File::options().read(true).write(true).open(&path).unwrap();
    let unread = |port: &File, right: &str| ioctl_fionread(port).unwrap() == right.len() as u64;
    // Each is of another length.
    for degrees in [1.0, 20.0, 300.0] {
        let right = publish(&rig, degrees);
        until("a heading", || unread(&port, &right)).await;
    }
    let right = publish(&rig, 4.0 + 360.0);
    until("the newest", || unread(&port, &right)).await;
    let mut bytes = vec![0; right.len()];
    port.read_exact(&mut bytes).unwrap();
    assert_eq!(String::from_utf8(bytes).unwrap(), right);
    outputs.shutdown().await;
    assert!(fs::symlink_metadata(&path).is_err());
}

#[tokio::test]
async fn what_cannot_be_had_is_done_without_and_tcp_is_tried_again() {
    let rig = rig(|_| {});
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("file");
    symlink("/dev/null", &path).unwrap();
    let mut port = own_address();
    port.set_port(10111);
    let taken = TcpListener::bind(port).unwrap();
    let (receiver, udp) = receiver().await;
    let mut outputs = outputs::open(
        &udp,
        &tcp_on(port),
        &pty::Settings { path: path.clone() },
        &rig.publisher,
    );
    let right = publish(&rig, 1.0);
    assert_eq!(received(&receiver).await, right);
    drop(taken);
    until("TCP", || StdTcpStream::connect(port).is_ok()).await;
    outputs.shutdown().await;
    assert_eq!(fs::read_link(&path).unwrap(), Path::new("/dev/null"));
}

#[tokio::test]
async fn who_could_not_keep_up_goes_on_with_the_newest() {
    let rig = rig(|settings| settings.backlog = 8);
    let (receiver, udp) = receiver().await;
    let mut outputs = outputs::open(&udp, &off(), &off(), &rig.publisher);
    // Nobody takes any of these meanwhile.
    for degrees in 1..=20 {
        publish(&rig, f64::from(degrees));
    }
    let mut right = String::new();
    let mut bytes = [0; 1500];
    let mut count = 0;
    until("a datagram", || {
        right = publish(&rig, 30.0);
        count = receiver.try_recv(&mut bytes).unwrap_or(0);
        count > 0
    })
    .await;
    assert_eq!(str::from_utf8(&bytes[..count]).unwrap(), right);
    outputs.shutdown().await;
}

#[test]
fn an_address_has_numbers_and_a_port() {
    for (address, faults) in [
        ("", 0),
        ("127.0.0.1:10110", 0),
        ("255.255.255.255:10110", 0),
        ("[::1]:10110", 0),
        ("localhost:10110", 1),
        ("127.0.0.1", 1),
        ("127.0.0.1:0", 1),
        ("10110", 1),
    ] {
        assert_eq!(udp_to(address).check().len(), faults, "{address}");
        assert_eq!(tcp_on(address).check().len(), faults, "{address}");
    }
    for (path, faults) in [("", 0), ("/run/headingd/nmea", 0), ("nmea", 1)] {
        let path = PathBuf::from(path);
        assert_eq!(pty::Settings { path }.check().len(), faults);
    }
}
