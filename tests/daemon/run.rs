//! `headingd run`.

use std::fs;
use std::path::Path;

use headingd::sensor::simulator::{Settings, Simulator};
use serde_json::Value;

use crate::rig::{FAST, LONG, Rig, apart_deg, finished, log, long, until};

/// The way from the truth to the heading of an `ATT`, degrees.
fn error_deg(att: &Value, settings: &Settings) -> f64 {
    let t_s = att["t_s"].as_f64().unwrap();
    let truth = Simulator::new(settings.clone())
        .find(|entry| (entry.reading.t_s - t_s).abs() < 1e-6 && entry.heading_truth_deg.is_some());
    let truth_deg = truth.unwrap().heading_truth_deg.unwrap();
    let heading_deg = att["mheading"].as_f64().unwrap();
    apart_deg(heading_deg, truth_deg)
}

fn has_heading(att: &Value) -> bool {
    att.get("mheading").is_some()
}

fn is_accepted(message: &Value) -> bool {
    message["class"] == "CALIBRATION" && message["verdict"] == "accepted"
}

#[test]
fn it_calibrates_keeps_the_calibration_and_has_it_at_the_next_start() {
    let rig = Rig::new(FAST, LONG);
    let settings = long();
    let (mut process, mut client) = rig.watched();
    let att = client.find("ATT", |_| true);
    assert!(!has_heading(&att), "{att}");
    let outcome = client.find("CALIBRATION", |_| true);
    assert_eq!(outcome["verdict"], "accepted", "{outcome}");
    assert!(outcome["elapsed_us"].is_u64());
    // A test that has to wait sees more than one: the simulated board turns on.
    let mut accepted = 1;
    let mut headings = 0;
    while headings < 40 {
        let message = client.next().unwrap();
        accepted += usize::from(is_accepted(&message));
        if message["class"] == "ATT" && has_heading(&message) {
            assert!(["degraded", "good"].contains(&message["cal_state"].as_str().unwrap()));
            assert!(error_deg(&message, &settings).abs() < 2.0, "{message}");
            headings += 1;
        }
    }
    let file = rig.path("store/calibration.json");
    until("the calibration to be kept", || file.exists());

    let said = process.stop();
    assert!(!rig.path("heading.sock").exists());
    while let Some(message) = client.next() {
        accepted += usize::from(is_accepted(&message));
    }
    assert!(!said.contains("ERROR"), "{said}");
    let logged = said.matches("calibration accepted").count();
    assert_eq!(logged, accepted, "{said}");

    // At real time: one turn would take longer than this test.
    rig.configure(1.0, &rig.path("store"), LONG);
    let (mut process, mut client) = rig.watched();
    let att = client.find("ATT", |_| true);
    assert!(has_heading(&att), "{att}");
    assert!(error_deg(&att, &settings).abs() < 5.0, "{att}");
    process.signal("INT");
    process.ends(0);
    assert!(!rig.path("heading.sock").exists());
}

#[test]
fn at_real_time_headings_go_on_and_a_simulation_ends_the_daemon() {
    // A turn a second, so that the whole takes less than ten.
    let quick = "[simulator]\nturns = 1\nturn_deg_s = 360\n";
    let rig = Rig::new(1.0, quick);
    let (mut process, mut client) = rig.watched();
    let mut seqs = Vec::new();
    let mut accepted = 0;
    while let Some(message) = client.next() {
        if message["class"] == "ATT" {
            seqs.push(message["seq"].as_u64().unwrap());
            // Invented as they are, they are of this moment, and some clients ask when that is.
            assert!(message["time"].is_string(), "{message}");
        }
        accepted += u32::from(message["verdict"] == "accepted");
    }
    // A machine that is busy may delay some too long.
    assert!(!seqs.is_empty() && seqs.is_sorted_by(|a, b| a < b));
    let said = process.ends(0);
    assert_eq!(accepted, 1, "{said}");
    assert!(said.contains("the source is at its end"));
    assert!(!rig.path("heading.sock").exists());
}

#[test]
fn a_calibration_at_the_very_end_of_a_log_is_published_and_kept() {
    let rig = Rig::new(10.0, "");
    let whole = rig.path("whole.csv");
    let simulator = Simulator::new(Settings::default());
    let header = simulator.header();
    // The first turn is complete at about 10.04 s.
    let first_turn = simulator.take_while(|entry| entry.reading.t_s <= 10.1);
    let text = String::from_utf8(log(&header, first_turn)).unwrap();
    let spoilt = text.replacen("\n1.003,", "\nhello,", 1);
    assert_ne!(spoilt, text);
    fs::write(&whole, spoilt).unwrap();
    rig.replay(10.0, &whole);
    let (mut process, mut client) = rig.watched();
    let devices = client.find("DEVICES", |_| true);
    assert_eq!(devices["devices"][0]["path"], whole.to_str().unwrap());
    let outcome = client.find("CALIBRATION", |_| true);
    assert_eq!(outcome["verdict"], "accepted", "{outcome}");
    while client.next().is_some() {}
    let said = process.ends(0);
    assert!(rig.path("store/calibration.json").exists());
    assert!(said.contains("skipping rows that cannot be used; the first: log "));
    assert!(said.contains("1 row skipped; the first: log "), "{said}");
}

