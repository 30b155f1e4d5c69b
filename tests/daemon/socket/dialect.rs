//! What is asked and what is answered.

use std::time::{Duration, Instant};

use headingd::condition::Condition;
use headingd::reading::Reading;
use headingd::recording::Header;
use serde_json::Value;
use tokio::io::AsyncWriteExt;

use super::rig::{heading, outcome, report, rig};

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

/// As OpenCPN asks, and Signal K's provider.
#[tokio::test]
async fn nmea_comes_alone_at_its_own_rate_and_beside_json() {
    let rig = rig(|_| {});
    let mut alone = rig.client().await;
    alone
        .send("?WATCH={\"class\":\"WATCH\", \"nmea\":true}")
        .await;
    assert_eq!(alone.next().await["class"], "DEVICES");
    let watch = alone.next().await;
    assert_eq!(
        (&watch["nmea"], &watch["json"]),
        (&true.into(), &false.into())
    );
    let mut both = rig
        .watcher("{\"nmea\":true,\"json\":true,\"rate_hz\":5}")
        .await;
    // A second of headings, 50 of them, then one without.
    let begun = Instant::now();
    for n in 0..50 {
        let taken = begun + Duration::from_millis(20 * n);
        rig.publisher.heading(heading(n + 1), taken, None);
    }
    let mut lost = heading(51);
    lost.condition = Condition::Stale;
    rig.publisher
        .heading(lost, begun + Duration::from_secs(1), None);
    for _ in 0..10 {
        for right in [
            "$HCHDM,123.5,M*2C\r\n",
            "$HCHDG,123.5,,,,*47\r\n",
            "$HCROT,-30.0,A*33\r\n",
            "$HCXDR,A,2.0,D,PTCH,A,-3.0,D,ROLL*7B\r\n",
        ] {
            assert_eq!(alone.raw_line().await, right);
        }
    }
    assert_eq!(alone.ask("?VERSION;").await["class"], "VERSION");
    for n in 0..5 {
        assert_eq!(both.next().await["seq"], 10 * n + 1);
        for _ in 0..4 {
            assert!(both.raw_line().await.starts_with("$HC"));
        }
    }
    assert_eq!(both.next().await["seq"], 51);
    assert_eq!(
        both.ask("?WATCH={\"enable\":false}").await["class"],
        "DEVICES"
    );
    assert_eq!(both.next().await["rate_hz"], 5.0);
}

#[tokio::test]
async fn a_device_tells_how_often_its_headings_come() {
    let rig = rig(|_| {});
    let mut client = rig.client().await;
    let device = client.ask("?DEVICE;").await;
    assert_eq!(
        (&device["subtype"], &device["bps"]),
        (&"hmc5843".into(), &0.into())
    );
    assert_eq!(device["cycle"], 1.0, "{device}");
    for seq in 1..=3 {
        rig.heading(seq);
    }
    assert_eq!(client.ask("?DEVICE;").await["cycle"], 0.02);
    // The source begins anew, and then again after an hour.
    for seq in [1, 2, 180_000, 180_001] {
        rig.heading(seq);
    }
    assert_eq!(
        client.ask("?DEVICES;").await["devices"][0]["mincycle"],
        0.02
    );
}

#[tokio::test]
async fn poll_gives_the_latest_heading_while_it_is_fresh() {
    let rig = rig(|_| {});
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

    rig.stale_heading(3);
    let poll = client.ask("?POLL;").await;
    assert_eq!(
        (&poll["active"], poll["att"].as_array().map(Vec::len)),
        (&0.into(), Some(0))
    );
}

#[tokio::test]
async fn a_stale_heading_is_sent_to_nobody() {
    let rig = rig(|_| {});
    let mut client = rig.watcher("{\"enable\":true}").await;
    rig.stale_heading(1);
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
async fn raw_readings_come_to_those_who_ask_until_they_ask_no_more() {
    let rig = rig(|_| {});
    rig.publisher.board(&Header::default());
    let reading = |t_s| Reading {
        t_s,
        field_mgauss: Some([Some(0.1), None, Some(-2.0)]),
        ..Reading::default()
    };
    let mut plain = rig.watcher("{\"enable\":true}").await;
    rig.publisher.reading(&reading(1.0));
    let mut client = rig
        .watcher("{\"enable\":true,\"json\":false,\"readings\":true}")
        .await;
    let board = client.next().await;
    assert_eq!(board["class"], "BOARD");
    let header = board["header"].as_str().unwrap();
    assert!(header.starts_with("# headingd-log 1\n") && header.ends_with("heading_deg\n"));
    rig.publisher.reading(&reading(2.0));
    let line = client.line().await.unwrap();
    let right = "{\"class\":\"READING\",\"seq\":2,\"t_s\":2.0,\"mx\":0.1,\"mz\":-2.0}\r\n";
    assert_eq!(line, right);

    let watch = client
        .ask("?WATCH={\"readings\":false,\"json\":false};")
        .await;
    assert_eq!(watch["class"], "DEVICES");
    assert_eq!(client.next().await["readings"], false);
    rig.publisher.reading(&reading(3.0));
    assert_eq!(client.ask("?VERSION;").await["class"], "VERSION");
    rig.heading(1);
    assert_eq!(plain.next().await["class"], "ATT");
}

/// Most reloads leave the board as it is.
#[tokio::test]
async fn a_board_is_announced_once_until_there_is_another() {
    let rig = rig(|_| {});
    let publish = |header: &Header, t_s| {
        rig.publisher.board(header);
        rig.publisher.reading(&Reading {
            t_s,
            ..Reading::default()
        });
    };
    let before = Header::default();
    rig.publisher.board(&before);
    let mut client = rig
        .watcher("{\"enable\":true,\"json\":false,\"readings\":true}")
        .await;
    assert_eq!(client.next().await["class"], "BOARD");
    publish(&before, 1.0);
    let reading = client.next().await;
    assert_eq!(
        (&reading["class"], &reading["t_s"]),
        (&"READING".into(), &1.0.into())
    );
    let after = Header {
        sensor: Some("another".to_owned()),
        ..before
    };
    publish(&after, 2.0);
    let board = client.next().await;
    assert_eq!(board["class"], "BOARD");
    assert!(
        board["header"]
            .as_str()
            .unwrap()
            .contains("sensor = another")
    );
    assert_eq!(client.next().await["t_s"], 2.0);
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
