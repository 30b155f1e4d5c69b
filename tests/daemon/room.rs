//! A disk that is nearly full of the daemon's own logs: there is room for the store.
//!
//! The disk is small and in memory, and belongs to a mount namespace of the daemon's own, which needs no privileges.

use std::fs::{self, File};
use std::os::fd::AsRawFd;
use std::path::PathBuf;
use std::process::Command;

use rustix::fs::fstatvfs;
use serde_json::json;

use crate::control::link::Link;
use crate::rig::{FAST, LONG, Process, Rig, not_run};

/// Runs what follows where a small disk is mounted on $0.
const ON_A_SMALL_DISK: [&str; 7] = [
    "unshare",
    "--user",
    "--map-root-user",
    "--mount",
    "sh",
    "-c",
    "mount -t tmpfs -o size=256k none \"$0\" && exec \"$@\"",
];

/// A daemon with store and ring on a small disk, and what it sees there. `None` where the system allows no namespaces.
struct Small {
    rig: Rig,
    process: Process,
}

impl Small {
    fn start() -> Option<Self> {
        let rig = Rig::new(FAST, "");
        let disk = rig.path("disk");
        fs::create_dir(&disk).unwrap();
        let ring = disk.join("ring");
        let more = format!("{LONG}[record]\ndirectory = {ring:?}\nfile_mib = 1\n");
        rig.configure(FAST, &disk.join("store"), &more);
        let on_it = |arguments: &[&str]| {
            let mut command = Command::new(ON_A_SMALL_DISK[0]);
            command
                .args(&ON_A_SMALL_DISK[1..])
                .arg(&disk)
                .args(arguments);
            command
        };
        if !on_it(&["true"])
            .status()
            .is_ok_and(|status| status.success())
        {
            not_run("the system allows no namespaces");
            return None;
        }
        let (program, config) = (env!("CARGO_BIN_EXE_headingd"), rig.text("headingd.toml"));
        let process = rig.spawn(&mut on_it(&[program, "run", "--config", &config]));
        Some(Self { rig, process })
    }

    /// The path of what the daemon has there.
    fn path(&self, name: &str) -> PathBuf {
        let root = PathBuf::from(format!("/proc/{}/root", self.process.id()));
        let inside = self.rig.path("disk").join(name);
        root.join(inside.strip_prefix("/").unwrap())
    }
}

#[test]
fn a_ring_leaves_room_on_its_disk_for_the_store() {
    let Some(mut small) = Small::start() else {
        return;
    };
    small.process.says("the disk is nearly full");
    // The folder is open: what is mounted there goes with the daemon.
    let store = File::open(small.path("store")).unwrap();
    let disk = fstatvfs(&store).unwrap();
    assert!(disk.f_bavail < disk.f_blocks / 8);
    Link::new(&small.rig).ask(&json!({"request": "lock"}));
    small.process.stop();
    let store = PathBuf::from(format!("/proc/self/fd/{}", store.as_raw_fd()));
    let kept = fs::read_to_string(store.join("calibration.json"));
    assert!(kept.unwrap().contains("\"locked\""));
}
