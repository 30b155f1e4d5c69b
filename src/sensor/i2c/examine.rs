//! The examination of a board's chips, over any bus.

use nalgebra::Vector3;
use serde::Serialize;

use super::{Chips, Settings};
use crate::condition::SourceFault;
use crate::frame::Mountings;
use crate::reading::{EARTH_MGAUSS, STANDARD_GRAVITY_M_S2, STRONGEST_MGAUSS, WEAKEST_MGAUSS};
use crate::sensor::SourceEvent;
use crate::sensor::bus::{Bus, Cause, read_byte};
use crate::sensor::chip::magnetometer::AxisTest;
use crate::sensor::chip::mpu6050::MPU6050;
use crate::sensor::chip::{ChipError, drivers};
use crate::sensor::clock::Clock;

/// The chips are read for this long, seconds, after a second for setting them up.
const READING_S: f64 = 2.0;
const SETTLING_S: f64 = 1.0;
const GRAVITY_TOLERANCE: f64 = 0.15;
/// More noise than this is a board that moves, degrees a second.
const STILL_DEG_S: f64 = 2.0;
/// The least share of the wanted rate.
const RATE_SHARE: f64 = 0.9;

#[derive(Clone, Debug, Default, Serialize)]
pub(crate) struct CheckReport {
    pub(crate) bus: String,
    pub(crate) chips: Vec<FoundChip>,
    pub(crate) magnetometer: Option<FoundMagnetometer>,
    pub(crate) self_test: Vec<AxisTest>,
    /// Strength of the raw field, milligauss.
    pub(crate) field_mgauss: Option<f64>,
    pub(crate) mag_rate_hz: Option<f64>,
    /// Mean of the gyro at rest, body axes, and the largest noise of an axis.
    pub(crate) gyro_deg_s: Option<[f64; 3]>,
    pub(crate) gyro_noise_deg_s: Option<f64>,
    pub(crate) gyro_rate_hz: Option<f64>,
    /// Mean of the accelerometer at rest, body axes.
    pub(crate) accel_m_s2: Option<[f64; 3]>,
    pub(crate) problems: Vec<SourceFault>,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct FoundChip {
    pub(crate) address: u8,
    pub(crate) chip: &'static str,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct FoundMagnetometer {
    pub(crate) kind: &'static str,
    pub(crate) sure: bool,
    pub(crate) why: &'static str,
}

impl CheckReport {
    fn problem(&mut self, code: &'static str, message: String) {
        // Chips are tried more than once, and `Chips` puts the role before the message ("gyro: …"): skip one whose rest is known.
        if !self
            .problems
            .iter()
            .any(|known| message.ends_with(&known.message))
        {
            self.problems.push(SourceFault { code, message });
        }
    }

    fn failed(&mut self, error: &ChipError) {
        self.problem(error.code(), error.to_string());
    }
}

/// What the chips are held against.
pub(crate) struct Expected<'a> {
    pub(crate) i2c: &'a Settings,
    pub(crate) mountings: Mountings,
    pub(crate) gyro_bias_limit_deg_s: f64,
}

pub(crate) fn examine(
    expected: &Expected<'_>,
    bus: &mut dyn Bus,
    clock: &mut dyn Clock,
) -> CheckReport {
    let mut report = CheckReport {
        bus: expected.i2c.path().display().to_string(),
        ..CheckReport::default()
    };
    if !find_chips(&mut report, bus, clock) {
        return report;
    }
    test_the_magnetometer(expected, &mut report, bus, clock);
    read_all(expected, &mut report, bus, clock);
    report
}

/// Which chips answer; false if nothing else is worth trying.
fn find_chips(report: &mut CheckReport, bus: &mut dyn Bus, clock: &mut dyn Clock) -> bool {
    // A magnetometer behind an MPU-6050 answers once that has its bypass on.
    for address in drivers::GYRO_ADDRESSES {
        let mpu = MPU6050.at(address);
        if mpu.identify(bus).is_ok()
            && let Err(error) = mpu.start(bus, clock)
        {
            report.failed(&error);
        }
    }
    for address in drivers::addresses() {
        match read_byte(bus, address, 0) {
            Ok(_) => report.chips.push(FoundChip {
                address,
                chip: drivers::name(bus, clock, address),
            }),
            Err(error) => match error.cause {
                Cause::NoAnswer => {}
                // If it is in use, reading it will tell who has claimed it.
                Cause::Claimed { .. } | Cause::Busy => report.chips.push(FoundChip {
                    address,
                    chip: "claimed",
                }),
                Cause::NoBus | Cause::Permission => {
                    report.failed(&error.into());
                    return false;
                }
                _ => report.failed(&error.into()),
            },
        }
    }
    true
}

