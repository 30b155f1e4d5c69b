//! The objects of the gpsd dialect, as text. Pure: no I/O and no clock.
//!
//! What gpsd's own clients need (tested with version 3.22): compact JSON, `class` first, and nothing but
//! flat scalars in `ATT`. Unknown values are omitted, never 0 or null. None of these functions ends
//! its object with a newline.

use super::json::{push_angle, push_integer, push_number, push_string};
use crate::calibration::outcome::Outcome;
use crate::condition::Report;
use crate::heading::Heading;

/// Where the headings come from, as `DEVICE` names it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Device {
    /// Path of the source: `/dev/i2c-1`, `/dev/ttyUSB0`, the path of a log.
    pub path: String,
    /// When it was opened, RFC 3339 in UTC; if the time of day was not known then, when it gave the first heading with one.
    pub activated: Option<String>,
    /// The magnetometer, if it has a name.
    pub sensor: Option<String>,
    /// Speed of its line in bits a second, if it has one.
    pub bps: Option<u32>,
}

/// The release of gpsd whose dialect this is: its own clients warn of any other, and `cgps` with a line across its
/// screen. `rev` says who really answers.
const RELEASE: &str = "3.22";

/// gpsd's cycle of a device of which it knows none.
const CYCLE_S: f64 = 1.0;

/// gpsd's own. Its Python client passes over every line that ends otherwise, without a word.
pub(super) const LINE_END: &str = "\r\n";

/// What one client has asked to be sent: gpsd calls it the watcher's policy.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WatchPolicy {
    /// Whether anything is sent unasked.
    pub enable: bool,
    /// `ATT`.
    pub json: bool,
    /// NMEA 0183.
    pub nmea: bool,
    /// So many headings a second at most; otherwise each as `ATT`, and as NMEA 0183 as many as are set.
    pub rate_hz: Option<f64>,
    /// `CALIBRATION`.
    pub calibration: bool,
    /// `STATE`.
    pub state: bool,
    /// `BOARD` once, and `READING`.
    pub readings: bool,
}

