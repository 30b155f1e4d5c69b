//! A board for a bus without one: writes into the registers of i2c-stub what the chips of SparkFun's stick would
//! say in the motion of a log, in real time, and holds the headings on the daemon's socket against the log's truth.
//!
//!     stand BUS LOG SOCKET
//!     stand --feed BUS LOG         (over and over, until it is killed)
//!     stand --heading SOCKET S     (waits for a heading, S seconds at most)
//!     stand --set BUS ADDRESS REGISTER VALUE     (one register, in hexadecimal: 0x1e 0x0a 0x48)
//!
//! i2c-stub keeps what is written and does nothing by itself. So this program looks whether the magnetometer was
//! told to measure, and answers like one: after a while the data, RDY, and, unless it measures continuously, the mode
//! back to idle.

use std::error::Error;
use std::io::{BufRead, BufReader, Write};
use std::os::unix::net::UnixStream;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use headingd::frame::Mountings;
use headingd::recording::Entry;
use headingd::sensor::board::Board;
use headingd::sensor::clock::{Clock, SystemClock};
use headingd::sensor::drivers;
use headingd::sensor::replay::Replay;
use i2cdev::core::I2CDevice;
use i2cdev::linux::LinuxI2CDevice;
use nalgebra::Vector3;
use serde_json::Value;

type Outcome<T> = Result<T, Box<dyn Error + Send + Sync>>;

/// How often it is looked whether the magnetometer is to measure, and how long it takes then, seconds.
const LOOK_S: f64 = 0.001;
const CONVERSION_S: f64 = 0.006;
/// Its modes, and how often it measures in continuous mode for each code of its register A; the last one is reserved.
const CONTINUOUS: u8 = 0;
const SINGLE: u8 = 1;
const IDLE: u8 = 2;
const RATES_HZ: [f64; 8] = [0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 50.0];
/// What the magnetometer's self-test adds to each of its axes.
const OWN_FIELD_MGAUSS: Vector3<f64> = Vector3::new(550.0, 550.0, 550.0);
/// The largest error of the heading after the calibration, degrees RMS. An emulated processor writes some samples late,
/// while the board turns by 50 degrees a second.
const ALLOWED_DEG: f64 = 3.0;

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            println!("FAILED: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> Outcome<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match arguments.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["--set", bus, address, register, value] => {
            let mut chip = LinuxI2CDevice::new(bus, byte(address)?.into())?;
            Ok(chip.smbus_write_byte_data(byte(register)?, byte(value)?)?)
        }
        ["--feed", bus, log] => {
            let entries = load(log)?;
            loop {
                feed(bus, &entries, SystemClock::new(Arc::default()))?;
            }
        }
        ["--heading", socket, patience_s] => heading(socket, patience_s.parse()?),
        [bus, log, socket] => stand(bus, log, socket),
        _ => Err("usage: stand BUS LOG SOCKET".into()),
    }
}

fn byte(text: &str) -> Outcome<u8> {
    Ok(u8::from_str_radix(text.trim_start_matches("0x"), 16)?)
}

fn load(log: &str) -> Outcome<Vec<Entry>> {
    Ok(Replay::open(log.as_ref())?.collect::<Result<_, _>>()?)
}

/// Waits for the first heading of a daemon that may not run yet.
fn heading(socket: &str, patience_s: f64) -> Outcome<()> {
    let begun = Instant::now();
    let until = begun + Duration::from_secs_f64(patience_s);
    while Instant::now() < until {
        // Refused, or hung up: it is tried again.
        if let Some(heading_deg) = first_heading(socket, until) {
            let s = begun.elapsed().as_secs_f64();
            println!("heading {heading_deg:.0} deg after {s:.2} s");
            return Ok(());
        }
        thread::sleep(Duration::from_millis(10));
    }
    Err(format!("no heading within {patience_s} s").into())
}

fn first_heading(socket: &str, until: Instant) -> Option<f64> {
    let mut stream = UnixStream::connect(socket).ok()?;
    let left = until.saturating_duration_since(Instant::now());
    stream.set_read_timeout(Some(left)).ok()?;
    stream.write_all(b"?WATCH={\"enable\":true};\n").ok()?;
    let lines = BufReader::new(stream).lines().map_while(Result::ok);
    lines
        .take_while(|_| Instant::now() < until)
        .find_map(|line| {
            let message: Value = serde_json::from_str(&line).ok()?;
            message["mheading"].as_f64()
        })
}

