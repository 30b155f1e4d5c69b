//! The service manager: told by systemd's protocol `sd_notify` how the daemon is.
//!
//! Without a manager (no `NOTIFY_SOCKET` in the environment) everything here does nothing.

pub mod sockets;

use std::env;
use std::io;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::process;
use std::time::{Duration, Instant};

use rustix::time::{ClockId, clock_gettime};

use crate::condition::Report;
use sockets::Sockets;

/// The status line changes no more often.
const STATUS_PACE: Duration = Duration::from_secs(1);

/// The daemon's connection to the service manager.
#[derive(Debug, Default)]
pub struct Service {
    /// What it has handed over.
    pub sockets: Sockets,
    manager: Option<ManagerSocket>,
    ready: bool,
    /// How often a sign of life is due, if the manager asks for any.
    pace: Option<Duration>,
    pinged: Option<Instant>,
    /// The newest status line that was sent, and the time of the latest comparison with the state.
    status: Option<(String, Instant)>,
}

impl Service {
    /// The manager that the environment names, if any: `NOTIFY_SOCKET`, `WATCHDOG_USEC` and `WATCHDOG_PID`
    /// as in sd_notify(3) and sd_watchdog_enabled(3), and the sockets that it has handed over. To be called once,
    /// before any thread is started.
    pub fn from_env() -> Self {
        Self {
            sockets: Sockets::from_env(),
            ..Self::manager_from_env()
        }
    }

    fn manager_from_env() -> Self {
        let Ok(name) = env::var("NOTIFY_SOCKET") else {
            return Self::default();
        };
        let of_another = env::var("WATCHDOG_PID").is_ok_and(|pid| pid != process::id().to_string());
        let watchdog = env::var("WATCHDOG_USEC")
            .ok()
            .filter(|_| !of_another)
            .and_then(|text| text.parse().ok())
            .filter(|&us| us > 0)
            .map(Duration::from_micros);
        match Self::at(&name, watchdog) {
            Ok(service) => service,
            Err(error) => {
                tracing::warn!(
                    "cannot tell the service manager anything on NOTIFY_SOCKET={name}: {error}"
                );
                Self::default()
            }
        }
    }

    /// A manager on this socket, a path or (after `@`) an abstract name, that wants a sign of life within
    /// every `watchdog`.
    fn at(name: &str, watchdog: Option<Duration>) -> io::Result<Self> {
        let address = match name.strip_prefix('@') {
            Some(name) => SocketAddr::from_abstract_name(name)?,
            None => SocketAddr::from_pathname(name)?,
        };
        let socket = UnixDatagram::unbound()?;
        // A manager that does not read must not delay the headings.
        socket.set_nonblocking(true)?;
        Ok(Self {
            manager: Some(ManagerSocket {
                socket,
                address,
                failing: false,
            }),
            pace: watchdog.map(|period| period / 2),
            ..Self::default()
        })
    }

    /// The daemon serves, and its source answers or is being waited for. Said once, and again after a reload.
    pub fn ready(&mut self) {
        if !self.ready {
            self.ready = self.say("READY=1");
        }
    }

    /// The configuration is being read again; [`Service::ready`] ends it.
    pub fn reloading(&mut self) {
        let now = clock_gettime(ClockId::Monotonic);
        let us = i128::from(now.tv_sec) * 1_000_000 + i128::from(now.tv_nsec) / 1000;
        self.say(&format!("RELOADING=1\nMONOTONIC_USEC={us}"));
        self.ready = false;
    }

    pub fn stopping(&mut self) {
        self.say("STOPPING=1\nSTATUS=stopping");
    }

    /// The daemon cannot start or go on, and this is why.
    pub fn failed(message: &str) {
        Self::manager_from_env().say(&status(message));
    }

    /// Says what is due: that the daemon is alive, if it is, and what the status line is now.
    pub fn tick(
        &mut self,
        now: Instant,
        alive: bool,
        report: Option<&Report>,
        heading_deg: Option<f64>,
    ) {
        if self.manager.is_none() {
            return;
        }
        let overdue = |last: Option<Instant>, pace| last.is_none_or(|last| now >= last + pace);
        if alive && self.pace.is_some_and(|pace| overdue(self.pinged, pace)) {
            self.ping(now);
        }
        let compared = self.status.as_ref().map(|(_, compared)| *compared);
        let Some(report) = report.filter(|_| overdue(compared, STATUS_PACE)) else {
            return;
        };
        let mut line = format!(
            "{} ({}): {}",
            report.condition.word(),
            report.reason,
            report.message
        );
        if let Some(deg) = heading_deg.filter(|_| report.condition.may_steer()) {
            // In whole degrees, so that a board at rest is no news.
            line += &format!("; heading {} degrees", deg.round() as u16 % 360);
        }
        let line = status(&line);
        let is_sent = self.status.as_ref().is_some_and(|(sent, _)| *sent == line);
        if is_sent || self.say(&line) {
            self.status = Some((line, now));
        }
    }

