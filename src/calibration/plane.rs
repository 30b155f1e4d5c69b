//! Which samples, which mode and which plane a calibration works in.

use std::ops::Range;

use nalgebra::{Matrix3, SymmetricEigen, Unit, Vector3};

use super::model::Mode;
use super::request::{CompletedTurn, FieldSample, Request};
use super::settings::{ModeChoice, Settings, WindowChoice};

/// A rest whose lean differs from the turns' mean by this angle or more, 2.5°, is not compared with them.
const LEVEL_RAD: f64 = 0.044;

/// The plan of one calibration.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Planar or spatial.
    pub mode: Mode,
    /// Planar: the plane's basis in chip axes.
    pub basis: [Vector3<f64>; 2],
    /// The samples to fit: from the start of the first rotation to the end of the last, or all, without a full turn or if `window` is
    /// `all`. In the plane some at either end are left out: see `while_level` and `from_known_tilt`.
    pub samples: Range<usize>,
}

impl Plan {
    /// A sample's components along the axes that are calibrated.
    pub fn project<const D: usize>(&self, sample: &FieldSample) -> [f64; D] {
        std::array::from_fn(|axis| match self.mode {
            Mode::Planar => self.basis[axis].dot(&sample.field_mgauss),
            Mode::Spatial => sample.field_mgauss[axis],
        })
    }
}

/// Chooses mode, plane and samples. `None` if a plane is needed and the gyro shows none.
pub fn plan(request: &Request) -> Option<Plan> {
    let turns = &request.turns;
    let all = request.settings.window == WindowChoice::All;
    let samples = if all || turns.is_empty() {
        0..request.samples.len()
    } else {
        request.moving.clone()
    };
    let axes = turns.iter().map(|turn| turn.axis_body);
    let mode = match request.settings.mode {
        ModeChoice::Spatial => Mode::Spatial,
        ModeChoice::Auto if request.plane.is_none() && show_space(axes, &request.settings) => {
            Mode::Spatial
        }
        ModeChoice::Planar | ModeChoice::Auto => Mode::Planar,
    };
    let basis = match (mode, request.plane) {
        (Mode::Spatial, _) => [Vector3::x(), Vector3::y()],
        (Mode::Planar, Some(basis)) => basis,
        (Mode::Planar, None) => {
            let axis_body = main_axis(turns).or_else(|| rotation_axis(request))?;
            basis_across(&request.mounting.to_chip(axis_body))?
        }
    };
    let samples = match mode {
        Mode::Planar if all => from_known_tilt(request, samples),
        Mode::Planar => from_known_tilt(request, while_level(request, samples)),
        Mode::Spatial => samples,
    };
    Some(Plan {
        mode,
        basis,
        samples,
    })
}

/// Leaves out samples before and after the turns, outward from the first one at which the axis leans further than it did during the
/// turns: a tilt lets the vertical field into their plane.
fn while_level(request: &Request, samples: Range<usize>) -> Range<usize> {
    let turns = || request.turns.iter().map(|turn| &turn.samples);
    let (Some(start), Some(end)) = (
        turns().map(|turn| turn.start.max(samples.start)).min(),
        turns().map(|turn| turn.end.min(samples.end)).max(),
    ) else {
        return samples;
    };
    let Some(axis) = main_axis(&request.turns).filter(|_| start < end) else {
        return samples;
    };
    if start == samples.start && end == samples.end {
        return samples;
    }
    let leaning = leaning(axis);
    let turned: Vec<Vector3<f64>> = request.samples[start..end]
        .iter()
        .filter_map(&leaning)
        .collect();
    let mean: Vector3<f64> = turned.iter().sum();
    // All have the same length, so the dot product falls as the angle grows: no arc cosine for each sample.
    let least = turned
        .iter()
        .map(|axis| axis.dot(&mean))
        .fold(mean.norm(), f64::min);
    let level = |sample: &&FieldSample| leaning(sample).is_none_or(|axis| axis.dot(&mean) >= least);
    let before = request.samples[samples.start..start].iter().rev();
    let after = request.samples[end..samples.end].iter();
    start - before.take_while(level).count()..end + after.take_while(level).count()
}

/// Where a body axis points in the gyro's frame, of each sample with a pose.
fn leaning(axis: Vector3<f64>) -> impl Fn(&FieldSample) -> Option<Vector3<f64>> {
    move |sample| sample.pose.map(|pose| pose.orientation * axis)
}

/// The sample at rest before the turns, and the angle between its axis and their mean axis, radians. `None` where the angle is too large
/// for a comparison.
pub fn level_rest(request: &Request) -> Option<(FieldSample, f64)> {
    let rest = request.rest?;
    let axis = main_axis(&request.turns)?;
    let leaning = leaning(axis);
    let turned = &request.samples[request.moving.clone()];
    let mean: Vector3<f64> = turned.iter().filter_map(&leaning).sum();
    let lean_rad = leaning(&rest)?.angle(&mean);
    (lean_rad < LEVEL_RAD).then_some((rest, lean_rad))
}

