//! `headingd calibration start --wait`.

use serde_json::Value;

use crate::rig::{ENDLESS, FAST, LONG, Rig, headingd, until};

fn start_and_wait(socket: &str) -> [&str; 5] {
    ["calibration", "start", "--wait", "--socket", socket]
}

#[test]
fn it_waits_for_the_verdict_on_a_turn() {
    let rig = Rig::new(FAST, LONG);
    let (_process, mut client) = rig.watched();
    // What was accepted before is not what it waits for.
    client.accepted();
    let socket = rig.text("control.sock");
    let wait = start_and_wait(&socket);
    let (status, out, err) = headingd(&wait);
    assert_eq!(status, 0, "{err}");
    assert!(
        out.starts_with("accepted (good): ") || out.starts_with("kept ("),
        "{out}"
    );
    assert!(err.contains("turn the board once"), "{err}");
    let (status, out, _) = headingd(&[&wait[..], &["--json"]].concat());
    assert_eq!(status, 0);
    let outcome: Value = serde_json::from_str(&out).unwrap();
    assert_eq!(
        (&outcome["class"], &outcome["method"]),
        (&"CALIBRATION".into(), &"turn".into())
    );
}

#[test]
fn motion_that_teaches_as_much_as_a_turn_ends_the_wait() {
    // What it turns before it has learnt enough is no full turn.
    let rig = Rig::new(
        FAST,
        &format!("{ENDLESS}turns = 0.5\n[turn]\nangle_deg = 720.0\n"),
    );
    let (_process, _client) = rig.watched();
    let (status, out, err) = headingd(&start_and_wait(&rig.text("control.sock")));
    assert_eq!(status, 0, "{err}");
    assert!(
        out.starts_with("accepted (good): learnt from motion"),
        "{out}"
    );
}

#[test]
fn a_refusal_has_its_status_its_reason_and_what_to_do() {
    let strict = format!("{LONG}[verdict]\nresidual_share = 0.001\n");
    let rig = Rig::new(FAST, &strict);
    let (_process, mut client) = rig.watched();
    client.find("STATE", |_| true);
    let socket = rig.text("control.sock");
    let wait = start_and_wait(&socket);
    let (status, out, err) = headingd(&wait);
    assert_eq!(status, 3, "{out}{err}");
    assert!(out.starts_with("rejected (residual): "), "{out}");
    assert!(
        out.contains("\nwhat to do: turn on the spot, away from iron"),
        "{out}"
    );
    // It says how far the turn is.
    assert!(err.contains(" % of a turn  "), "{err}");
    // Whoever looks later is told, too.
    until("the refusal in the status", || {
        let (_, shown, _) = headingd(&["status", "--socket", &socket]);
        shown.contains("\nlast         rejected (residual): ")
    });
}

#[test]
fn it_ends_when_somebody_else_cancels() {
    let rig = Rig::new(1.0, "[simulator]\nturn_deg_s = 1.0\nturns = 100\n");
    let (_process, mut client) = rig.watched();
    client.find("ATT", |_| true);
    let socket = rig.text("control.sock");
    let mut waiting = rig.run(&start_and_wait(&socket));
    waiting.says("turn the board once");
    let (status, _, err) = headingd(&["calibration", "cancel", "--socket", &socket]);
    assert_eq!(status, 0, "{err}");
    let said = waiting.ends(3);
    assert!(
        said.contains("the calibration was cancelled, or locked, by somebody else"),
        "{said}"
    );
}
