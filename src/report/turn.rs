//! The samples of the turn that was judged, raw and corrected, whatever the verdict was.

use nalgebra::{Matrix3, Vector3};

use super::analysis::Judged;
use crate::calibration::FieldSample;
use crate::calibration::model::Mode;
use crate::frame::heading_deg;

/// One sample, along the axes that were calibrated: two in the plane of a turn, and then 0, or three in space.
#[derive(Clone, Debug)]
pub(super) struct Seen {
    pub(super) t_s: f64,
    pub(super) raw_mgauss: Vector3<f64>,
    pub(super) corrected_mgauss: Vector3<f64>,
    /// Where the gyro knew the board's attitude.
    pub(super) headings: Option<Headings3>,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Headings3 {
    /// By the gyro, from wherever it began.
    pub(super) gyro: f64,
    /// By the field as it was read.
    pub(super) raw: f64,
    /// By the corrected field.
    pub(super) corrected: f64,
    /// A gap in the gyro's account begins another stretch.
    pub(super) frame_id: u32,
}

pub(super) struct Turned {
    pub(super) samples: Vec<Seen>,
    pub(super) axes: Vec<String>,
}

/// Steeper than this, body X has no useful heading: cosine of 60 degrees to the vertical.
const LEVEL: f64 = 0.5;

impl Turned {
    /// Corrects the samples with what was found; `None` if nothing was.
    pub(super) fn of(judged: &Judged) -> Option<Self> {
        let outcome = &judged.outcome;
        let bias = padded(outcome.bias_mgauss.as_ref()?, 0.0);
        let scale = padded(outcome.scale.as_ref()?, 1.0);
        let basis: Vec<Vector3<f64>> = match (outcome.mode?, outcome.basis) {
            (Mode::Planar, Some(basis)) => basis.map(Vector3::from).into(),
            _ => vec![Vector3::x(), Vector3::y(), Vector3::z()],
        };
        let inverse = match outcome.matrix {
            Some(rows) => Matrix3::from_row_slice(&rows).try_inverse()?,
            None => Matrix3::from_diagonal(&scale.map(f64::recip)),
        };
        let axes = basis.iter().enumerate().map(|(index, axis)| {
            match axis.iter().position(|part| part.abs() > 0.999) {
                Some(axis) => format!("chip axis {}", ["X", "Y", "Z"][axis]),
                None => format!("axis {} of the turn's plane", index + 1),
            }
        });
        let (all, turns) = (&judged.request.samples, &judged.request.turns);
        let start = turns.iter().map(|turn| turn.samples.start).min();
        let end = turns.iter().map(|turn| turn.samples.end).max();
        let samples = all.get(start.unwrap_or(0)..end.unwrap_or(all.len()))?;
        let seen = samples.iter().map(|sample| {
            let along = |axis: &Vector3<f64>| axis.dot(&sample.field_mgauss);
            let raw = Vector3::from_fn(|index, _| basis.get(index).map_or(0.0, along));
            let corrected = inverse * (raw - bias);
            let parts = basis.iter().zip(&corrected);
            let field: Vector3<f64> = parts.map(|(axis, part)| axis * *part).sum();
            Seen {
                t_s: sample.t_s,
                headings: headings(judged, sample, field),
                raw_mgauss: raw,
                corrected_mgauss: corrected,
            }
        });
        Some(Self {
            samples: seen.collect(),
            axes: axes.collect(),
        })
    }
}

/// Parts along the axes that were calibrated, and `rest` along the others.
fn padded(parts: &[f64], rest: f64) -> Vector3<f64> {
    Vector3::from_fn(|axis, _| parts.get(axis).copied().unwrap_or(rest))
}

fn headings(judged: &Judged, sample: &FieldSample, corrected: Vector3<f64>) -> Option<Headings3> {
    let pose = sample.pose?;
    let forward = pose.orientation * Vector3::x();
    if forward.z.abs() > LEVEL {
        return None;
    }
    // The frame's Z points up, so that it counts counter-clockwise.
    let down = pose.orientation.inverse_transform_vector(&-Vector3::z());
    let mounting = &judged.request.mounting;
    Some(Headings3 {
        gyro: -forward.y.atan2(forward.x).to_degrees(),
        raw: heading_deg(&mounting.to_body(sample.field_mgauss), &down)?,
        corrected: heading_deg(&mounting.to_body(corrected), &down)?,
        frame_id: pose.frame_id,
    })
}
