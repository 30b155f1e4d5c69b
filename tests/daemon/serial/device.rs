//! A simulated device behind a pseudo-terminal: a Razor with its firmware, or anything else that speaks.

use std::fs::{self, File};
use std::io::{ErrorKind, Read, Write};
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use headingd::recording::Entry;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};

/// Counts of accelerometer, magnetometer and gyro, as the Razor has them.
pub type Counts = [[i32; 3]; 3];

/// A frame as `#osrt` sends it.
pub fn text(counts: Counts) -> Vec<u8> {
    let line = |(name, [x, y, z]): (char, [i32; 3])| format!("#{name}-R={x}.00,{y}.00,{z}.00\r\n");
    ['A', 'M', 'G']
        .into_iter()
        .zip(counts)
        .map(line)
        .collect::<String>()
        .into_bytes()
}

/// A frame as `#osrb` sends it.
pub fn binary(counts: Counts) -> Vec<u8> {
    counts
        .as_flattened()
        .iter()
        .flat_map(|count| (*count as f32).to_le_bytes())
        .collect()
}

/// What the device does, apart from speaking its protocol.
#[derive(Clone, Default)]
pub struct Habits {
    /// It says everything late, when so much time has gathered, as a USB adapter does.
    pub burst: Duration,
    /// Each so many bytes it loses one.
    pub lose: Option<usize>,
    /// Its magnetometer cannot be read.
    pub mag_fails: bool,
}

/// What runs on the device.
pub enum Firmware {
    /// The Razor AHRS. Counts at so many seconds after its start.
    Razor(Box<dyn FnMut(f64) -> Counts + Send>),
    /// Sends this after each reset, and then this every 20 ms, with the time filled in for `{t}`.
    Plain(Vec<u8>, String),
    /// These bytes over and over, as fast as they are taken.
    Flood(Vec<u8>),
}

/// The host's end of a new pseudo-terminal, which blocks nobody, and the path of the device's end.
pub fn pty() -> (File, String) {
    let pty = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).unwrap();
    grantpt(&pty).unwrap();
    unlockpt(&pty).unwrap();
    rustix::io::ioctl_fionbio(&pty, true).unwrap();
    let node = ptsname(&pty, Vec::new()).unwrap().into_string().unwrap();
    (File::from(pty), node)
}

/// A device at work, until it is dropped or unplugged.
pub struct Device {
    stop: Arc<AtomicBool>,
    fails: Arc<AtomicBool>,
    /// How often it was reset by being opened, and what it has been sent.
    pub resets: Arc<AtomicU32>,
    pub heard: Arc<Mutex<Vec<u8>>>,
    thread: Option<JoinHandle<()>>,
    link: PathBuf,
}

impl Device {
    /// Plugs it in at `link`, which as in `/dev/serial/by-id` points to a node of any name.
    pub fn plug(link: &Path, firmware: Firmware, habits: Habits) -> Self {
        let (pty, node) = pty();
        // Until it has been opened once, nobody knows that it is not.
        drop(File::open(&node).unwrap());
        symlink(node, link).unwrap();
        let stop = Arc::new(AtomicBool::new(false));
        let fails = Arc::new(AtomicBool::new(false));
        let (resets, heard) = (Arc::default(), Arc::default());
        let mut board = Board {
            pty,
            firmware,
            habits,
            fails: Arc::clone(&fails),
            resets: Arc::clone(&resets),
            heard: Arc::clone(&heard),
            open: false,
            started: Instant::now(),
            mode: Mode::Angles,
            streaming: true,
            errors: false,
            input: Vec::new(),
            output: Vec::new(),
            said: 0,
            flushed: Instant::now(),
        };
        let stopped = stop.clone();
        let thread = std::thread::spawn(move || board.run(&stopped));
        Self {
            stop,
            fails,
            resets,
            heard,
            thread: Some(thread),
            link: link.to_owned(),
        }
    }

    /// Its supply fails for a moment.
    pub fn brown_out(&self) {
        self.fails.store(true, Ordering::Relaxed);
    }

    /// Pulls the plug: in the middle of a line.
    pub fn unplug(self) {}
}

impl Drop for Device {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
        let _ = fs::remove_file(&self.link);
    }
}

#[derive(PartialEq)]
enum Mode {
    Angles,
    Text,
    Binary,
}

struct Board {
    pty: File,
    firmware: Firmware,
    habits: Habits,
    fails: Arc<AtomicBool>,
    resets: Arc<AtomicU32>,
    heard: Arc<Mutex<Vec<u8>>>,
    open: bool,
    started: Instant,
    mode: Mode,
    streaming: bool,
    errors: bool,
    input: Vec<u8>,
    output: Vec<u8>,
    said: usize,
    flushed: Instant,
}

/// The boot loader is deaf for so long.
const BOOT: Duration = Duration::from_millis(300);

/// From one frame to the next.
const PERIOD: Duration = Duration::from_millis(20);