fn stand(bus: &str, log: &str, socket: &str) -> Outcome<()> {
    let entries = load(log)?;
    let over = Arc::new(AtomicBool::new(false));
    let clock = SystemClock::new(over.clone());
    // The daemon tells the time of day of each reading; the log's time 0 is now.
    let begun_s = SystemTime::now().duration_since(UNIX_EPOCH)?.as_secs_f64() - clock.now_s();
    let truth: Vec<(f64, f64)> = entries
        .iter()
        .filter_map(|entry| Some((entry.reading.t_s, entry.heading_truth_deg?)))
        .collect();
    let stream = UnixStream::connect(socket)?;
    let listener = thread::spawn(move || listen(stream, begun_s, &truth, &over));
    let fed = feed(bus, &entries, clock);
    let heard = listener.join().map_err(|_| "the listener panicked")?;
    fed?;
    heard
}

/// Plays the log into the registers.
fn feed(bus: &str, entries: &[Entry], mut clock: SystemClock) -> Outcome<()> {
    let mountings = Board::Sparkfun9dofStick.mountings(&Mountings::default());
    let chip = drivers::magnetometer("hmc5843").ok_or("no driver for the magnetometer")?;
    let mut mag = LinuxI2CDevice::new(bus, 0x1E)?;
    let mut gyro = LinuxI2CDevice::new(bus, 0x68)?;
    let mut accel = LinuxI2CDevice::new(bus, 0x53)?;
    let fields: Vec<(f64, Vector3<f64>)> = entries
        .iter()
        .filter_map(|entry| Some((entry.reading.t_s, entry.reading.whole_field_mgauss()?)))
        .collect();
    let end_s = entries.last().map_or(0.0, |entry| entry.reading.t_s);
    let mut motions = entries
        .iter()
        .filter(|e| e.reading.rate_rad_s.is_some())
        .peekable();
    let mut ready_s = None;
    let mut last_s = 0.0;
    let mut doing = [IDLE, 0];
    loop {
        let now_s = clock.now_s();
        if now_s > end_s {
            return Ok(());
        }
        while let Some(entry) = motions.next_if(|entry| entry.reading.t_s <= now_s) {
            let reading = &entry.reading;
            if let Some(rate) = reading.rate_rad_s {
                let counts = mountings
                    .gyro
                    .to_chip(rate)
                    .map(|n| n.to_degrees() * 14.375);
                gyro.smbus_write_i2c_block_data(0x1D, &bytes(counts, i16::to_be_bytes))?;
            }
            if let Some(force) = reading.specific_force_m_s2 {
                let counts = mountings.accel.to_chip(force) * (256.0 / 9.80665);
                accel.smbus_write_i2c_block_data(0x32, &bytes(counts, i16::to_le_bytes))?;
            }
        }
        let told = [
            mag.smbus_read_byte_data(0x02)?,
            mag.smbus_read_byte_data(0x00)?,
        ];
        let [mode, settings] = told;
        if told != doing {
            // Told something else, it drops what it was measuring.
            doing = told;
            ready_s = None;
        }
        if ready_s.is_none() && mode == SINGLE {
            ready_s = Some(now_s + CONVERSION_S);
        } else if ready_s.is_none() && mode == CONTINUOUS {
            let period_s = 1.0 / RATES_HZ[usize::from(settings >> 2 & 7)];
            ready_s = Some((last_s + period_s).max(now_s));
        }
        if ready_s.is_some_and(|ready_s| ready_s <= now_s) {
            last_s = ready_s.take().unwrap_or(now_s);
            let gain = mag.smbus_read_byte_data(0x01)? >> 5;
            let counts_per_mgauss = chip.sheet().gain(gain) / 1000.0;
            // The sample of the log that is nearest in time; between two of them, part of both.
            let field =
                between(&fields, now_s, |a, b, share| a + (b - a) * share).unwrap_or_default();
            let counts = match settings & 3 {
                // With measurement bias on, the chip tells what its own field adds.
                1 => OWN_FIELD_MGAUSS * counts_per_mgauss,
                2 => -OWN_FIELD_MGAUSS * counts_per_mgauss,
                _ => mountings.mag.to_chip(field) * counts_per_mgauss,
            };
            let mut block = bytes(counts, i16::to_be_bytes).to_vec();
            block.push(0x01);
            mag.smbus_write_i2c_block_data(0x03, &block)?;
            if mode == SINGLE {
                mag.smbus_write_byte_data(0x02, IDLE)?;
            }
        }
        if !clock.wait_until(now_s + LOOK_S) {
            return Ok(());
        }
    }
}