#[test]
fn a_second_daemon_is_refused_and_the_first_goes_on() {
    let rig = Rig::new(1.0, LONG);
    let (first, mut client) = rig.watched();
    let mut second = rig.start();
    let said = second.ends(69);
    let right = format!(
        "another daemon is serving there (process {}); stop it, or set another socket in [socket] or [control]",
        first.id()
    );
    assert!(said.contains(&right), "{said}");
    client.find("ATT", |_| true);
    assert!(rig.path("heading.sock").exists());
}

#[test]
fn a_calibration_of_another_sensor_is_not_used_and_stays() {
    let rig = Rig::new(1.0, LONG);
    let example = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/store-1.json");
    let good = fs::read_to_string(example).unwrap();
    let other = good.replacen("hmc5843", "qmc5883l", 1);
    assert_ne!(good, other);
    fs::create_dir(rig.path("store")).unwrap();
    fs::write(rig.path("store/calibration.json"), &other).unwrap();
    let (mut process, mut client) = rig.watched();
    assert!(!has_heading(&client.find("ATT", |_| true)));
    let said = process.stop();
    assert!(said.contains("it is of qmc5883l mounted"), "{said}");
    let kept = fs::read_to_string(rig.path("store/calibration.json")).unwrap();
    assert_eq!(kept, other);
}

#[test]
fn a_start_that_cannot_be_says_why() {
    let rig = Rig::new(1.0, "");
    for (more, status, sentence) in [
        (
            "speeed = 1\nlgo = \"a\"\n",
            78,
            "unknown key; did you mean speed?",
        ),
        (
            "kind = \"replay\"\nlog = \"/none/a.csv\"\n",
            66,
            "cannot open log /none/a.csv: there is no such file",
        ),
        (
            "kind = \"replay\"\nlog = \"/dev/null\"\n",
            65,
            "log /dev/null has no reading",
        ),
    ] {
        rig.configure(1.0, &rig.path("store"), more);
        let mut process = rig.start();
        let said = process.ends(status);
        assert!(said.contains(sentence), "{said}");
        // Each of several faults too.
        let whose = |line: &str| line.starts_with("headingd: ");
        assert!(said.lines().all(whose), "{said}");
        assert!(!rig.path("heading.sock").exists());
    }
    fs::remove_file(rig.path("headingd.toml")).unwrap();
    assert_eq!(rig.start().wait().code(), Some(66));
}

#[test]
fn a_log_of_which_most_is_skipped_is_a_failure_as_for_replay() {
    let rig = Rig::new(1000.0, "");
    let log = rig.path("log.csv");
    let rows = "hello\n".repeat(10);
    fs::write(
        &log,
        format!("# headingd-log 1\nt_s,mx,my,mz\n0,1,2,3\n{rows}0.02,1,2,3\n"),
    )
    .unwrap();
    rig.replay(1000.0, &log);
    let mut run = rig.start();
    let said = run.ends(65);
    let summary = "most of the log cannot be used: 10 rows skipped; the first: log ";
    assert_eq!(said.matches(summary).count(), 1, "{said}");
    assert!(!rig.path("heading.sock").exists());

    let record = ["record", "--out", &rig.text("out.csv")];
    let (status, _, said) = finished(&mut rig.command(&record));
    assert_eq!(status, 65, "{said}");
    assert!(said.contains(summary), "{said}");
}

#[test]
fn a_client_that_falls_behind_is_let_go_and_the_log_says_how_far() {
    let rig = Rig::new(FAST, LONG);
    rig.edit("[socket]\n", "[socket]\nwrite_timeout_s = 0.1\n");
    let (process, _sleeper) = rig.watched();
    process.says(" messages behind, and in 100ms has not read enough of them");
    let said = process.said();
    assert!(!said.contains("it is 0 messages"), "{said}");
}

/// The system would wait for ever for somebody to write to it.
#[test]
fn a_pipe_is_no_configuration_and_without_an_end_no_log() {
    let rig = Rig::new(1.0, "");
    let (pipe, other) = (rig.pipe("pipe"), rig.pipe("other"));
    let name = pipe.to_str().unwrap();
    for arguments in [
        &["run", "--config", name][..],
        &["config", "check", name],
        &["status", "--config", name],
    ] {
        let mut process = rig.run(arguments);
        let said = process.ends(66);
        assert!(said.contains("it is no regular file"), "{said}");
    }

    rig.replay(1.0, &pipe);
    for verb in ["check", "show"] {
        let (status, _, said) = finished(&mut rig.command(&["config", verb]));
        assert_eq!(status, 0, "{said}");
    }
    let replay = |pipe: &Path| rig.run(&["replay", pipe.to_str().unwrap()]);
    for mut process in [rig.start(), replay(&other)] {
        let said = process.ends(66);
        assert!(said.contains("nobody has opened for writing"), "{said}");
    }

    let mut process = replay(&pipe);
    fs::write(&pipe, "# headingd-log 1\nt_s,mx,my,mz\n0,1,2,3\n").unwrap();
    process.ends(0);
}

