use nalgebra::UnitQuaternion;

use super::measure::MOST_MATRIX;
use super::*;
use crate::attitude::{Attitude, Settings, TICK_S};
use crate::frame::Mountings;

/// A filter that knows nothing yet of a gyro with a bias of up to 0.17 rad/s (10°/s).
fn new() -> GyroErrors {
    GyroErrors::new(0.17)
}

/// The filter after it has followed a gyro with this bias and matrix for so long, on a board that turns at `rate` and is shaken
/// with `shake`, m/s², earth axes, which may depend on how it lies.
fn learnt(
    mut errors: GyroErrors,
    seconds: f64,
    bias: Vector3<f64>,
    matrix: Matrix3<f64>,
    rate: impl Fn(f64) -> Vector3<f64>,
    shake: impl Fn(f64, &UnitQuaternion<f64>) -> Vector3<f64>,
) -> GyroErrors {
    let (mut truth, mut frame) = (UnitQuaternion::identity(), UnitQuaternion::identity());
    for i in 0..(seconds / TICK_S) as u32 {
        let t_s = f64::from(i) * TICK_S;
        let turn = rate(t_s);
        let read = turn + matrix * turn + bias;
        let corrected = errors.corrected(&read);
        let step = UnitQuaternion::from_scaled_axis(corrected * TICK_S);
        truth *= UnitQuaternion::from_scaled_axis(turn * TICK_S);
        let felt = Vector3::z() * GRAVITY_M_S2 + shake(t_s, &truth);
        let force = truth.inverse_transform_vector(&felt);
        let middle = frame * step.powf(0.5);
        frame *= step;
        let to_frame = middle.to_rotation_matrix().into_inner();
        let force = errors.corrected_force(&force);
        errors.take(&to_frame, &corrected, Some(&force), false);
    }
    errors
}

fn tumbling(t_s: f64) -> Vector3<f64> {
    Vector3::new(
        (0.9 * t_s).sin(),
        (1.3 * t_s).sin(),
        (0.7 * t_s).cos() + 0.2,
    )
}

/// A hand's: decimetres to and fro.
fn shaken(t_s: f64, _: &UnitQuaternion<f64>) -> Vector3<f64> {
    Vector3::new((4.1 * t_s).sin(), (5.3 * t_s).sin(), (3.7 * t_s).sin()) * 1.5
}

#[test]
fn a_tumbling_board_shows_bias_scale_and_cross_axis_errors() {
    let bias = Vector3::new(0.05, -0.04, 0.06);
    let matrix = Matrix3::new(0.02, 0.01, -0.015, -0.01, -0.02, 0.01, 0.015, -0.01, 0.015);
    let errors = learnt(new(), 90.0, bias, matrix, tumbling, shaken);
    let bias_off = (errors.bias - bias).norm();
    let matrix_off = (errors.matrix - matrix).norm() / matrix.norm();
    assert!(bias_off < 0.003, "{bias_off}");
    assert!(matrix_off < 0.35, "{matrix_off}");
    let claimed = errors.bias_sd_rad_s();
    // The claim allows for jitter of the times, which there is none of here.
    assert!(
        (0.05..2.5).contains(&(bias_off / (claimed * 3f64.sqrt()))),
        "{claimed}"
    );
}

/// How far the accelerometer's bias is off, m/s², that is learnt in two minutes in which a hand turns the board about its wrist.
fn force_bias_off(bias: Vector3<f64>) -> f64 {
    let arm = Vector3::new(0.1, -0.05, 0.08);
    let pushed = |t_s: f64, truth: &UnitQuaternion<f64>| {
        let rate = tumbling(t_s);
        let acceleration = (tumbling(t_s + TICK_S) - rate) / TICK_S;
        truth * (acceleration.cross(&arm) + rate.cross(&rate.cross(&arm)) + bias)
    };
    let none = Matrix3::zeros();
    let errors = learnt(new(), 120.0, Vector3::zeros(), none, tumbling, pushed);
    (errors.force_bias - bias).norm()
}

#[test]
fn a_tumbling_board_shows_the_accelerometers_bias_but_does_not_take_its_turning_for_one() {
    let off = force_bias_off(Vector3::new(0.3, -0.2, 0.25));
    assert!(off < 0.08, "{off}");
    let off = force_bias_off(Vector3::zeros());
    assert!(off < 0.08, "{off}");
}

/// A board that is taken up from a table has been upright until then: it must not count as one that stays so.
#[test]
fn a_board_that_begins_to_tumble_shows_its_bias_at_once() {
    let rate = |t_s: f64| {
        let level = Vector3::new(0.1, -0.1, 0.5);
        if t_s < 20.0 { level } else { tumbling(t_s) }
    };
    let bias = Vector3::new(-0.08, 0.04, 0.075);
    let errors = learnt(new(), 35.0, bias, Matrix3::zeros(), rate, shaken);
    let off = (errors.bias - bias).norm();
    assert!(off < 0.01, "{off}");
}

/// A boat's roll moves it sideways at the same time, which looks like a bias about the vertical.
#[test]
fn a_board_that_stays_upright_does_not_take_its_sway_for_a_bias() {
    let bias = Vector3::new(0.01, -0.01, 0.03);
    let roll = |t_s: f64| Vector3::x() * (0.25 * (1.2 * t_s).cos() * 1.2);
    let sway = |t_s: f64, _: &_| Vector3::new((1.2 * t_s).cos(), (1.2 * t_s).sin(), 0.0) * 0.5;
    let errors = learnt(new(), 300.0, bias, Matrix3::zeros(), roll, sway);
    let across = (errors.bias - bias).xy().norm();
    assert!(across < 0.003, "{across}");
    assert!(errors.bias.z.abs() < 0.01, "{}", errors.bias.z);
    assert_eq!(errors.force_bias, Vector3::zeros());
}

/// A bias of 6°/s that is taken for certain turns gravity away, which looks like an acceleration that never ends.
#[test]
fn a_filter_that_is_surely_wrong_begins_anew() {
    let mut errors = new();
    errors.bias = Vector3::new(0.0, 0.0, 0.1);
    reset_variance(&mut errors.p, B..B + 3, 1e-8);
    let right = Vector3::new(0.01, -0.01, 0.02);
    let errors = learnt(errors, 180.0, right, Matrix3::zeros(), tumbling, shaken);
    let off = (errors.bias - right).norm();
    assert!(off < 0.003, "{off}");
    assert_eq!(errors.gyro_bias().begun_anew, 1);
}

#[test]
fn a_renewed_attitude_keeps_the_doubts_and_counts_the_restart() {
    let (settings, mountings) = (Settings::default(), Mountings::default());
    let mut attitude = Attitude::new(&settings, &mountings);
    for begun_anew in 0..3 {
        let bias = attitude.state(0.0).gyro_bias;
        assert_eq!(
            (bias.begun_anew, bias.doubted2),
            (begun_anew, 0.25 * f64::from(begun_anew))
        );
        assert_eq!(attitude.filter.frame_id, begun_anew);
        attitude.filter.errors.doubt_bias(0.5);
        attitude.renew(&settings, &mountings);
    }
}

#[test]
fn what_no_gyro_has_is_not_taken_out() {
    let matrix = Matrix3::from_diagonal_element(-2.0);
    let errors = learnt(new(), 30.0, Vector3::zeros(), matrix, tumbling, shaken);
    assert!(errors.matrix.amax() <= MOST_MATRIX);
    assert!(errors.bias.amax() <= 0.17);
}