fn test_the_magnetometer(
    expected: &Expected<'_>,
    report: &mut CheckReport,
    bus: &mut dyn Bus,
    clock: &mut dyn Clock,
) {
    let found = match drivers::identify(bus, clock, expected.i2c.magnetometer.named()) {
        Ok(found) => found,
        Err(error) => return report.failed(&error),
    };
    report.magnetometer = Some(FoundMagnetometer {
        kind: found.chip.sheet().name,
        sure: found.sure,
        why: found.why,
    });
    match found.chip.self_test(bus, clock) {
        Ok(Some(test)) => {
            for axis in test.iter().filter(|axis| !axis.passed) {
                report.problem("self_test", axis_sentence(axis));
            }
            report.self_test = test.into();
        }
        Ok(None) => {}
        // Reading it will tell why.
        Err(ChipError::NotReady { .. }) if found.chip.imitation().is_some() => {}
        Err(error) => report.failed(&error),
    }
}

fn axis_sentence(test: &AxisTest) -> String {
    let axis = test.axis;
    let (low, high) = test.limits;
    let right = format!("{:.0} to {:.0} counts are right", low, high);
    match test.measured {
        None => format!(
            "self-test: axis {axis} overflowed; take magnets away; an axis that always overflows is a broken \
             chip, or a board with a wrong strap capacitor (early SparkFun ones)"
        ),
        Some(measured)
            if measured * test.expected < 0.0 && measured.abs() > 0.3 * test.expected.abs() =>
        {
            format!(
                "self-test: axis {axis} measured {measured:.0} counts, the wrong sign ({right}); is it the chip \
                 that i2c.magnetometer says?"
            )
        }
        Some(measured) => format!(
            "self-test: axis {axis} measured {measured:.0} counts of its own field ({right}); is it the chip \
             that i2c.magnetometer says? If so, it is broken, or its strap capacitor is missing"
        ),
    }
}

/// What the chips gave while they were read.
#[derive(Default)]
struct Observed {
    fields: Vec<Vector3<f64>>,
    overflows: usize,
    rates: Vec<Vector3<f64>>,
    forces: Vec<Vector3<f64>>,
}

fn mean(vectors: &[Vector3<f64>]) -> Option<Vector3<f64>> {
    (!vectors.is_empty()).then(|| vectors.iter().sum::<Vector3<f64>>() / vectors.len() as f64)
}

/// Reads all chips as the daemon does.
fn read_all(
    expected: &Expected<'_>,
    report: &mut CheckReport,
    bus: &mut dyn Bus,
    clock: &mut dyn Clock,
) {
    let mut observed = Observed::default();
    let begin_s = clock.now_s() + SETTLING_S;
    let end_s = begin_s + READING_S;
    let mut chips = Chips::new(expected.i2c);
    let mut listen = |event| {
        if let SourceEvent::Reading(reading, _) = event
            && reading.t_s >= begin_s
        {
            observed.fields.extend(reading.whole_field_mgauss());
            observed.overflows += usize::from(reading.field_overflowed());
            observed.rates.extend(reading.rate_rad_s);
            observed.forces.extend(reading.specific_force_m_s2);
        }
        true
    };
    let mut until = Until { clock, end_s };
    chips.run(bus, &mut until, &mut listen);
    for trouble in chips.troubles() {
        report.problem(trouble.code, trouble.message.clone());
    }
    judge(expected, report, &observed);
}

/// A clock that stops at a time of its own.
struct Until<'a> {
    clock: &'a mut dyn Clock,
    end_s: f64,
}

impl Clock for Until<'_> {
    fn now_s(&self) -> f64 {
        self.clock.now_s()
    }

    fn wait_until(&mut self, t_s: f64) -> bool {
        t_s < self.end_s && self.clock.wait_until(t_s)
    }
}