/// Appends a heading as an `ATT` object, up to its age, which only the moment of sending tells: [`att_end`] completes it.
///
/// `time` is the time of the reading, RFC 3339 in UTC, if it is known. Headings are rounded to 0.01° and stay below 360;
/// fields to 0.1 mG; `t_s` to 1 µs. `rot` is in degrees a minute, `acc_x` and its like in m/s², `gyro_x` and its like in
/// degrees a second.
pub fn att_begin(out: &mut String, device: &str, heading: &Heading, time: Option<&str>) {
    out.push_str(r#"{"class":"ATT""#);
    push_string(out, "device", device);
    if let Some(time) = time {
        push_string(out, "time", time);
    }
    push_number(out, "t_s", Some(heading.t_s), 6);
    push_integer(out, "seq", heading.seq);
    if heading.condition.may_steer() {
        // gpsd's `heading` is the true one.
        push_angle(out, "heading", heading.true_deg());
        push_angle(out, "mheading", heading.magnetic_deg());
        push_angle(out, "inst_heading", heading.instantaneous_deg);
    }
    push_angle(out, "raw_heading", heading.raw_deg);
    if heading.condition.may_steer() {
        push_number(out, "heading_sd", heading.sd_deg, 2);
    }
    push_string(out, "mag_st", heading.mag_status.word());
    push_number(out, "pitch", heading.pitch_deg, 2);
    push_number(out, "roll", heading.roll_deg, 2);
    push_number(out, "rot", heading.turn_deg_min, 1);
    push_number(out, "dip", heading.dip_deg, 2);
    push_number(out, "mag_len", heading.strength_mgauss, 1);
    if let Some([x, y, z]) = heading.field_mgauss {
        push_number(out, "mag_x", x, 1);
        push_number(out, "mag_y", y, 1);
        push_number(out, "mag_z", z, 1);
    }
    if let Some([x, y, z]) = heading.specific_force_m_s2 {
        push_number(out, "acc_len", Some((x * x + y * y + z * z).sqrt()), 3);
        push_number(out, "acc_x", Some(x), 3);
        push_number(out, "acc_y", Some(y), 3);
        push_number(out, "acc_z", Some(z), 3);
    }
    if let Some([x, y, z]) = heading.rate_deg_s {
        push_number(out, "gyro_x", Some(x), 3);
        push_number(out, "gyro_y", Some(y), 3);
        push_number(out, "gyro_z", Some(z), 3);
    }
    push_string(out, "cal_state", heading.condition.word());
}

/// Completes what [`att_begin`] began; `age_ms` is how long ago the reading was, milliseconds.
pub fn att_end(out: &mut String, age_ms: u64) {
    push_integer(out, "age_ms", age_ms);
    out.push('}');
}

/// The condition as a `STATE` object.
pub fn state(report: &Report) -> String {
    let mut out = String::from(r#"{"class":"STATE""#);
    push_string(&mut out, "cal_state", report.condition.word());
    push_string(&mut out, "reason", report.reason);
    push_string(&mut out, "message", &report.message);
    push_number(&mut out, "progress", report.progress, 3);
    push_number(&mut out, "t_s", Some(report.t_s), 6);
    out.push('}');
    out
}

/// A calibration's outcome as a `CALIBRATION` object: the class, then exactly the keys of [`Outcome`].
pub fn calibration(outcome: &Outcome) -> String {
    let keys = serde_json::to_string(outcome).expect("an Outcome holds only what JSON can express");
    format!(r#"{{"class":"CALIBRATION",{}"#, &keys[1..])
}

/// The `VERSION` object, which is also the banner. The protocol numbers are those of that release.
pub fn version() -> String {
    let version = env!("CARGO_PKG_VERSION");
    format!(
        r#"{{"class":"VERSION","release":"{RELEASE}","rev":"headingd {version}","proto_major":3,"proto_minor":14}}"#
    )
}

/// The `DEVICE` object. `cycle_s` is the time from one heading to the next, if it is known.
///
/// Some clients fail unless they find all of gpsd's keys: a device without a serial line has 0 bits a second, and one
/// that is no receiver of satellites has no flag.
pub fn device(device: &Device, cycle_s: Option<f64>) -> String {
    let mut out = String::from(r#"{"class":"DEVICE""#);
    push_string(&mut out, "path", &device.path);
    push_string(&mut out, "driver", "headingd");
    push_string(
        &mut out,
        "subtype",
        device.sensor.as_deref().unwrap_or_default(),
    );
    if let Some(activated) = &device.activated {
        push_string(&mut out, "activated", activated);
    }
    out.push_str(r#","flags":0,"native":0"#);
    push_integer(&mut out, "bps", device.bps.unwrap_or(0).into());
    out.push_str(r#","parity":"N","stopbits":1"#);
    let cycle_s = Some(cycle_s.unwrap_or(CYCLE_S));
    push_number(&mut out, "cycle", cycle_s, 3);
    push_number(&mut out, "mincycle", cycle_s, 3);
    out.push('}');
    out
}

/// The `DEVICES` object around the `DEVICE` object: there is one device.
pub fn devices(device: &str) -> String {
    format!(r#"{{"class":"DEVICES","devices":[{device}]}}"#)
}

/// The `WATCH` object: gpsd's keys as gpsd orders them, then ours.
pub fn watch(policy: &WatchPolicy) -> String {
    let mut out = format!(
        concat!(
            r#"{{"class":"WATCH","enable":{},"json":{},"nmea":{},"raw":0,"scaled":false,"timing":false,"#,
            r#""split24":false,"pps":false,"calibration":{},"state":{},"readings":{}"#
        ),
        policy.enable, policy.json, policy.nmea, policy.calibration, policy.state, policy.readings
    );
    push_number(&mut out, "rate_hz", policy.rate_hz, 3);
    out.push('}');
    out
}

/// The `POLL` object around the latest `ATT` object, if there is one that is not stale. `time` is that of
/// the reading, if known. `tpv` and `sky` are always empty: gpsd's clients expect them.
pub fn poll(att: Option<&str>, time: Option<&str>) -> String {
    let mut out = String::from(r#"{"class":"POLL""#);
    if let Some(time) = time {
        push_string(&mut out, "time", time);
    }
    push_integer(&mut out, "active", u64::from(att.is_some()));
    out.push_str(r#","att":["#);
    out.push_str(att.unwrap_or_default());
    out.push_str(r#"],"tpv":[],"sky":[]}"#);
    out
}

/// The `ERROR` object.
pub fn error(message: &str) -> String {
    let mut out = String::from(r#"{"class":"ERROR""#);
    push_string(&mut out, "message", message);
    out.push('}');
    out
}

#[cfg(test)]
mod tests;