    /// Says that the daemon is alive, whether that is due or not, if the manager asks for it.
    pub fn ping(&mut self, now: Instant) {
        if self.pace.is_some() && self.say("WATCHDOG=1") {
            self.pinged = Some(now);
        }
    }

    fn say(&mut self, message: &str) -> bool {
        self.manager
            .as_mut()
            .is_none_or(|manager| manager.say(message))
    }
}

/// A status is one line: a second would be another assignment.
fn status(text: &str) -> String {
    format!("STATUS={}", text.trim().replace('\n', "; "))
}

#[derive(Debug)]
struct ManagerSocket {
    socket: UnixDatagram,
    address: SocketAddr,
    failing: bool,
}

impl ManagerSocket {
    /// Whether the manager took it. That it does not is logged once.
    fn say(&mut self, message: &str) -> bool {
        let sent = self.socket.send_to_addr(message.as_bytes(), &self.address);
        if let Err(error) = &sent
            && !self.failing
        {
            tracing::warn!("the service manager does not take {message:?}: {error}");
        }
        self.failing = sent.is_err();
        sent.is_ok()
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::condition::Condition;

    /// A manager whose watchdog waits for so long, and the daemon's connection to it.
    pub(crate) fn manager(
        watchdog: Option<Duration>,
    ) -> (tempfile::TempDir, UnixDatagram, Service) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("notify");
        let manager = UnixDatagram::bind(&path).unwrap();
        manager.set_nonblocking(true).unwrap();
        let service = Service::at(path.to_str().unwrap(), watchdog).unwrap();
        (folder, manager, service)
    }

    /// What the manager hears next.
    pub(crate) fn heard(manager: &UnixDatagram) -> Option<String> {
        let mut bytes = [0; 4096];
        let count = manager.recv(&mut bytes).ok()?;
        Some(String::from_utf8(bytes[..count].to_vec()).unwrap())
    }

    fn report(condition: Condition, reason: &'static str) -> Report {
        Report {
            condition,
            reason,
            message: "so it is".into(),
            progress: None,
            t_s: 0.0,
        }
    }

    #[test]
    fn ready_is_said_once_and_again_after_a_reload() {
        let (_folder, manager, mut service) = manager(None);
        service.ready();
        service.ready();
        assert_eq!(heard(&manager).as_deref(), Some("READY=1"));
        assert_eq!(heard(&manager), None);
        let before = clock_gettime(ClockId::Monotonic).tv_sec;
        service.reloading();
        let reloading = heard(&manager).unwrap();
        let us = reloading.strip_prefix("RELOADING=1\nMONOTONIC_USEC=");
        let s: i64 = us.unwrap().parse::<i64>().unwrap() / 1_000_000;
        assert!((before..before + 30).contains(&s), "{reloading}");
        service.ready();
        assert_eq!(heard(&manager).as_deref(), Some("READY=1"));
    }

    #[test]
    fn an_abstract_name_does_as_well() {
        let name = format!("headingd-test-{}", process::id());
        let address = SocketAddr::from_abstract_name(&name).unwrap();
        let manager = UnixDatagram::bind_addr(&address).unwrap();
        manager.set_nonblocking(true).unwrap();
        let mut service = Service::at(&format!("@{name}"), None).unwrap();
        service.stopping();
        assert!(heard(&manager).unwrap().starts_with("STOPPING=1\n"));
    }

    #[test]
    fn signs_of_life_come_at_half_the_time_and_only_from_the_living() {
        let (_folder, manager, mut service) = manager(Some(Duration::from_secs(8)));
        let begun = Instant::now();
        let mut fed = Vec::new();
        for s in 0..20 {
            service.tick(begun + Duration::from_secs(s), s != 8 && s != 9, None, None);
            if let Some(said) = heard(&manager) {
                assert_eq!(said, "WATCHDOG=1");
                fed.push(s);
            }
        }
        assert_eq!(fed, [0, 4, 10, 14, 18]);
    }

    #[test]
    fn the_status_changes_at_most_once_a_second_and_the_last_word_is_told() {
        let (_folder, manager, mut service) = manager(None);
        let begun = Instant::now();
        let mut told = Vec::new();
        for (ms, condition, heading_deg) in [
            (0, Condition::Good, Some(359.7)),
            (300, Condition::Good, Some(1.2)),
            (600, Condition::Disturbed, Some(2.0)),
            (900, Condition::Good, Some(12.0)),
            (1000, Condition::Good, Some(12.4)),
            (5000, Condition::Good, Some(11.6)),
            (6000, Condition::Fault, Some(11.6)),
        ] {
            let report = report(condition, "x");
            let now = begun + Duration::from_millis(ms);
            service.tick(now, true, Some(&report), heading_deg);
            told.extend(heard(&manager));
        }
        assert_eq!(
            told,
            [
                "STATUS=good (x): so it is; heading 0 degrees",
                "STATUS=good (x): so it is; heading 12 degrees",
                "STATUS=fault (x): so it is",
            ]
        );
    }
}
