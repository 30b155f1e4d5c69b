use super::*;
use crate::calibration::model::Spatial;
use crate::reading::STANDARD_GRAVITY_M_S2;

/// No noise, no gyro bias.
fn perfect(scenario: Scenario) -> Settings {
    Settings {
        scenario,
        noise_mgauss: 0.0,
        gyro_bias_deg_s: [0.0; 3],
        gyro_noise_deg_s: 0.0,
        ..Settings::default()
    }
}

#[test]
fn a_level_board_at_heading_90_sees_the_horizontal_field_to_its_left() {
    // A quarter of a turn, then rest.
    let simulator = Simulator::new(Settings {
        turns: 0.25,
        ..perfect(Scenario::Planar)
    });
    let end_s = simulator.duration_s();
    let field = simulator.true_field_mgauss(end_s);
    assert!((field - Vector3::new(0.0, -162.8, 526.7)).norm() < 1e-9);
    assert_eq!(simulator.heading_deg(end_s), Some(90.0));
    let last = simulator
        .filter(|e| e.reading.field_mgauss.is_some())
        .last();
    // Equation 1 by hand: 87.28; 0.998 · −162.8 + 54.19 = −108.2844; 0.94 · 526.7 + 135 = 630.098;
    // in counts 113.46, −140.77, 819.13.
    assert_eq!(
        last.unwrap().reading.field_mgauss,
        Some([113.0, -141.0, 819.0].map(|n: f64| Some(rounded(n / 1.3, 3))))
    );
}

#[test]
fn the_parameters_take_the_raw_field_back_to_the_true_one() {
    let settings = perfect(Scenario::Spatial);
    let parameters = Spatial::diagonal(settings.bias_mgauss.into(), settings.scale.into());
    let mut simulator = Simulator::new(settings);
    while let Some(entry) = simulator.next() {
        if let Some(raw) = entry.reading.whole_field_mgauss() {
            let corrected = parameters.correct(&raw).unwrap();
            let error = corrected - simulator.true_field_mgauss(entry.reading.t_s);
            // Half a count, 0.385 mG, over the smallest scale.
            assert!(error.amax() < 0.442, "{error}");
        }
    }
}

#[test]
fn the_gyro_says_how_the_attitude_changes() {
    use Scenario::*;
    for scenario in [Planar, Spatial, Free, Demo] {
        let simulator = Simulator::new(perfect(scenario));
        let motion = simulator.motion.clone();
        let mut attitude = nalgebra::UnitQuaternion::identity();
        let mut before = Vector3::zeros();
        for rate in simulator.filter_map(|e| e.reading.rate_rad_s) {
            let step = (rate + before) / 2.0 * 0.01;
            attitude *= nalgebra::UnitQuaternion::from_scaled_axis(step);
            before = rate;
        }
        let apart = attitude.angle_to(&motion.attitude(motion.duration_s));
        assert!(apart.to_degrees() < 0.5, "{scenario:?}: {apart}");
    }
}

#[test]
fn a_level_board_at_rest_reads_minus_9_8_on_z() {
    let settings = Settings::default();
    let rest = Simulator::new(settings).take_while(|e| e.reading.t_s < 3.0);
    let forces: Vec<_> = rest.filter_map(|e| e.reading.specific_force_m_s2).collect();
    let mean = forces.iter().sum::<Vector3<f64>>() / forces.len() as f64;
    assert!(
        (mean - Vector3::new(0.0, 0.0, -STANDARD_GRAVITY_M_S2)).norm() < 0.005,
        "{mean}"
    );
    // Nose up by 30°: forward axis up, so that it reads half of gravity.
    let tilted = Simulator::new(Settings {
        tilt_deg: 30.0,
        ..Settings::default()
    });
    let force = tilted
        .into_iter()
        .next()
        .unwrap()
        .reading
        .specific_force_m_s2;
    assert!((force.unwrap().x - 4.9).abs() < 0.15);
}

#[test]
fn the_chips_tick_apart_and_in_order() {
    let entries: Vec<Entry> = Simulator::new(Settings::default()).collect();
    assert!(entries.is_sorted_by(|a, b| a.reading.t_s < b.reading.t_s));
    for entry in &entries {
        let mag = entry.reading.field_mgauss.is_some();
        assert_eq!(entry.reading.rate_rad_s.is_some(), !mag);
        assert_eq!(entry.heading_truth_deg.is_some(), mag);
    }
    let mag = entries.iter().filter(|e| e.reading.field_mgauss.is_some());
    assert!((mag.count() as i32 - 820).abs() < 5);
    let mag_only = Settings {
        with_gyro: false,
        with_accel: false,
        ..Settings::default()
    };
    let fields = |entries: Vec<Entry>| -> Vec<_> {
        entries
            .iter()
            .filter_map(|e| e.reading.field_mgauss)
            .collect()
    };
    assert_eq!(fields(Simulator::new(mag_only).collect()), fields(entries));
}

#[test]
fn spikes_are_as_many_and_as_high_as_asked_for() {
    let fields = |spikes| -> Vec<Vector3<f64>> {
        let settings = Settings {
            spikes,
            ..Settings::default()
        };
        let entries = Simulator::new(settings).map(|e| e.reading.whole_field_mgauss());
        entries.flatten().collect()
    };
    let (with, without) = (fields(0.2), fields(0.0));
    let spikes: Vec<_> = with.iter().zip(&without).map(|(a, b)| a - b).collect();
    let high = spikes.iter().filter(|s| s.amax() > 0.0).count();
    assert!((100..230).contains(&high), "{high} of {}", spikes.len());
    assert!(
        spikes
            .iter()
            .all(|s| s.amax() == 0.0 || (s.norm() - 200.0).abs() < 0.01)
    );
}

#[test]
fn a_field_beyond_12_bits_overflows_its_axis() {
    let settings = Settings {
        bias_mgauss: [0.0, 1500.0, 0.0],
        ..perfect(Scenario::Planar)
    };
    let entries: Vec<Entry> = Simulator::new(settings).collect();
    let overflow = entries.iter().filter(|e| e.reading.field_overflowed());
    assert!(overflow.count() > 10);
    let largest = entries.iter().filter_map(|e| e.reading.field_mgauss?[1]);
    assert!(largest.fold(0.0, f64::max) <= 2047.0 / 1.3);
}

#[test]
fn a_board_that_points_up_has_no_heading() {
    let steep = Simulator::new(Settings {
        scenario: Scenario::Free,
        ..Settings::default()
    });
    let mag = steep.filter(|e| e.reading.field_mgauss.is_some());
    let (with, without): (Vec<_>, Vec<_>) = mag.partition(|e| e.heading_truth_deg.is_some());
    // But for the rests, its pitch passes all angles evenly: 40° of 360 are too near to the vertical.
    let share = without.len() as f64 / (with.len() + without.len()) as f64;
    assert!((share - 1.0 / 9.0).abs() < 0.02, "{share}");
}
