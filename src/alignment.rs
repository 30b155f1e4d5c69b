//! How the chips lie to each other, found from a recorded motion.
//!
//! The gyro measures how the board turns. The earth's field and gravity stand still, so that what magnetometer and accelerometer
//! read must turn the other way: that tells which of their axes is which of the gyro's, and the small rotation beside that.
//! A motion does not tell how all chips are turned together: the accelerometer shows where down was, but nothing shows which way is
//! ahead.

mod carried;
mod solve;

use std::cmp::Ordering;

use nalgebra::{Matrix3, Vector3};

use crate::frame::Mounting;
use crate::reading::{HELD_S, Reading};
use carried::{Carried, KNOT_S, pairs};
use solve::{FoundAxes, SensorData, axes, cost, refine};

/// Fewer pairs of attitudes 30° apart tell nothing.
const FEWEST_PAIRS: usize = 8;
/// Where the best axes leave more than this share of a vector unexplained, it does not turn with the gyro at all.
const UNRELATED: f64 = 0.4;
/// The best axes leave at most this share of what the second best leave, or the motion does not tell the two apart.
const CLEAR: f64 = 0.6;
/// A dip within this (a sine: 12°) does not tell up from down.
const LEVEL_FIELD: f64 = 0.2;
/// At the beginning the board lies upright for this long, seconds.
const UPRIGHT_S: f64 = 1.0;

/// One chip beside the gyro.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChipAlignment {
    /// The chip's axes along the body's, as three signed axes.
    pub axes: Mounting,
    /// The mounting as found: these axes and a small rotation.
    pub exact: Mounting,
    /// That small rotation about the body's axes, degrees.
    pub turn_deg: [f64; 3],
    /// Standard deviation of `turn_deg`, about each axis.
    pub turn_sd_deg: [f64; 3],
}

/// What was found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Alignment {
    /// The gyro's signed axes; the others are found against it.
    pub gyro: Mounting,
    /// The magnetometer, if the log has one.
    pub mag: Option<ChipAlignment>,
    /// The accelerometer, if the log has one: it shows where down was at the beginning.
    pub accel: Option<ChipAlignment>,
    /// What the accelerometer reads.
    pub accel_reads: AccelerometerReads,
}

/// What an accelerometer reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AccelerometerReads {
    /// Specific force, which points up at rest: the field then dips as it should here.
    Force,
    /// Gravity: taken for specific force, the field would dip the wrong way.
    Gravity,
    /// Not known, for want of a field that points up or down; taken for specific force.
    Unknown,
}

/// Why nothing was found, each with a code for programs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum AlignmentError {
    /// There is no gyro, or nothing beside it.
    #[error(
        "the log needs readings of a gyro, and of a magnetometer or an accelerometer beside it (no_sensors)"
    )]
    NoSensors,
    /// The board has hardly turned.
    #[error(
        "the board hardly turns: turn it by 90 degrees and back about each of its three axes, for half a minute (little_motion)"
    )]
    LittleMotion,
    /// The gyro counts turns the wrong way round.
    #[error(
        "the gyro's axes are mirrored: field or gravity turn opposite to what it reads; whatever wrote the log has one or all \
         three of the gyro's signs wrong, or two of its axes exchanged (gyro_mirrored)"
    )]
    GyroMirrored,
    /// What this chip reads does not turn with the gyro.
    #[error(
        "what the {0} reads does not turn with the gyro: check its unit and wiring, and keep magnets away (unrelated)"
    )]
    Unrelated(&'static str),
    /// The motion does not tell this chip's axes.
    #[error(
        "the motion does not tell the axes of the {0}: turn the board about each of its three axes in one log; if you did, check the units (ambiguous)"
    )]
    Ambiguous(&'static str),
}