fn judge(expected: &Expected<'_>, report: &mut CheckReport, observed: &Observed) {
    judge_field(expected, report, observed);
    judge_gyro(expected, report, observed);
    if let Some(force) = mean(&observed.forces) {
        let force = expected.mountings.accel.to_body(force);
        report.accel_m_s2 = Some(force.into());
        let strength = force.norm();
        if (strength / STANDARD_GRAVITY_M_S2 - 1.0).abs() > GRAVITY_TOLERANCE {
            report.problem(
                "accel_strength",
                format!(
                    "the accelerometer at rest measures {strength:.1} m/s2, and should measure 9.8; let the board \
                     lie still, and check which chip it is"
                ),
            );
        } else if force.z > 0.5 * STANDARD_GRAVITY_M_S2 {
            report.problem(
                "accel_sign",
                format!(
                    "the accelerometer measures {:+.1} m/s2 on body Z, and a level board -9.8: its signs are wrong \
                     (it reads gravity, not force), or the board lies on its back; check mounting.accel_axes and \
                     i2c.board",
                    force.z
                ),
            );
        }
    }
}

fn judge_field(expected: &Expected<'_>, report: &mut CheckReport, observed: &Observed) {
    if observed.overflows > observed.fields.len() {
        report.problem(
            "overflow",
            "the field is beyond the magnetometer's range; take magnets away, or leave out i2c.gain".to_owned(),
        );
    }
    let Some(field) = mean(&observed.fields) else {
        if observed.overflows == 0 && report.problems.is_empty() {
            report.problem(
                "no_samples",
                format!(
                    "the magnetometer measured no field within {READING_S:.0} s; check it, or set a larger i2c.rate_hz"
                ),
            );
        }
        return;
    };
    let strength = field.norm();
    report.field_mgauss = Some(strength);
    if !EARTH_MGAUSS.contains(&strength) {
        report.problem(
            "field_strength",
            format!(
                "the field has {strength:.0} milligauss, and the Earth's has {WEAKEST_MGAUSS} to {STRONGEST_MGAUSS}; look for \
                 magnets, iron and currents nearby, and check i2c.magnetometer"
            ),
        );
    }
    let rate_hz = (observed.fields.len() + observed.overflows) as f64 / READING_S;
    report.mag_rate_hz = Some(rate_hz);
    // The chip's fastest rate may be slower than the configured one.
    let wanted_hz = expected.i2c.rate_hz.min(50.0);
    if rate_hz < RATE_SHARE * wanted_hz - 1.0 / READING_S {
        report.problem("rate", slow("magnetometer", rate_hz, wanted_hz));
    }
}

fn judge_gyro(expected: &Expected<'_>, report: &mut CheckReport, observed: &Observed) {
    let Some(mean) = mean(&observed.rates) else {
        return;
    };
    let count = observed.rates.len() as f64;
    let square = |rate: &Vector3<f64>| (rate - mean).component_mul(&(rate - mean));
    let variance = observed.rates.iter().map(square).sum::<Vector3<f64>>() / count;
    let noise_deg_s = variance.max().sqrt().to_degrees();
    let mean_deg_s = expected.mountings.gyro.to_body(mean).map(f64::to_degrees);
    report.gyro_deg_s = Some(mean_deg_s.into());
    report.gyro_noise_deg_s = Some(noise_deg_s);
    let rate_hz = count / READING_S;
    report.gyro_rate_hz = Some(rate_hz);
    let limit_deg_s = expected.gyro_bias_limit_deg_s;
    if noise_deg_s > STILL_DEG_S {
        report.problem(
            "not_still",
            format!("the gyro's rate varies by {noise_deg_s:.1} degrees a second; let the board lie still, and check again"),
        );
    } else if mean_deg_s.amax() > limit_deg_s {
        report.problem(
            "gyro_bias",
            format!(
                "the gyro at rest measures {:.1} degrees a second, more than attitude.gyro_bias_limit_deg_s \
                 ({limit_deg_s}); let the board lie still; if it did, raise that limit",
                mean_deg_s.amax()
            ),
        );
    }
    if rate_hz < RATE_SHARE * expected.i2c.gyro_rate_hz {
        report.problem("rate", slow("gyro", rate_hz, expected.i2c.gyro_rate_hz));
    }
}

fn slow(what: &str, rate_hz: f64, wanted_hz: f64) -> String {
    format!(
        "the {what} gave {rate_hz:.1} readings a second of {wanted_hz}; raise the bus clock (400 kHz), or let the \
         machine do less"
    )
}
