//! A client that holds every heading against the truth, and knows whether a calibration was ever lost.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;

use serde_json::Value;

use crate::log::{Truth, micros};
use crate::rig::{Client, apart_deg};

/// The largest error of a heading that is published as good, degrees.
const LARGEST_DEG: f64 = 5.0;

/// A sample is stale after this, milliseconds: the default of `heading.stale_s`.
const STALE_MS: u64 = 500;

/// What has been seen so far.
#[derive(Default)]
pub struct Seen {
    /// Headings.
    pub headings: AtomicU64,
    /// A calibration is active.
    pub calibrated: AtomicBool,
}

/// Watches until the daemon hangs up.
pub fn watch(mut client: Client, truth: Arc<Truth>, seen: Arc<Seen>) -> JoinHandle<()> {
    std::thread::spawn(move || {
        let mut last_s = f64::NEG_INFINITY;
        while let Some(message) = client.next() {
            match message["class"].as_str() {
                Some("STATE") => {
                    let word = message["cal_state"].as_str().unwrap();
                    let without = ["uncalibrated", "turning", "calibrating"].contains(&word);
                    let had = seen.calibrated.load(Ordering::Relaxed);
                    assert!(!(had && without), "the calibration is lost: {message}");
                }
                Some("CALIBRATION") if message["verdict"] == "accepted" => {
                    seen.calibrated.store(true, Ordering::Relaxed);
                }
                Some("ATT") => {
                    let t_s = message["t_s"].as_f64().unwrap();
                    assert!(t_s > last_s, "after {last_s}: {message}");
                    last_s = t_s;
                    let Some(heading) = message.get("mheading") else {
                        continue;
                    };
                    seen.headings.fetch_add(1, Ordering::Relaxed);
                    let right = truth.get(&micros(t_s)).copied();
                    let right = right.unwrap_or_else(|| panic!("of no sample: {message}"));
                    assert!(is_fresh(&message), "{message}");
                    let off = apart_deg(heading.as_f64().unwrap(), right);
                    assert!(
                        off.abs() < LARGEST_DEG || message["cal_state"] != "good",
                        "{right}: {message}"
                    );
                }
                _ => {}
            }
        }
    })
}

/// No heading without a fresh sample, and none under a condition that forbids it.
pub fn is_fresh(message: &Value) -> bool {
    let steers = ["good", "degraded", "disturbed"];
    message.get("mheading").is_none()
        || message["age_ms"]
            .as_u64()
            .is_some_and(|age| age <= STALE_MS)
            && message["cal_state"]
                .as_str()
                .is_some_and(|word| steers.contains(&word))
}