fn bytes(counts: Vector3<f64>, order: fn(i16) -> [u8; 2]) -> [u8; 6] {
    let [x, y, z] = <[f64; 3]>::from(counts).map(|count| order(count.round() as i16));
    [x[0], x[1], y[0], y[1], z[0], z[1]]
}

/// What `mix` makes of the two neighbours of a time; `None` outside.
fn between<T: Copy>(rows: &[(f64, T)], t_s: f64, mix: impl Fn(T, T, f64) -> T) -> Option<T> {
    let after = rows.partition_point(|row| row.0 <= t_s);
    let (from, to) = (rows.get(after.checked_sub(1)?)?, rows.get(after)?);
    Some(mix(from.1, to.1, (t_s - from.0) / (to.0 - from.0)))
}

/// Follows the daemon until the end of the truth, and judges it.
fn listen(
    stream: UnixStream,
    begun_s: f64,
    truth: &[(f64, f64)],
    over: &AtomicBool,
) -> Outcome<()> {
    let heard = listen_on(stream, begun_s, truth);
    over.store(true, Ordering::Relaxed);
    heard
}

fn listen_on(mut stream: UnixStream, begun_s: f64, truth: &[(f64, f64)]) -> Outcome<()> {
    stream.set_read_timeout(Some(Duration::from_secs(10)))?;
    stream.write_all(b"?WATCH={\"enable\":true,\"state\":true,\"calibration\":true};\n")?;
    let end_s = truth.last().map_or(0.0, |last| last.0);
    let mut states: Vec<String> = Vec::new();
    let mut accepted = 0;
    let mut squares = Vec::new();
    let mut count = 0;
    for line in BufReader::new(stream).lines() {
        let message: Value = serde_json::from_str(&line?)?;
        match message["class"].as_str() {
            Some("STATE") => {
                let state = message["cal_state"].as_str().unwrap_or_default().to_owned();
                if states.last() != Some(&state) {
                    println!("state {state}: {}", message["message"]);
                    states.push(state);
                }
                // A slow machine may publish nothing more after the log's end: the registers stand still, and the state says so.
                if SystemTime::now().duration_since(UNIX_EPOCH)?.as_secs_f64() > begun_s + end_s {
                    break;
                }
            }
            Some("CALIBRATION") => {
                println!("calibration {}: {}", message["verdict"], message["message"]);
                accepted += u32::from(message["verdict"] == "accepted");
            }
            Some("ATT") => {
                count += 1;
                let time = message["time"].as_str().ok_or("an ATT without a time")?;
                let t_s = since(begun_s, time).ok_or("a time that is none")?;
                if t_s > end_s - 0.5 {
                    break;
                }
                let right = between(truth, t_s, |a, b, share| a + turned(b - a) * share);
                if let (Some(right), Some(found)) = (right, message["mheading"].as_f64()) {
                    squares.push(turned(found - right).powi(2));
                }
            }
            _ => {}
        }
    }
    let rms_deg = (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt();
    println!(
        "{count} ATT, {} with a heading, off by {rms_deg:.2} deg RMS",
        squares.len()
    );
    for state in ["uncalibrated", "turning", "good"] {
        if !states.iter().any(|seen| seen == state) {
            return Err(format!("the state {state} was never seen").into());
        }
    }
    if accepted == 0 || squares.len() < 300 || rms_deg > ALLOWED_DEG {
        return Err(format!(
            "{accepted} calibrations accepted, {} headings, {rms_deg:.2} deg",
            squares.len()
        )
        .into());
    }
    Ok(())
}

fn turned(angle_deg: f64) -> f64 {
    (angle_deg + 540.0).rem_euclid(360.0) - 180.0
}

/// Seconds from the beginning to a time of day, `…T12:34:56.789Z`, within the same or the next day.
fn since(begun_s: f64, time: &str) -> Option<f64> {
    const DAY_S: f64 = 86_400.0;
    let clock = time.split_once('T')?.1.strip_suffix('Z')?;
    let in_day = clock.split(':').try_fold(0.0, |sum, part| {
        Some(sum * 60.0 + part.parse::<f64>().ok()?)
    })?;
    let s = (in_day - begun_s).rem_euclid(DAY_S);
    // A moment before the beginning is no day after it.
    Some(if s > 0.5 * DAY_S { s - DAY_S } else { s })
}
