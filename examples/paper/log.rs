//! The logs of the paper's tests, made again: its parameters in Equation 1, its field, its sample rate.
//!
//! The paper gives neither its noise nor how long the board rested. Here: 2 mG on each axis, whole counts
//! of an HMC5843 at its default gain, and as much rest as makes Test1 of Figure 7 1240 samples.

use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::ops::Range;

use nalgebra::{UnitQuaternion, Vector3};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_xoshiro::Xoshiro256PlusPlus;

use super::published::{Column, HORIZONTAL_MGAUSS, TOTAL_MGAUSS};
use headingd::attitude::Pose;
use headingd::calibration::model::Mode;
use headingd::calibration::settings::Settings;
use headingd::calibration::{CompletedTurn, FieldSample, Request, verdict};
use headingd::frame::Mounting;

const RATE_HZ: f64 = 40.0;
/// Samples in one turn: 7 s.
const TURN: usize = 280;
/// Samples at rest before and after: with two turns, 1240 in all.
const REST: usize = 340;
/// Samples between two turns of a spatial test, while the board is taken up anew.
const BETWEEN: usize = 80;
const NOISE_MGAUSS: f64 = 2.0;
/// HMC5843 data sheet, default gain.
const COUNTS_PER_MGAUSS: f64 = 1.3;

/// The request to calibrate on one of the paper's tests. The same seed gives the same samples.
///
/// Planar: two level turns. Spatial: a turn about the vertical, then about horizontal axes: body X heading
/// east, and body Y heading north. The paper speaks of one horizontal axis and of a device "moved freely in
/// the space". With one, its own field of 170 in 560 mG would leave the parameters of that axis ten times as
/// uncertain as the others; its tables, where all axes agree alike, say that it saw more.
pub fn request(mode: Mode, truth: &Column, seed: u64, settings: &Settings) -> Request {
    let turn = |start: usize| start..start + TURN;
    let axes = match mode {
        Mode::Planar => vec![Vector3::z_axis(); 2],
        Mode::Spatial => vec![Vector3::z_axis(), Vector3::x_axis(), Vector3::y_axis()],
    };
    let between = if mode == Mode::Planar { 0 } else { BETWEEN };
    let turns: Vec<Range<usize>> = (0..axes.len())
        .map(|k| turn(REST + k * (TURN + between)))
        .collect();
    let end = turns[turns.len() - 1].end;
    let attitude = |index: usize| {
        let mut attitude = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), FRAC_PI_2);
        if let [_, second, third] = &turns[..] {
            let back = -FRAC_PI_2 * made(index, &(second.end..third.start));
            attitude *= UnitQuaternion::from_axis_angle(&Vector3::z_axis(), back);
        }
        for (turn, axis) in turns.iter().zip(&axes) {
            attitude *= UnitQuaternion::from_axis_angle(axis, TAU * made(index, turn));
        }
        attitude
    };
    let vertical_mgauss = (TOTAL_MGAUSS.powi(2) - HORIZONTAL_MGAUSS.powi(2)).sqrt();
    // Body axes as seen from a level board heading north.
    let field_mgauss = Vector3::new(HORIZONTAL_MGAUSS, 0.0, vertical_mgauss);
    let mut noise = Xoshiro256PlusPlus::seed_from_u64(seed);
    let samples = (0..end + REST)
        .map(|index| {
            let turned = attitude(index);
            let seen = turned.inverse_transform_vector(&field_mgauss);
            let raw = Vector3::from_fn(|axis, _| {
                let normal: f64 = StandardNormal.sample(&mut noise);
                let raw = truth.scale[axis] * seen[axis] + truth.bias_mgauss[axis];
                counted(raw + NOISE_MGAUSS * normal)
            });
            FieldSample {
                t_s: index as f64 / RATE_HZ,
                field_mgauss: raw,
                pose: Some(pose(turned)),
            }
        })
        .collect();
    let settings = Settings {
        horizontal_mgauss: Some(HORIZONTAL_MGAUSS),
        total_mgauss: Some(TOTAL_MGAUSS),
        ..settings.clone()
    };
    let turns = turns.iter().zip(&axes);
    let turns = turns.map(|(samples, axis)| CompletedTurn {
        samples: samples.clone(),
        axis_body: axis.into_inner(),
    });
    Request {
        samples,
        moving: REST..end,
        rest: None,
        turns: turns.collect(),
        plane: None,
        mounting: Mounting::default(),
        settings,
        limits: verdict::Limits::default(),
    }
}

/// How much of a movement at constant rate has been made: 0 to 1.
fn made(index: usize, during: &Range<usize>) -> f64 {
    let since = index.clamp(during.start, during.end) - during.start;
    since as f64 / during.len().max(1) as f64
}

/// Poses have Z up, and the board's points down.
fn pose(turned: UnitQuaternion<f64>) -> Pose {
    let flip = UnitQuaternion::from_scaled_axis(Vector3::x() * PI);
    Pose {
        orientation: flip * turned,
        vertical_known: true,
        frame_id: 0,
    }
}

fn counted(mgauss: f64) -> f64 {
    (mgauss * COUNTS_PER_MGAUSS).round() / COUNTS_PER_MGAUSS
}
