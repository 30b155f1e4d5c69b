//! True headings of a daemon that asks a gpsd where it is.

use std::io::{BufRead, BufReader, Write};
use std::net::{TcpListener, TcpStream};
use std::os::unix::net::UnixListener;

use serde_json::Value;

use crate::control::link::Link;
use crate::rig::{Client, FAST, LONG, Rig, apart_deg};

/// What a gpsd says first, then what is not to be used, and a position at last.
fn greet(stream: &mut TcpStream, position: &str) {
    let mut request = String::new();
    BufReader::new(stream.try_clone().unwrap())
        .read_line(&mut request)
        .unwrap();
    assert!(
        request.starts_with("?WATCH={\"enable\":true,\"json\":true}"),
        "{request}"
    );
    let endless = "x".repeat(100_000);
    let text = format!(
        "{{\"class\":\"VERSION\",\"release\":\"3.25\"}}\r\n{{\"class\":\"SKY\",\"satellites\":[]}}\r\n\
         {{\"class\":\"TPV\",\"mode\":3,\"lat\":80,\"lon\":0,\"more\":\"{endless}\"}}\r\nnonsense\r\n\
         {{\"class\":\"TPV\",\"mode\":1,\"lat\":80,\"lon\":0}}\r\n\
         {{\"class\":\"TPV\",\"device\":\"/dev/ttyACM0\",\"mode\":3,\"time\":\"2026-11-22T14:00:00.000Z\",{position}}}\r\n"
    );
    stream.write_all(text.as_bytes()).unwrap();
}

/// The next heading that is so far, in degrees, from magnetic north.
fn declined(client: &mut Client, wanted: impl Fn(f64) -> bool) -> Value {
    client.find("ATT", |att| {
        let of = |key: &str| att[key].as_f64();
        let (Some(heading), Some(mheading)) = (of("heading"), of("mheading")) else {
            return false;
        };
        wanted(apart_deg(heading, mheading))
    })
}

#[test]
fn a_gpsd_says_where_true_north_is_and_may_come_and_go() {
    let gpsd = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = gpsd.local_addr().unwrap();
    let more = |north: &str| format!("{LONG}[true_north]\ngpsd = \"{address}\"\n{north}");
    let rig = Rig::new(FAST, &more(""));
    let (mut process, mut client) = rig.watched();
    client.find("ATT", |att| {
        assert_eq!(att.get("heading"), None, "{att}");
        att.get("mheading").is_some()
    });
    let (mut stream, _) = gpsd.accept().unwrap();
    process.says(": waiting for a position");
    greet(&mut stream, "\"lat\":51.08,\"lon\":-114.13,\"altHAE\":1100");
    // Calgary: 13.3° east.
    declined(&mut client, |degrees| (degrees - 13.3).abs() < 0.3);
    let status = Link::new(&rig).told("status");
    let dip_deg = status["reference"]["dip_deg"].as_f64().unwrap();
    assert!((dip_deg - 73.0).abs() < 1.0, "{status}");
    // The vehicle moves to London, where magnetic north is nearly true.
    writeln!(
        stream,
        "{{\"class\":\"TPV\",\"mode\":2,\"lat\":51.5,\"lon\":-0.1}}"
    )
    .unwrap();
    declined(&mut client, |degrees| (0.2..3.0).contains(&degrees));
    // The gpsd goes: what it said last stays, and it is asked again.
    drop(stream);
    process.says("its last position stays in use: it has closed the connection");
    declined(&mut client, |degrees| (0.2..3.0).contains(&degrees));
    let (mut stream, _) = gpsd.accept().unwrap();
    greet(&mut stream, "\"lat\":-33.9,\"lon\":151.2");
    declined(&mut client, |degrees| (degrees - 12.8).abs() < 1.0);

    // A reload that needs a new pipeline goes on from the last position.
    let store = rig.path("store");
    rig.configure(FAST, &store, &more("[turn]\nangle_deg = 350\n"));
    process.signal("HUP");
    process.says("reloaded: turn.angle_deg");
    let last = declined(&mut rig.client(), |degrees| (degrees - 12.8).abs() < 1.0);
    let status = Link::new(&rig).told("status");
    assert!(
        status["reference"]["dip_deg"].as_f64() < Some(-60.0),
        "{status}"
    );

    // A declination by hand needs no new pipeline: the headings are counted on.
    let by_hand = "declination_deg = -20\n[turn]\nangle_deg = 350\n";
    rig.configure(FAST, &store, &more(by_hand));
    process.signal("HUP");
    let by_hand = declined(&mut client, |degrees| (degrees + 20.0).abs() < 0.1);
    assert!(
        by_hand["seq"].as_u64() > last["seq"].as_u64(),
        "{last} {by_hand}"
    );
    // Without it, the place is still the one that the gpsd gave last, though it gives none now.
    rig.configure(FAST, &store, &more("[turn]\nangle_deg = 350\n"));
    process.signal("HUP");
    declined(&mut client, |degrees| (degrees - 12.8).abs() < 1.0);
    process.stop();
}

#[test]
fn a_gpsd_on_a_unix_socket_that_is_not_there_yet_costs_one_line_in_the_log() {
    let rig = Rig::new(FAST, "");
    let place = rig.path("gpsd.sock");
    let north = "latitude_deg = 51.08\nlongitude_deg = -114.13\n";
    let more = format!("{LONG}[true_north]\ngpsd = {place:?}\n{north}");
    rig.configure(FAST, &rig.path("store"), &more);
    let (mut process, mut client) = rig.watched();
    // Until it comes, the compass is where the configuration says.
    declined(&mut client, |degrees| (degrees - 13.3).abs() < 0.3);
    process.says("no position from the gpsd at");
    let gpsd = UnixListener::bind(&place).unwrap();
    let (mut stream, _) = gpsd.accept().unwrap();
    writeln!(
        stream,
        "{{\"class\":\"TPV\",\"mode\":2,\"lat\":51.5,\"lon\":-0.1}}"
    )
    .unwrap();
    declined(&mut client, |degrees| (0.2..3.0).contains(&degrees));
    let told = process.said().matches("no position from the gpsd").count();
    assert_eq!(told, 1);
    process.stop();
}
