//! The bridge over a pseudo-terminal: started, unplugged, plugged in elsewhere, and all that may come instead
//! of readings.

use std::collections::BTreeSet;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use headingd::frame::Mountings;
use headingd::reading::Reading;
use headingd::sensor::SourceEvent;
use headingd::sensor::serial::Bridge;
use headingd::sensor::serial::settings::{Protocol, Settings};
use tokio::runtime::{Builder, Runtime};
use tokio::time::timeout;

use super::device::{Counts, Device, Firmware, Habits};
use super::quiet::until_quiet;
use crate::effort::slow;
use crate::rig::{PATIENCE, folder};

const COUNTS: Counts = [[1, -2, 256], [130, -13, 650], [14, 0, -14]];

/// At rest, with some noise: numbers that stood still would be those of a sensor that is not read.
fn razor() -> Firmware {
    let mut noise = 0;
    Firmware::Razor(Box::new(move |_| {
        noise = 1 - noise;
        COUNTS.map(|[x, y, z]| [x + noise, y, z])
    }))
}

struct Rig {
    folder: tempfile::TempDir,
    bridge: Bridge,
    runtime: Runtime,
}

impl Rig {
    fn new(protocol: Protocol) -> Self {
        let folder = folder();
        let settings = Settings {
            port: folder.path().join("tty"),
            protocol,
            ..Settings::default()
        };
        Self {
            folder,
            bridge: Bridge::new(&settings, Mountings::default()),
            runtime: Builder::new_current_thread().enable_all().build().unwrap(),
        }
    }

    fn link(&self) -> PathBuf {
        self.folder.path().join("tty")
    }

    fn plug(&self, firmware: Firmware) -> Device {
        Device::plug(&self.link(), firmware, Habits::default())
    }

    fn next(&mut self) -> SourceEvent {
        self.next_within(PATIENCE).expect("waited in vain")
    }

    /// The next thing said, if it is within this time.
    fn next_within(&mut self, patience: Duration) -> Option<SourceEvent> {
        let stop = AtomicBool::new(false);
        let next = async { timeout(patience, self.bridge.next(&stop)).await };
        let heard = self.runtime.block_on(next).ok()?;
        Some(heard.expect("nobody told it to stop"))
    }

    fn trouble(&mut self) -> (&'static str, String) {
        let begun = Instant::now();
        loop {
            if let SourceEvent::Fault(Some(trouble)) = self.next() {
                return (trouble.code, trouble.message);
            }
            assert!(begun.elapsed() < PATIENCE, "waited in vain for trouble");
        }
    }

    /// This many readings, between which nothing is said but that there were none for a while: on a busy machine the
    /// board may stand still.
    fn readings(&mut self, count: usize) -> Vec<(Reading, Instant)> {
        let mut readings = Vec::new();
        while readings.len() < count {
            match self.next() {
                SourceEvent::Reading(reading, taken) => readings.push((reading, taken)),
                SourceEvent::Fault(Some(trouble)) if trouble.code == "silent" => readings.clear(),
                SourceEvent::Fault(trouble) => assert!(readings.is_empty(), "{trouble:?}"),
                other => panic!("{other:?}"),
            }
        }
        readings
    }
}

/// Checks a bridge of its own for each case, all at the same time: what takes long is to wait.
fn at_once<T: Sync>(cases: &[(Protocol, T)], check: impl Fn(&mut Rig, &T) + Sync) {
    std::thread::scope(|scope| {
        for (protocol, case) in cases {
            scope.spawn(|| until_quiet(|| check(&mut Rig::new(*protocol), case)));
        }
    });
}

fn is_right(reading: &Reading) -> bool {
    [130.0, 131.0].iter().any(|x| {
        reading.field_mgauss == Some([Some(x * 1000.0 / 1300.0), Some(-10.0), Some(500.0)])
    }) && reading.rate_rad_s.is_some()
        && reading
            .specific_force_m_s2
            .is_some_and(|force| force.z == -9.80665)
}

