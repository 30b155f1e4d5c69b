use super::*;

/// What is frozen after a row with this field and this rate.
fn take(
    watch: &mut FrozenWatch,
    t_s: f64,
    field: [f64; 3],
    rate_rad_s: Vector3<f64>,
) -> Option<Frozen> {
    let reading = Reading {
        t_s,
        field_mgauss: Some(field.map(Some)),
        rate_rad_s: Some(rate_rad_s),
        specific_force_m_s2: None,
    };
    watch.take(&reading, &Mountings::default())
}

/// Rows at 50 Hz of a board that turns about Z at this rate while `turns` says so, as it is read out.
fn board(
    seconds: f64,
    deg_s: impl Fn(f64) -> f64,
    field: impl Fn(f64, f64) -> [f64; 3],
    rate: impl Fn(f64, f64) -> f64,
) -> Vec<(f64, Option<Frozen>)> {
    let (mut watch, mut heading) = (FrozenWatch::default(), 0.0_f64);
    (0..(seconds * 50.0) as u32)
        .map(|i| {
            let t_s = f64::from(i) * 0.02;
            heading += deg_s(t_s).to_radians() * 0.02;
            let rate = Vector3::new(0.01, 0.02, rate(t_s, deg_s(t_s)).to_radians());
            (t_s, take(&mut watch, t_s, field(t_s, heading), rate))
        })
        .collect()
}

/// What is frozen at this time.
fn at(found: &[(f64, Option<Frozen>)], t_s: f64) -> Option<Frozen> {
    found.iter().find(|row| row.0 >= t_s).unwrap().1
}

fn right(_: f64, heading: f64) -> [f64; 3] {
    [160.0 * heading.cos() + 90.0, -160.0 * heading.sin(), 520.0]
}

/// In steps of 10 mG.
fn coarse(t_s: f64, heading: f64) -> [f64; 3] {
    right(t_s, heading).map(|axis| (axis / 10.0).round() * 10.0)
}

fn told(_: f64, deg_s: f64) -> f64 {
    deg_s
}

#[test]
fn a_magnetometer_that_stands_still_in_a_turn_is_frozen_until_it_moves() {
    let turns = |t_s: f64| if t_s > 5.0 { 60.0 } else { 0.0 };
    let stuck = |t_s, heading| {
        let stuck = (6.0..9.0).contains(&t_s);
        right(t_s, if stuck { 1.0 } else { heading })
    };
    let found = board(12.0, turns, stuck, told);
    let frozen = [6.3, 6.7, 8.9, 9.05].map(|t_s| at(&found, t_s));
    let magnetometer = Some(MAGNETOMETER);
    assert_eq!(frozen, [None, magnetometer, magnetometer, None]);
    // At rest it is still frozen.
    let halts = |t_s: f64| if (5.0..7.0).contains(&t_s) { 60.0 } else { 0.0 };
    let stuck = |t_s: f64, heading| right(t_s, if t_s > 6.0 { 1.0 } else { heading });
    assert_eq!(board(9.0, halts, stuck, told)[440].1, magnetometer);
}

#[test]
fn a_gyro_that_turns_on_and_on_while_the_field_stands_still_is_frozen() {
    let stuck = |t_s: f64, _| if (4.0..9.0).contains(&t_s) { 45.0 } else { 0.0 };
    let wavers = |t_s: f64, _| [100.0 + (50.0 * t_s).sin(), 0.0, 500.0];
    let found = board(12.0, |_| 0.0, wavers, stuck);
    let frozen = [5.0, 8.9, 9.05].map(|t_s| at(&found, t_s));
    assert_eq!(frozen, [None, Some(GYRO), None]);
}

/// A number from -1 to 1, another at each time.
fn noise(t_s: f64) -> f64 {
    (t_s * 977.0).sin()
}

/// A turn that is slower than a bias may be, after 10 s of rest. The fastest is told sooner: with its bias it is fast.
#[test]
fn a_magnetometer_that_stands_still_in_a_slow_turn_is_frozen() {
    let noisy = |t_s: f64, heading| right(t_s, heading).map(|axis| axis + 2.0 * noise(t_s));
    let stuck = |t_s: f64, heading| noisy(t_s.min(8.0), if t_s > 8.0 { 0.0 } else { heading });
    for deg_s in [2.0, 5.0, 15.0] {
        let turns = |t_s: f64| if t_s > 10.0 { deg_s } else { 0.0 };
        let rate = |t_s: f64, deg_s: f64| deg_s + 8.0 + noise(t_s);
        let first =
            |found: Vec<(f64, Option<Frozen>)>| found.into_iter().find(|row| row.1.is_some());
        let (told_s, what) = first(board(40.0, turns, stuck, rate)).unwrap();
        assert_eq!(what, Some(MAGNETOMETER));
        let turned_deg = (told_s - 10.0) * deg_s;
        assert!((19.0..45.0).contains(&turned_deg), "{deg_s}: {turned_deg}");
        assert_eq!(first(board(40.0, turns, noisy, rate)), None);
    }
}

/// The board coasts on after the gyro has frozen.
#[test]
fn a_gyro_that_stands_still_before_the_board_does_is_frozen() {
    let turns = |t_s: f64| if (5.0..8.0).contains(&t_s) { 45.0 } else { 0.0 };
    let noisy = |t_s: f64, heading| right(t_s, heading).map(|axis| axis + 2.0 * noise(t_s));
    let rate = |t_s: f64, deg_s| if t_s < 7.0 { deg_s + noise(t_s) } else { 45.0 };
    let found = board(20.0, turns, noisy, rate);
    assert_eq!(at(&found, 13.0), Some(GYRO));
}