/// Leaves out the first samples of a log, of which the tilt is not known yet, unless they are many or no tilt
/// is known at all: a tilt lets the vertical field into the plane.
fn from_known_tilt(request: &Request, samples: Range<usize>) -> Range<usize> {
    let known = |sample: &FieldSample| sample.pose.is_some_and(|pose| pose.vertical_known);
    match request.samples[samples.clone()].iter().position(known) {
        Some(first) if first < samples.len() / 4 => samples.start + first..samples.end,
        _ => samples,
    }
}

/// Whether turns about these axes show the field in space: two of the axes are far enough apart.
pub fn show_space(axes: impl Iterator<Item = Vector3<f64>> + Clone, settings: &Settings) -> bool {
    // Either way round: 0 to 90 degrees.
    let angle_deg = |a: Vector3<f64>, b| a.dot(&b).abs().min(1.0).acos().to_degrees();
    axes.clone().any(|a| {
        let mut others = axes.clone();
        others.any(|b| angle_deg(a, b) >= settings.axes_apart_deg)
    })
}

/// The mean of the turns' axes, whichever way round each was made.
fn main_axis(turns: &[CompletedTurn]) -> Option<Vector3<f64>> {
    let first = turns.first()?.axis_body;
    let sum: Vector3<f64> = turns
        .iter()
        .map(|turn| turn.axis_body * turn.axis_body.dot(&first).signum())
        .sum();
    Unit::try_new(sum, 1e-9).map(Unit::into_inner)
}

/// Without a full turn: the body axis about which the board rotated most.
fn rotation_axis(request: &Request) -> Option<Vector3<f64>> {
    let mut sum = Matrix3::zeros();
    // With an accelerometer the first poses of a log swing to the vertical as it becomes known: that is no
    // rotation of the board.
    let poses = || request.samples.iter().map(|sample| sample.pose);
    let vertical = poses().flatten().any(|pose| pose.vertical_known);
    for pair in request.samples.windows(2) {
        let (Some(from), Some(to)) = (pair[0].pose, pair[1].pose) else {
            continue;
        };
        if from.frame_id == to.frame_id
            && from.vertical_known == vertical
            && to.vertical_known == vertical
        {
            let step = (from.orientation.inverse() * to.orientation).scaled_axis();
            sum += step * step.transpose();
        }
    }
    let eigen = SymmetricEigen::new(sum);
    let largest = eigen.eigenvalues.imax();
    (eigen.eigenvalues[largest] > 1e-6).then(|| eigen.eigenvectors.column(largest).into_owned())
}

/// Two unit vectors that span the plane across `normal`: the chip axis nearest to the plane, projected
/// into it, then normal × first, so that a scale factor an axis still fits. Axes that are as near
/// within two degrees are taken in the order X, Y, Z; the normal is taken to point along the chip axis
/// nearest to it, so that a level board's plane is (X, Y).
fn basis_across(normal: &Vector3<f64>) -> Option<[Vector3<f64>; 2]> {
    let mut normal = Unit::try_new(*normal, 1e-9)?.into_inner();
    if normal[normal.iamax()] < 0.0 {
        normal = -normal;
    }
    let nearest = normal.iter().map(|n| n.abs()).fold(f64::MAX, f64::min) + 2f64.to_radians().sin();
    let axis = (0..3).find(|&axis| normal[axis].abs() <= nearest)?;
    let unit = Vector3::ith(axis, 1.0);
    let first = (unit - normal * normal[axis]).normalize();
    Some([first, normal.cross(&first)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_level_turn_keeps_the_chip_axes() {
        for normal in [Vector3::z(), -Vector3::z()] {
            assert_eq!(basis_across(&normal).unwrap(), [Vector3::x(), Vector3::y()]);
        }
    }

    #[test]
    fn a_tilted_turn_starts_from_the_axis_nearest_to_its_plane() {
        // Tilted about chip X by 20°: X stays in the plane.
        let tilted = Vector3::new(0.0, 20f64.to_radians().sin(), 20f64.to_radians().cos());
        let [first, second] = basis_across(&tilted).unwrap();
        assert!((first - Vector3::x()).norm() < 1e-12);
        assert!((second - tilted.cross(&first)).norm() < 1e-12);
        // Tilted about chip Y: Y is nearer.
        let tilted = Vector3::new(20f64.to_radians().sin(), 0.0, 20f64.to_radians().cos());
        assert!((basis_across(&tilted).unwrap()[0] - Vector3::y()).norm() < 1e-12);
    }

    #[test]
    fn nothing_is_across_no_normal() {
        assert_eq!(basis_across(&Vector3::zeros()), None);
    }
}