/// Finds how the chips lie, from readings in the order of time. `dips_down`: whether the field points into the ground, as
/// north of the magnetic equator.
///
/// # Errors
///
/// What is missing, or wrong with the chips.
pub fn align(readings: &[Reading], dips_down: bool) -> Result<Alignment, AlignmentError> {
    let field = samples(readings, Reading::whole_field_mgauss);
    let force = samples(readings, |reading| reading.specific_force_m_s2);
    let gyro = readings.iter().any(|reading| reading.rate_rad_s.is_some());
    if !gyro || field.is_empty() && force.is_empty() {
        return Err(AlignmentError::NoSensors);
    }
    let mag = VectorSensor {
        name: "magnetometer",
        samples: field,
        // Hard iron may have any size.
        offset_sd: 1000.0,
        half_window_s: 0.5 * KNOT_S,
    };
    let accel = VectorSensor {
        name: "accelerometer",
        samples: force,
        offset_sd: 0.5,
        // A mean over two seconds hardly feels the shaking of hands.
        half_window_s: 1.0,
    };
    let mut mag_found = mag.find(readings)?;
    let mut accel_found = accel.find(readings)?;
    let bias = refine_all(
        readings,
        [(&accel, &mut accel_found), (&mag, &mut mag_found)],
    )?;
    let carried = Carried::new(readings, &bias, 1.0);
    let vectors = |sensor: &VectorSensor, found: &Option<FoundAxes>| match found {
        Some(found) => sensor.vectors(&carried, found),
        None => Vec::new(),
    };
    let (fields, forces) = (vectors(&mag, &mag_found), vectors(&accel, &accel_found));
    let accel_reads = accelerometer_reads(&fields, &forces, dips_down);
    let upward = match accel_reads {
        AccelerometerReads::Gravity => -1.0,
        _ => 1.0,
    };
    let body = upright(&(force_at_first(&forces) * upward));
    Ok(Alignment {
        gyro: Mounting::from_matrix(body).unwrap_or_default(),
        mag: mag_found.and_then(|found| ChipAlignment::of(&found, &body, 1.0)),
        accel: accel_found.and_then(|found| ChipAlignment::of(&found, &body, upward)),
        accel_reads,
    })
}

/// Refines the axes found, and returns the gyro's bias. Both are found together, and a better bias makes the axes more exact. The last
/// sensor's bias is used: the magnetometer must come last.
fn refine_all(
    readings: &[Reading],
    mut sensors: [(&VectorSensor, &mut Option<FoundAxes>); 2],
) -> Result<Vector3<f64>, AlignmentError> {
    let mut bias = Vector3::zeros();
    for _ in 0..2 {
        let carried = Carried::new(readings, &bias, 1.0);
        let mut more = Vector3::zeros();
        for (sensor, found) in &mut sensors {
            if let Some(found) = found {
                *found = refine(&sensor.data(&carried), found)
                    .ok_or(AlignmentError::Ambiguous(sensor.name))?;
                more = found.bias_rad_s;
            }
        }
        bias += more;
    }
    Ok(bias)
}

/// Sum of the forces in the first [`UPRIGHT_S`], in which the board lies upright.
fn force_at_first(forces: &[(f64, Vector3<f64>)]) -> Vector3<f64> {
    let until_s = forces.first().map_or(0.0, |(t_s, _)| t_s + UPRIGHT_S);
    let first = forces.iter().take_while(|(t_s, _)| *t_s <= until_s);
    first.map(|(_, force)| force).sum()
}

impl ChipAlignment {
    /// The alignment of a chip found in gyro axes; `body` takes gyro axes to body axes.
    fn of(found: &FoundAxes, body: &Matrix3<f64>, sign: f64) -> Option<Self> {
        let mounting = |matrix: Matrix3<f64>| Mounting::from_matrix(matrix * sign);
        let turn_sd = body * found.turn_sd_rad;
        Some(Self {
            axes: mounting(body * found.axes)?,
            exact: mounting(body * found.rotation)?,
            turn_deg: (body * found.turn_rad).map(f64::to_degrees).into(),
            turn_sd_deg: turn_sd.map(|sd| sd.abs().to_degrees()).into(),
        })
    }
}

/// A sensor that reads a vector which stands still in the world.
struct VectorSensor {
    name: &'static str,
    samples: Vec<(f64, Vector3<f64>)>,
    offset_sd: f64,
    half_window_s: f64,
}

impl VectorSensor {
    /// What it reads, with the gyro's account of the motion.
    fn data(&self, carried: &Carried) -> SensorData {
        let seen = carried.means(&self.samples, self.half_window_s);
        SensorData {
            pairs: pairs(&seen, 2.0 * self.half_window_s),
            seen,
            offset_sd: self.offset_sd,
        }
    }