#[test]
fn a_razor_is_reset_started_and_read() {
    let cases = [
        (Protocol::Auto, "#osrt#o1#oe1#s01"),
        (Protocol::Razor, "#osrt#o1#oe1#s01"),
        (Protocol::RazorBinary, "#osrb#o1#oe0#s01"),
    ];
    at_once(&cases, |rig, order| {
        let device = rig.plug(razor());
        let readings = rig.readings(20);
        assert!(
            readings.iter().all(|(reading, _)| is_right(reading)),
            "{readings:?}"
        );
        assert!(readings.is_sorted_by(|a, b| a.0.t_s <= b.0.t_s && a.1 <= b.1));
        assert_eq!(device.resets.load(std::sync::atomic::Ordering::Relaxed), 1);
        let heard = String::from_utf8(device.heard.lock().unwrap().clone()).unwrap();
        assert!(
            heard.starts_with("#s00") && heard.ends_with(order),
            "{heard}"
        );
    });
}

#[test]
fn an_unplugged_device_is_told_of_once_and_found_again_as_another_node() {
    at_once(&[(Protocol::Auto, ())], |rig, ()| {
        let (code, message) = rig.trouble();
        assert_eq!(code, "no_device");
        assert!(
            message.contains("cannot open serial port") && message.contains("by-id"),
            "{message}"
        );
        let mut last_s = 0.0;
        let mut nodes = BTreeSet::new();
        let mut kept = Vec::new();
        // Other tests take and free numbers too: a device may get the one that it had.
        for round in 0.. {
            if round >= 3 && nodes.len() > 1 {
                break;
            }
            assert!(round < 30, "always {nodes:?}");
            let device = rig.plug(razor());
            nodes.insert(std::fs::read_link(rig.link()).unwrap());
            if round > 0 {
                assert!(matches!(rig.next(), SourceEvent::Fault(None)));
            }
            let readings = rig.readings(5);
            assert!(
                readings[0].0.t_s >= last_s
                    && readings.iter().all(|(reading, _)| is_right(reading))
            );
            last_s = readings[4].0.t_s;
            device.unplug();

            let (code, message) = rig.trouble();
            assert!(
                code == "unplugged" && message.contains("plug the device in again"),
                "{message}"
            );
            // So that the next one gets another number.
            kept.push(std::fs::File::open("/dev/ptmx").unwrap());
        }
    });
}

#[test]
fn a_device_that_was_reset_is_started_again() {
    let cases = [(Protocol::Razor, ()), (Protocol::RazorBinary, ())];
    at_once(&cases, |rig, ()| {
        let device = rig.plug(razor());
        rig.readings(5);
        let orders = || {
            device
                .heard
                .lock()
                .unwrap()
                .windows(4)
                .filter(|bytes| bytes == b"#s01")
                .count()
        };
        let before = orders();
        // Its supply fails for a moment: it is in its first mode again, and nobody has opened the port.
        device.brown_out();
        rig.readings(100);
        assert!(orders() > before);
    });
}

#[test]
fn lost_bytes_cost_frames_and_no_more() {
    let cases = [(Protocol::Razor, ()), (Protocol::RazorBinary, ())];
    at_once(&cases, |rig, ()| {
        let habits = Habits {
            lose: Some(997),
            ..Habits::default()
        };
        let _device = Device::plug(&rig.link(), razor(), habits);
        let (mut count, mut right) = (0, 0);
        while count < 100 {
            if let SourceEvent::Reading(reading, _) = rig.next() {
                count += 1;
                right += usize::from(is_right(&reading));
            }
        }
        assert!(right >= 85, "{right}");
    });
}

#[test]
fn log_rows_are_found_and_timed_by_the_device() {
    at_once(&[(Protocol::Auto, ())], |rig, ()| {
        let header = "# headingd-log 1\r\n# mag_unit = uT\r\nt_s,mx,my,mz\r\n";
        // So that each row says when it was made.
        let firmware = Firmware::Plain(header.into(), "{t},{t},20,30\r\n".into());
        let habits = Habits {
            burst: Duration::from_millis(60),
            ..Habits::default()
        };
        let device = Device::plug(&rig.link(), firmware, habits);
        let made_and_timed = |(reading, _): &(Reading, Instant)| match reading.field_mgauss {
            Some([Some(made), Some(200.0), Some(300.0)]) => (made / 10.0, reading.t_s),
            other => panic!("{other:?}"),
        };
        // They come in bursts of three; their times are as far apart as the device says.
        let times: Vec<_> = rig.readings(40).iter().map(made_and_timed).collect();
        let [made_s, timed_s] = [times[39].0 - times[0].0, times[39].1 - times[0].1];
        assert!((timed_s - made_s).abs() < 0.2, "{times:?}");
        assert!(device.heard.lock().unwrap().is_empty());
    });
}

