//! Whatever comes in: a reason comes out, never a panic and never a number that is none.

use std::ops::Range;

use headingd::attitude::Pose;
use headingd::calibration::outcome::{Outcome, Verdict};
use headingd::calibration::settings::{ModeChoice, Profile};
use headingd::calibration::{FieldSample, Request, calibrate};
use nalgebra::Vector3;
use proptest::prelude::*;

use super::cases::Case;

/// A clean log's request in a mode, to be spoilt.
fn request(mode: ModeChoice, gyro: bool, reference: Option<f64>) -> Request {
    let mut request = Case::spatial(2.0).log(1).request;
    request.settings.mode = mode;
    (
        request.settings.horizontal_mgauss,
        request.settings.total_mgauss,
    ) = (reference, reference);
    if !gyro {
        request
            .samples
            .iter_mut()
            .for_each(|sample| sample.pose = None);
    }
    request
}

/// Keeps these samples.
fn keep(request: &mut Request, range: Range<usize>) {
    request.samples = request.samples[range].to_vec();
    request.moving = 0..request.samples.len();
    request
        .turns
        .retain(|turn| turn.samples.end <= request.moving.end);
}

/// Calibrates, and holds the outcome to its word.
fn checked(request: &Request) -> Outcome {
    let outcome = calibrate(request);
    assert!(!outcome.reason.is_empty() && !outcome.message.is_empty());
    assert_eq!(
        outcome.verdict == Verdict::Accepted,
        outcome.calibration.is_some()
    );
    let numbers = [
        outcome.residual_mgauss,
        outcome.heading_sd_deg,
        outcome.gyro_rms_deg,
    ];
    let lists = [&outcome.bias_mgauss, &outcome.scale];
    let swarm = outcome.swarm.iter();
    let finite = numbers
        .into_iter()
        .flatten()
        .chain(lists.into_iter().flatten().flatten().copied())
        .chain(swarm.flat_map(|swarm| swarm.bias_mgauss.iter().chain(&swarm.scale).copied()))
        .all(f64::is_finite);
    assert!(finite, "{outcome:?}");
    outcome
}

const MODES: [ModeChoice; 3] = [ModeChoice::Auto, ModeChoice::Planar, ModeChoice::Spatial];

/// Every mode, with a gyro and without.
fn refused(expected: &[&str], spoil: impl Fn(&mut Request)) {
    for mode in MODES {
        for gyro in [true, false] {
            let mut request = request(mode, gyro, None);
            spoil(&mut request);
            let outcome = checked(&request);
            let reason = outcome.reason;
            assert_ne!(outcome.verdict, Verdict::Accepted, "{mode:?} {gyro}");
            assert!(expected.contains(&reason), "{mode:?} {gyro}: {outcome:?}");
        }
    }
}

#[test]
fn too_few_samples() {
    for count in 0..3 {
        refused(&["too_few_samples"], |request| keep(request, 0..count));
    }
}

#[test]
fn a_field_that_never_changes() {
    refused(&["no_motion", "no_plane"], |request| {
        for sample in &mut request.samples {
            sample.field_mgauss = Vector3::new(100.0, -50.0, 300.0);
        }
    });
}

#[test]
fn samples_on_a_line_or_with_a_constant_axis() {
    let way = Vector3::new(0.3, 0.5, 0.8);
    for spoil in [
        &(|field: &mut Vector3<f64>| *field = way * field.x) as &dyn Fn(&mut Vector3<f64>),
        &|field| field.x = 7.0,
        &|field| field.y = 7.0,
    ] {
        for mode in MODES {
            for gyro in [true, false] {
                let mut request = request(mode, gyro, None);
                for sample in &mut request.samples {
                    spoil(&mut sample.field_mgauss);
                }
                let outcome = checked(&request);
                assert_ne!(outcome.verdict, Verdict::Accepted, "{outcome:?}");
            }
        }
    }
}

fn any_field() -> impl Strategy<Value = Vector3<f64>> {
    let number = prop_oneof![
        4 => -500.0..500.0f64,
        1 => -1e6..1e6f64,
        1 => prop_oneof![Just(0.0), Just(1e-300), Just(999_999.0), Just(-999_999.0)],
    ];
    [number.clone(), number.clone(), number].prop_map(Vector3::from)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(150))]

    #[test]
    fn anything_at_all_has_a_reason(
        fields in prop::collection::vec(any_field(), 0..150),
        mode in prop::sample::select(&MODES),
        gyro: bool,
        reference in prop::option::of(1e-3..1e6f64),
        paper: bool,
    ) {
        let mut request = request(mode, gyro, reference);
        let poses: Vec<Option<Pose>> = request.samples.iter().map(|sample| sample.pose).collect();
        request.samples = fields
            .into_iter()
            .zip(poses)
            .enumerate()
            .map(|(i, (field_mgauss, pose))| FieldSample { t_s: i as f64 * 0.025, field_mgauss, pose })
            .collect();
        let count = request.samples.len();
        keep(&mut request, 0..count);
        if paper {
            (request.settings.profile, request.settings.max_iterations) = (Profile::Paper, 50);
        }
        checked(&request);
    }

    #[test]
    fn a_piece_of_a_good_log_has_a_reason(
        start in 0usize..2300,
        count in 0usize..1000,
        stretched in 1e-6..1e3f64,
        mode in prop::sample::select(&MODES),
        gyro: bool,
    ) {
        let mut request = request(mode, gyro, None);
        keep(&mut request, start..(start + count).min(2400));
        request.turns.clear();
        for sample in &mut request.samples {
            sample.field_mgauss *= stretched;
        }
        checked(&request);
    }
}