#[test]
fn a_bias_that_changed_in_long_motion_is_no_turn() {
    let turns = |t_s: f64| {
        let moves = (10.0..130.0).contains(&t_s);
        if moves { 30.0 * (0.5 * t_s).sin() } else { 0.0 }
    };
    let rate = |t_s: f64, deg_s| deg_s + if t_s < 70.0 { 1.0 } else { 3.5 };
    let found = board(200.0, turns, coarse, rate);
    assert!(found.iter().all(|row| row.1.is_none()));
}

#[test]
fn coarse_and_noise_free_boards_are_well_at_rest_and_on_a_turntable() {
    for deg_s in [0.0, 0.5, 1.0, 3.0, 10.0, 25.0, 51.4, 400.0] {
        for bias in [0.0, 9.0] {
            for until_s in [20.0, 99.0] {
                let turns = |t_s| if t_s < until_s { deg_s } else { 0.0 };
                let found = board(60.0, turns, coarse, |_, deg_s| deg_s + bias);
                assert!(found.iter().all(|row| row.1.is_none()), "{deg_s}, {bias}");
            }
        }
    }
}

/// A magnetometer of 10 Hz whose last value stands in every row at 500 Hz.
#[test]
fn a_value_that_is_repeated_until_the_next_is_not_frozen() {
    let mut watch = FrozenWatch::default();
    for i in 0..5000u32 {
        let t_s = f64::from(i) * 0.002;
        let field = right(t_s, f64::from(i / 50) * 0.3);
        let rate = Vector3::z() * (3.0 + 0.01 * f64::from(i % 3));
        assert_eq!(take(&mut watch, t_s, field, rate), None);
    }
}

#[test]
fn a_magnetometer_that_overflows_on_all_axes_is_not_frozen() {
    let mut watch = FrozenWatch::default();
    for i in 0..100 {
        let reading = Reading {
            t_s: f64::from(i) * 0.02,
            field_mgauss: Some([None; 3]),
            rate_rad_s: Some(Vector3::z() + Vector3::x() * 0.001 * f64::from(i)),
            specific_force_m_s2: None,
        };
        assert_eq!(watch.take(&reading, &Mountings::default()), None);
    }
}

/// A level turn leaves the specific force as it is, and a tilt does not. The gyro's chip is mounted another way.
#[test]
fn an_accelerometer_that_stands_still_while_the_board_tilts_is_frozen() {
    let mountings = Mountings {
        gyro: "+z +y -x".parse().unwrap(),
        ..Mountings::default()
    };
    let found = |axis_body: Vector3<f64>| {
        let mut watch = FrozenWatch::default();
        let last = (0..100).map(|i| {
            let rate = axis_body * (1.0 + 0.001 * f64::from(i % 3));
            let reading = Reading {
                t_s: f64::from(i) * 0.02,
                rate_rad_s: Some(mountings.gyro.to_chip(rate)),
                specific_force_m_s2: Some(Vector3::new(0.1, 0.0, -9.8)),
                ..Reading::default()
            };
            watch.take(&reading, &mountings)
        });
        last.last().unwrap()
    };
    assert_eq!(found(Vector3::x()), Some(ACCELEROMETER));
    assert_eq!(found(Vector3::z()), None);
}

/// The same field at a rate that differs, and the same rate in a field that differs. The clock starts again before either has
/// turned far enough.
#[test]
fn a_time_that_jumps_back_hides_no_frozen_sensor() {
    let differs = |i: u32| f64::from(i % 3);
    for (field, rate, jump, right) in [(0.0, 0.001, 20, MAGNETOMETER), (1.0, 0.0, 70, GYRO)] {
        let mut watch = FrozenWatch::default();
        let row = |i| {
            let t_s = f64::from(i) * 0.02 + if i < jump { 1000.0 } else { 0.0 };
            let field = [100.0 + field * differs(i), 0.0, 500.0];
            take(
                &mut watch,
                t_s,
                field,
                Vector3::z() * (1.0 + rate * differs(i)),
            )
        };
        let found: Vec<_> = (0..100).map(row).collect();
        assert_eq!(found[jump as usize], None);
        assert_eq!(found[99], Some(right));
    }
}

/// Each sensor has rows of its own, and the first after the jump is the magnetometer's. Either side of the jump is too
/// short for a verdict.
#[test]
fn a_field_that_arrives_before_the_gyro_after_a_jump_back_continues_its_run() {
    let mut watch = FrozenWatch::default();
    let mut found = Vec::new();
    for i in 0..40u32 {
        let t_s = f64::from(i) * 0.02 + if i < 20 { 1000.0 } else { 0.0 };
        let field = Reading {
            t_s,
            field_mgauss: Some([100.0, 0.0, 500.0].map(Some)),
            ..Reading::default()
        };
        found.push(watch.take(&field, &Mountings::default()));
        let rate = Reading {
            t_s: t_s + 0.01,
            rate_rad_s: Some(Vector3::new(0.0, 0.0, 1.0 + 0.001 * f64::from(i % 3))),
            ..Reading::default()
        };
        watch.take(&rate, &Mountings::default());
    }
    assert_eq!((found[20], found[39]), (None, Some(MAGNETOMETER)));
}