#[test]
fn whatever_comes_instead_has_one_message() {
    fn noise() -> Firmware {
        Firmware::Flood((0..200u32).map(|i| (i * 97 + 131) as u8 | 0x80).collect())
    }
    fn line(text: &str) -> Firmware {
        Firmware::Plain(Vec::new(), text.into())
    }
    type Case = (&'static str, fn() -> Firmware, &'static str);
    let cases: [(Protocol, Case); 9] = [
        (Protocol::Auto, ("silent", || line(""), "sends nothing")),
        (
            Protocol::Auto,
            ("noise", noise, "serial.baud, which is 57600"),
        ),
        (
            Protocol::RazorBinary,
            ("noise", noise, "serial.baud, which is 57600"),
        ),
        (
            Protocol::Auto,
            (
                "long_line",
                || Firmware::Flood(vec![b'7'; 2000]),
                "longer than 4 KiB",
            ),
        ),
        (
            Protocol::Auto,
            ("not_understood", || line("hello world\r\n"), "hello world"),
        ),
        (
            Protocol::Razor,
            (
                "not_understood",
                || line("#A-R=1;2;3\r\n#M-R=1;2;3\r\n#G-R=1;2;3\r\n"),
                "#G-R=1;2;3",
            ),
        ),
        (
            Protocol::Razor,
            ("other_mode", || line("#YPR=1,2,3\r\n"), "both ways"),
        ),
        (
            Protocol::LogRows,
            ("not_understood", || line("a,b\r\n"), "serial.protocol"),
        ),
        (
            Protocol::Auto,
            ("no_header", || line("1,2,3,4\r\n"), "in milligauss"),
        ),
    ];
    // With tests/slow until it has been closed, opened anew and found wanting again.
    let goes_on = Duration::from_secs(if slow() { 15 } else { 1 });
    at_once(&cases, |rig, (code, firmware, part)| {
        let _device = rig.plug(firmware());
        let (found, message) = rig.trouble();
        assert!(
            found == *code && message.contains(part),
            "{found}: {message}"
        );
        assert!(message.contains(rig.link().to_str().unwrap()), "{message}");
        // It is said once, though it goes on.
        let more = rig.next_within(goes_on);
        assert!(more.is_none(), "{code}: {more:?}");
    });
}

#[test]
fn what_cannot_be_opened_says_why() {
    at_once(&[(Protocol::Auto, ())], |rig, ()| {
        std::fs::write(rig.link(), "a file").unwrap();
        let (code, message) = rig.trouble();
        assert!(
            code == "port" && message.contains("no terminal device"),
            "{message}"
        );
        let mut null = Rig::new(Protocol::Auto);
        symlink("/dev/null", null.link()).unwrap();
        let (_, message) = null.trouble();
        assert!(message.contains("no terminal device"), "{message}");
    });
    at_once(&[(Protocol::Auto, ())], |first, ()| {
        let _device = first.plug(razor());
        first.readings(1);
        let mut second = Rig::new(Protocol::Auto);
        symlink(std::fs::read_link(first.link()).unwrap(), second.link()).unwrap();
        let (code, message) = second.trouble();
        assert!(
            code == "busy" && message.contains("another program holds it"),
            "{code}: {message}"
        );
        first.readings(5);
    });
}

#[test]
fn it_stops_when_told_to() {
    let mut rig = Rig::new(Protocol::Auto);
    rig.trouble();
    let stopped = rig
        .runtime
        .block_on(rig.bridge.next(&AtomicBool::new(true)));
    assert!(stopped.is_none());
    assert!(!Path::new(&rig.link()).exists());
}
