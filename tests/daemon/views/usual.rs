//! The configuration that every command finds by itself.

use std::process::Command;

use crate::rig::{ENDLESS, FAST, Rig, finished, not_run, program};

/// The program, which finds this configuration.
fn usual(config: &str, arguments: &[&str]) -> Command {
    let mut command = program();
    command.env("HEADINGD_CONFIG", config).args(arguments);
    command
}

/// One file for the daemon and for all that talk to it; the variable stands for /etc/headingd/headingd.toml, which a test
/// may not write.
#[test]
fn every_command_finds_the_same_configuration() {
    let rig = Rig::new(FAST, ENDLESS);
    let config = rig.text("headingd.toml");
    let usual = |arguments: &[&str]| finished(&mut usual(&config, arguments));
    let _process = rig.spawn(&mut self::usual(&config, &["run"]));
    rig.client().heading();

    // The clients among them: what README shows (readme.rs).
    let (status, out, _) = usual(&["config", "check"]);
    assert_eq!(
        (status, out.as_str()),
        (0, format!("{config}: good\n").as_str())
    );
    let (_, out, _) = usual(&["config", "show"]);
    assert!(out.contains("scenario = \"endless\""), "{out}");
    let (status, _, err) = usual(&["check"]);
    assert_eq!(status, 78);
    assert!(
        err.contains(&format!(
            "{config}: source.kind is \"simulator\", but must be \"i2c\""
        )),
        "{err}"
    );
    // Another one may be named all the same.
    let (status, _, err) = usual(&["status", "--config", "/none.toml"]);
    assert_eq!(status, 66, "{err}");
}

/// Whoever names a file means that one: another daemon may be on the usual sockets.
#[test]
fn a_fault_in_the_file_that_the_variable_names_is_an_error() {
    let rig = Rig::new(FAST, "");
    std::fs::write(rig.path("headingd.toml"), "[source]\nspeed = 0\n").unwrap();
    let config = rig.text("headingd.toml");
    let usual = |arguments: &[&str]| finished(&mut usual(&config, arguments));
    for command in ["run", "status", "watch", "mounting", "calibration list"] {
        let arguments: Vec<_> = command.split(' ').collect();
        let (status, _, err) = usual(&arguments);
        assert_eq!(status, 78, "{command}: {err}");
        assert!(err.contains("speed is 0"), "{command}: {err}");
    }
    // A client that is told the socket needs no file.
    let page = rig.text("report.html");
    for more in [&["status"][..], &["report", "--out", &page]] {
        let socket = ["--socket", &rig.text("control.sock")];
        let (status, _, err) = usual(&[more, &socket].concat());
        assert_eq!(status, 69, "{err}");
        assert!(!err.contains("speed"), "{err}");
    }
}

/// In a mount namespace of its own, which needs no privileges, since it is the file of the system's daemon.
#[test]
fn after_a_fault_in_the_file_of_the_system_a_client_tries_the_usual_sockets() {
    let script = "mount -t tmpfs none /run && mount -t tmpfs none /etc && mkdir /etc/headingd || exit 99
                  printf '[source]\nspeed = 0\n' > /etc/headingd/headingd.toml && exec \"$0\" status";
    let mut command = Command::new("unshare");
    command.args(["--user", "--map-root-user", "--mount", "sh", "-c", script]);
    command.arg(env!("CARGO_BIN_EXE_headingd"));
    command.env_remove("HEADINGD_CONFIG");
    let (status, _, err) = finished(&mut command);
    if status == 99 || err.contains("unshare") {
        return not_run("the system allows no namespaces");
    }
    let tried = ["speed is 0", "trying the usual sockets", "/run/headingd/"];
    assert!(tried.iter().all(|part| err.contains(part)), "{err}");
    assert_eq!(status, 69, "{err}");
}

#[test]
fn a_command_whose_warning_cannot_be_written_does_its_work() {
    let rig = Rig::new(FAST, "");
    std::fs::write(rig.path("headingd.toml"), "").unwrap();
    let full = std::fs::File::options().write(true).open("/dev/full");
    let config = rig.text("headingd.toml");
    let (status, out, _) = finished(usual(&config, &["config", "check"]).stderr(full.unwrap()));
    assert_eq!(
        (status, out),
        (0, format!("{config}: good, once source.kind is set\n"))
    );
}
