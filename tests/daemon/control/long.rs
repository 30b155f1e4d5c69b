//! Calibrations that would take minutes: whoever waits for their end waits no longer than a moment.

use super::link::Link;
use crate::rig::{LONG, Process, Rig};

/// The paper's swarm looks at every sample for each particle.
const SWARM: &str = "profile = \"paper\"\nparticles = 1000\nmax_iterations = 100000\nstop = \"basic\"\nwindow = \"all\"\n";

/// A daemon whose calibration of a turn is under way, for longer than any test waits.
fn calibrating(rig: &Rig) -> (Process, Link) {
    // Not faster than in real time, or the readings would wait for the calibration.
    let board = "turn_deg_s = 180\nmag_rate_hz = 500\n";
    let more = format!("{LONG}{board}[calibration]\n{SWARM}");
    rig.configure(1.0, &rig.path("store"), &more);
    let process = rig.start();
    let mut link = Link::new(rig);
    link.status("a calibration", |status| status["calibrating"] == true);
    (process, link)
}

#[test]
fn one_that_is_cancelled_ends_at_once_and_the_next_turn_is_calibrated_on() {
    let rig = Rig::new(1.0, "");
    let (_process, mut link) = calibrating(&rig);
    let mut client = rig.client();
    link.told("cancel");
    client.find("CALIBRATION", |outcome| outcome["reason"] == "cancelled");
    link.status("the next", |status| status["calibrating"] == true);
}

#[test]
fn a_reload_gives_up_one_that_takes_long() {
    let rig = Rig::new(1.0, "");
    let (mut process, mut link) = calibrating(&rig);
    rig.edit(SWARM, "");
    process.signal("HUP");
    process.says("takes too long, and is given up");
    process.says("reloaded: calibration.");
    link.status("a turn", |status| status["last"]["reason"] != "cancelled");
    process.stop();
}