/// A year lies between its two parts, and one row is from another century.
#[test]
fn nobody_waits_for_a_time_that_jumps() {
    let rig = Rig::new(10.0, "");
    let path = rig.path("log.csv");
    let settings = Settings {
        turns: 1.0,
        ..Settings::default()
    };
    let simulated = || Simulator::new(settings.clone());
    let mut entries = Vec::new();
    for later_s in [0.0, 31_536_000.0] {
        for (count, mut entry) in simulated().enumerate() {
            entry.reading.t_s += later_s;
            entries.push(entry);
            if count == 100 {
                entry.reading.t_s = 9e9;
                entries.push(entry);
            }
        }
    }
    fs::write(&path, log(&simulated().header(), entries)).unwrap();
    rig.replay(10.0, &path);
    let (mut process, mut client) = rig.watched();
    let mut last_s: f64 = 0.0;
    while let Some(message) = client.next() {
        if message["class"] == "ATT" {
            last_s = message["t_s"].as_f64().unwrap();
        }
    }
    let said = process.ends(0);
    assert!((31_536_000.0..8e9).contains(&last_s), "{last_s}");
    assert!(said.contains("a new stretch of the log begins"), "{said}");
    assert!(said.contains("2 rows skipped"), "{said}");
}

/// Commands for the second would change the first.
#[test]
fn two_daemons_in_one_folder_need_two_control_sockets() {
    let rig = Rig::new(1.0, LONG);
    let first = rig.start();
    rig.connect("control.sock");
    let text = fs::read_to_string(rig.path("headingd.toml")).unwrap();
    let other = text
        .replace("heading.sock", "other.sock")
        .replace(&rig.text("store"), &rig.text("other"));
    fs::write(rig.path("other.toml"), &other).unwrap();
    let config = rig.text("other.toml");
    let run = || crate::rig::start(&rig.path("other"), &["run", "--config", &config]);
    fs::create_dir(rig.path("other")).unwrap();
    let said = run().ends(69);
    let process = format!("(process {})", first.id());
    for part in [rig.text("control.sock"), process] {
        assert!(said.contains(&part), "{said}");
    }
    let own = format!("{other}[control]\nsocket = {:?}\n", rig.text("c.sock"));
    fs::write(rig.path("other.toml"), own).unwrap();
    let mut second = run();
    rig.connect("c.sock");
    second.stop();
}

#[test]
fn two_daemons_never_share_a_store_and_the_second_says_who_has_it() {
    let rig = Rig::new(1.0, LONG);
    let (mut first, mut client) = rig.watched();
    client.find("ATT", |_| true);
    let other = Rig::new(1.0, LONG);
    other.configure(1.0, &rig.path("store"), LONG);
    let mut second = other.start();
    let said = second.ends(69);
    assert!(
        said.contains("another daemon keeps its own there"),
        "{said}"
    );
    assert!(
        said.contains(&format!("(process {})", first.id())),
        "{said}"
    );
    assert!(!other.path("heading.sock").exists());

    // Nor does one that gets there by a reload, which goes on as before.
    other.configure(1.0, &other.path("store"), LONG);
    let (mut second, mut other_client) = other.watched();
    other_client.find("ATT", |_| true);
    let silent = format!("{LONG}[log]\nfilter = \"off\"\n");
    other.configure(1.0, &rig.path("store"), &silent);
    second.signal("HUP");
    // Nor does it take the filter of the log.
    second.says("not reloaded");
    let seq = other_client.find("ATT", |_| true)["seq"].as_u64();
    other_client.find("ATT", |att| att["seq"].as_u64() > seq);

    // A reload opens its own store again, and a process that is killed leaves it to the next.
    rig.configure(2.0, &rig.path("store"), LONG);
    first.signal("HUP");
    first.says("reloaded: source.speed");
    client.find("ATT", |_| true);
    assert!(!first.said().contains("ERROR"), "{}", first.said());
    first.signal("KILL");
    first.wait();
    other.configure(1.0, &rig.path("store"), LONG);
    second.signal("HUP");
    let lock = rig.path("store/.lock");
    until("its lock", || {
        fs::read_to_string(&lock).is_ok_and(|text| text == format!("{}\n", second.id()))
    });
    // The lock comes first; only a daemon that has done with the reload leaves nothing behind.
    second.says("reloaded: store.");
    second.stop();
    assert!(!lock.exists());
}