impl Board {
    fn run(&mut self, stop: &AtomicBool) {
        let mut tick = Instant::now();
        while !stop.load(Ordering::Relaxed) {
            if self.fails.swap(false, Ordering::Relaxed) {
                self.open = false;
            }
            self.listen();
            while tick + PERIOD <= Instant::now() {
                tick += PERIOD;
                if self.open && tick >= self.started + BOOT {
                    self.tick(tick);
                }
            }
            if self.flushed.elapsed() >= self.habits.burst {
                self.flush();
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        self.say(b"#M-R=1");
        self.flush();
    }

    fn listen(&mut self) {
        let mut bytes = [0; 256];
        match self.pty.read(&mut bytes) {
            Ok(0) => {}
            Ok(count) => {
                self.reset_if_opened();
                self.heard.lock().unwrap().extend(&bytes[..count]);
                let understands = matches!(self.firmware, Firmware::Razor(_));
                if understands && self.started.elapsed() >= BOOT {
                    self.input.extend(&bytes[..count]);
                }
            }
            Err(error) if error.kind() == ErrorKind::WouldBlock => self.reset_if_opened(),
            // Nobody holds it open.
            Err(_) => self.open = false,
        }
        while let Some(at) = self.input.iter().position(|byte| *byte == b'#') {
            let command = self.input[at + 1..].to_vec();
            let length = match command[..] {
                [b's', a, b, ..] => {
                    let answer = [b"#SYNCH", &[a, b][..], b"\r\n"].concat();
                    self.say(&answer);
                    3
                }
                [b'o', b's', _, kind, ..] => {
                    self.mode = if kind == b't' {
                        Mode::Text
                    } else {
                        Mode::Binary
                    };
                    4
                }
                [b'o', b't', ..] => {
                    self.mode = Mode::Angles;
                    2
                }
                [b'o', on @ (b'0' | b'1'), ..] => {
                    self.streaming = on == b'1';
                    2
                }
                [b'o', b'e', on @ (b'0' | b'1'), ..] => {
                    self.errors = on == b'1';
                    3
                }
                // An unfinished command waits for its end.
                []
                | [b's']
                | [b's', _]
                | [b'o']
                | [b'o', b's']
                | [b'o', b's', _]
                | [b'o', b'e'] => break,
                _ => 1,
            };
            self.input.drain(..at + 1 + length);
        }
    }

    /// To be opened raises DTR, and that is a reset.
    fn reset_if_opened(&mut self) {
        if !self.open {
            self.open = true;
            self.started = Instant::now();
            (self.mode, self.streaming, self.errors) = (Mode::Angles, true, false);
            self.input.clear();
            self.output.clear();
            self.resets.fetch_add(1, Ordering::Relaxed);
            if let Firmware::Plain(greeting, _) = &self.firmware {
                let greeting = greeting.clone();
                self.say(&greeting);
            }
        }
    }

    /// A frame of this moment. A real board measures when its timer says so: that this machine comes round to it later
    /// is a delay on the wire, and costs neither the measurement's time nor the measurement.
    fn tick(&mut self, tick: Instant) {
        let t_s = (tick - self.started).as_secs_f64();
        let bytes = match &mut self.firmware {
            Firmware::Razor(_) if !self.streaming => Vec::new(),
            Firmware::Razor(counts) => match self.mode {
                Mode::Angles => b"#YPR=1.00,-2.00,3.00\r\n".to_vec(),
                Mode::Text => {
                    let failed: &[u8] = match self.habits.mag_fails && self.errors {
                        true => b"!ERR: reading magnetometer\r\n",
                        false => b"",
                    };
                    [failed, &text(counts(t_s))].concat()
                }
                Mode::Binary => binary(counts(t_s)),
            },
            Firmware::Plain(_, row) => row.replace("{t}", &format!("{t_s:.4}")).into_bytes(),
            Firmware::Flood(bytes) => bytes.clone(),
        };
        self.say(&bytes);
    }

    fn say(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.said += 1;
            if self
                .habits
                .lose
                .is_none_or(|every| !self.said.is_multiple_of(every))
            {
                self.output.push(*byte);
            }
        }
    }

    fn flush(&mut self) {
        self.flushed = Instant::now();
        // What nobody takes is lost.
        let _ = self.pty.write(&self.output);
        self.output.clear();
    }
}

/// The last numbers of a log before a time, as a Razor with its chips in line with the body would tell them. The
/// log begins when it is first asked for: what the host misses before that may be the rest before a turn.
pub fn counts_of(entries: Vec<Entry>, counts_per_gauss: f64) -> impl FnMut(f64) -> Counts + Send {
    let mut entries = entries.into_iter().peekable();
    let mut counts = [[0; 3]; 3];
    let mut begun_s = None;
    move |t_s| {
        let t_s = t_s - *begun_s.get_or_insert(t_s);
        while let Some(entry) = entries.next_if(|entry| entry.reading.t_s <= t_s) {
            let reading = entry.reading;
            if let Some(force) = reading.specific_force_m_s2 {
                counts[0] = (force * (-256.0 / 9.80665))
                    .map(|n| n.round() as i32)
                    .into();
            }
            if let Some(field) = reading.whole_field_mgauss() {
                counts[1] = (field * (counts_per_gauss / 1000.0))
                    .map(|n| n.round() as i32)
                    .into();
            }
            if let Some(rate) = reading.rate_rad_s {
                counts[2] = rate
                    .map(|n| (n.to_degrees() * 14.375).round() as i32)
                    .into();
            }
        }
        counts
    }
}