    /// The best of all axes; `None` without samples.
    fn find(&self, readings: &[Reading]) -> Result<Option<FoundAxes>, AlignmentError> {
        if self.samples.is_empty() {
            return Ok(None);
        }
        let candidates = axes();
        let costs = [1.0, -1.0].map(|sense| {
            let data = self.data(&Carried::new(readings, &Vector3::zeros(), sense));
            let costs: Vec<f64> = candidates.iter().map(|axes| cost(&data, axes)).collect();
            (data.pairs.len(), costs)
        });
        let [(count, costs), (_, mirrored)] = costs;
        if count < FEWEST_PAIRS {
            return Err(AlignmentError::LittleMotion);
        }
        let mut order: Vec<usize> = (0..candidates.len()).collect();
        order.sort_by(|&a, &b| costs[a].total_cmp(&costs[b]));
        let (best, second) = (costs[order[0]], costs[order[1]]);
        let mirrored = mirrored.into_iter().fold(f64::INFINITY, f64::min);
        if mirrored < CLEAR * best {
            return Err(AlignmentError::GyroMirrored);
        }
        if best > UNRELATED {
            return Err(AlignmentError::Unrelated(self.name));
        }
        if best > CLEAR * second {
            return Err(AlignmentError::Ambiguous(self.name));
        }
        Ok(Some(FoundAxes::new(candidates[order[0]])))
    }

    /// The vector at each knot with its time, gyro axes.
    fn vectors(&self, carried: &Carried, found: &FoundAxes) -> Vec<(f64, Vector3<f64>)> {
        let seen = carried.means(&self.samples, self.half_window_s);
        seen.iter()
            .map(|(knot, mean)| (knot.t_s, mean.at(&found.matrix, &found.offset)))
            .collect()
    }
}

/// The samples of a sensor. A value that the source repeats until there is a new one counts once: it is out of date.
fn samples(
    readings: &[Reading],
    of: impl Fn(&Reading) -> Option<Vector3<f64>>,
) -> Vec<(f64, Vector3<f64>)> {
    let sample = |reading: &Reading| Some((reading.t_s, of(reading)?));
    let mut samples: Vec<_> = readings.iter().filter_map(sample).collect();
    samples.dedup_by(|next, kept| next.1 == kept.1 && next.0 - kept.0 < HELD_S);
    samples
}

/// By which way the field points, if it points up or down clearly enough.
fn accelerometer_reads(
    fields: &[(f64, Vector3<f64>)],
    forces: &[(f64, Vector3<f64>)],
    dips_down: bool,
) -> AccelerometerReads {
    let sines: Vec<f64> = fields
        .iter()
        .filter_map(|(t_s, field)| {
            let at = forces.binary_search_by(|(force_s, _)| force_s.total_cmp(t_s));
            let (_, force) = forces[at.ok()?];
            // A field or force of zero has no direction.
            Some(-field.try_normalize(0.0)?.dot(&force.try_normalize(0.0)?))
        })
        .collect();
    let mean = sines.iter().sum::<f64>() / sines.len().max(1) as f64;
    match mean {
        mean if mean.abs() < LEVEL_FIELD => AccelerometerReads::Unknown,
        mean if (mean > 0.0) == dips_down => AccelerometerReads::Force,
        _ => AccelerometerReads::Gravity,
    }
}

/// The rotation from the gyro's axes to the body's that levels the board: of several, the smallest; of those, the one that leaves X most
/// nearly ahead. The identity where up is not known.
fn upright(up: &Vector3<f64>) -> Matrix3<f64> {
    let score = |body: &Matrix3<f64>| [-(body * up).z, body.trace(), body.m11];
    let better = |a: &Matrix3<f64>, b: &Matrix3<f64>| {
        score(a).partial_cmp(&score(b)).unwrap_or(Ordering::Equal)
    };
    if up.norm() < 1e-9 {
        return Matrix3::identity();
    }
    axes()
        .into_iter()
        .max_by(better)
        .unwrap_or_else(Matrix3::identity)
}
