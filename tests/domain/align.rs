//! `headingd align` on logs of simulated boards whose chips lie in every way.

use headingd::alignment::{AccelerometerReads, AlignmentError, align};
use headingd::frame::{Mounting, Mountings, signed_axes};
use headingd::reading::Reading;
use headingd::recording::{Entry, Header};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

use crate::common::{Folder, headingd, log};

/// How the chips of a simulated board lie on it, beside their signed axes.
struct Board {
    mountings: Mountings,
    /// Rotation of the magnetometer beside its axes, body axes, degrees.
    turn_deg: [f64; 3],
    /// Whether the board turns about all its axes, or about the vertical alone.
    tumbles: bool,
    seed: u64,
}

impl Default for Board {
    fn default() -> Self {
        Self {
            mountings: Mountings::default(),
            turn_deg: [0.0; 3],
            tumbles: true,
            seed: 1,
        }
    }
}

/// 40 s in the hand: level for a second, then turned to and fro about one axis after the other, with hard and soft iron, gyro
/// bias, noise, a lag, and the hand's accelerations.
fn readings(board: &Board) -> Vec<Reading> {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(board.seed);
    let mut noise = |sd: f64| {
        Vector3::from_fn(|_, _| {
            // Four even numbers are near enough to a normal one.
            let sum: f64 = (0..4).map(|_| random.random_range(-1.0..1.0)).sum();
            sd * sum * (3.0f64 / 4.0).sqrt()
        })
    };
    let field = Vector3::new(180.0, 0.0, 424.0);
    let iron = Vector3::new(150.0, -230.0, 90.0);
    let soft = Matrix3::new(1.06, 0.02, -0.01, 0.02, 0.95, 0.03, -0.01, 0.03, 1.0);
    let turn = Rotation3::new(Vector3::from(board.turn_deg).map(f64::to_radians));
    let bias = Vector3::new(3.0, -2.0, 1.5).map(f64::to_radians);
    let (step_s, mut attitude) = (0.01, UnitQuaternion::identity());
    let mut all = Vec::new();
    let mut seen = Vector3::zeros();
    for tick in 0..4000 {
        let t_s = f64::from(tick) * step_s;
        let axis = match ((t_s / 4.0) as usize) % 3 {
            _ if !board.tumbles => Vector3::z(),
            0 => Vector3::z(),
            1 => Vector3::x(),
            _ => Vector3::y(),
        };
        let speed = if t_s < 1.0 {
            0.0
        } else {
            1.8 * (1.4 * t_s).sin()
        };
        let wobble = if board.tumbles {
            0.15 * (2.3 * t_s).cos()
        } else {
            0.0
        };
        let rate = axis * speed + Vector3::new(1.0, 0.6, -0.3) * wobble;
        attitude *= UnitQuaternion::from_scaled_axis(rate * step_s);
        let back = attitude.inverse();
        // The magnetometer lags behind by a tick.
        let lagging = std::mem::replace(&mut seen, turn.inverse() * (soft * (back * field)) + iron);
        let push = Vector3::new(
            (3.1 * t_s).sin(),
            (2.7 * t_s).cos(),
            0.5 * (4.4 * t_s).sin(),
        );
        let force = back * (Vector3::new(0.0, 0.0, -9.81) + push * 0.8) + noise(0.05);
        let mag = (tick % 2 == 0 && tick > 0).then(|| lagging + noise(3.0));
        all.push(Reading {
            t_s,
            field_mgauss: mag
                .map(|mag| <[f64; 3]>::from(board.mountings.mag.to_chip(mag)).map(Some)),
            rate_rad_s: Some(board.mountings.gyro.to_chip(rate + bias + noise(0.003))),
            specific_force_m_s2: Some(board.mountings.accel.to_chip(force)),
        });
    }
    all
}

fn axes(text: &str) -> Mounting {
    text.parse().unwrap()
}

/// Whether what was found differs from the truth by a rotation of all chips about the vertical, if at all.
fn same_but_for_ahead(found: &Mountings, truth: &Mountings) -> bool {
    let common = truth.gyro.rotation() * found.gyro.rotation().transpose();
    let agrees = |found: &Mounting, truth: &Mounting| {
        (common * found.rotation() - truth.rotation()).norm() < 1e-9
    };
    let down = common * Vector3::z();
    agrees(&found.mag, &truth.mag)
        && agrees(&found.accel, &truth.accel)
        && (down - Vector3::z()).norm() < 1e-9
}

#[test]
fn every_way_in_which_chips_lie_is_found() {
    let row = |(column, sign)| Vector3::ith(column, sign).transpose();
    let right: Vec<Mounting> = signed_axes()
        .map(|rows| Mounting::from_matrix(Matrix3::from_rows(&rows.map(row))).unwrap())
        .filter(|one| !one.is_mirrored())
        .collect();
    assert_eq!(right.len(), 24);
    for index in 0..24 {
        let accel = right[(5 * index + 3) % 24];
        // Every second accelerometer reads gravity.
        let gravity = index % 2 == 1;
        let sign = if gravity { -1.0 } else { 1.0 };
        let board = Board {
            mountings: Mountings {
                mag: right[index],
                gyro: right[(7 * index + 11) % 24],
                accel: Mounting::from_matrix(accel.rotation() * sign).unwrap(),
            },
            seed: index as u64,
            ..Board::default()
        };
        let found = align(&readings(&board), true).unwrap();
        let mountings = Mountings {
            mag: found.mag.unwrap().axes,
            gyro: found.gyro,
            accel: found.accel.unwrap().axes,
        };
        assert!(
            same_but_for_ahead(&mountings, &board.mountings),
            "{found:?}"
        );
        let reads_gravity = found.accel_reads == AccelerometerReads::Gravity;
        assert_eq!(reads_gravity, gravity, "{found:?}");
    }
}

#[test]
fn the_rotation_beside_the_axes_is_found_as_certain_as_it_says() {
    let (mut squares, mut count, mut largest) = (0.0, 0, 0.0f64);
    for seed in 0..8 {
        let board = Board {
            mountings: Mountings {
                mag: axes("+y -x +z"),
                ..Mountings::default()
            },
            turn_deg: [3.5, -2.0 + 0.5 * seed as f64, 1.0],
            seed,
            ..Board::default()
        };
        let mag = align(&readings(&board), true).unwrap().mag.unwrap();
        for ((found, sd), truth) in mag.turn_deg.iter().zip(mag.turn_sd_deg).zip(board.turn_deg) {
            squares += ((found - truth) / sd).powi(2);
            count += 1;
            largest = largest.max((found - truth).abs());
            assert!(sd < 1.5, "{mag:?}");
        }
    }
    let normalised = (squares / f64::from(count)).sqrt();
    assert!(
        (0.3..1.6).contains(&normalised) && largest < 1.5,
        "{normalised} {largest}"
    );
}

/// At 10 Hz, a chip's usual rate, and at 5 Hz, in rows at 100 Hz that give the last value again.
#[test]
fn a_slow_magnetometer_is_found_whether_its_values_are_held_or_not() {
    let mountings = Mountings {
        mag: axes("+y -x +z"),
        ..Mountings::default()
    };
    let board = Board {
        mountings,
        turn_deg: [3.0, -2.0, 0.0],
        ..Board::default()
    };
    for rows in [10, 20] {
        let mut all = readings(&board);
        for holds in [false, true] {
            let mut last = None;
            for (row, reading) in all.iter_mut().enumerate() {
                if row % rows == 0 {
                    last = reading.field_mgauss;
                }
                reading.field_mgauss = last.filter(|_| holds || row % rows == 0);
            }
            let found = align(&all, true).unwrap().mag.unwrap();
            let case = format!("every {rows} rows, {holds}: {found:?}");
            assert_eq!(found.axes, mountings.mag, "{case}");
            for (angle, right) in found.turn_deg.iter().zip(board.turn_deg) {
                assert!((angle - right).abs() < 1.0, "{case}");
            }
        }
    }
}

#[test]
fn a_mirrored_gyro_a_turn_about_one_axis_and_rest_are_refused() {
    for mirrored in ["-x +y +z", "-x -y -z", "+y +x +z"] {
        let board = Board {
            mountings: Mountings {
                gyro: axes(mirrored),
                ..Mountings::default()
            },
            ..Board::default()
        };
        assert_eq!(
            align(&readings(&board), true),
            Err(AlignmentError::GyroMirrored)
        );
    }
    let vertical = Board {
        tumbles: false,
        ..Board::default()
    };
    let refusal = align(&readings(&vertical), true).unwrap_err();
    assert!(
        matches!(refusal, AlignmentError::Ambiguous(_)),
        "{refusal:?}"
    );
    let tumbling = readings(&Board::default());
    assert_eq!(
        align(&tumbling[..100], true),
        Err(AlignmentError::LittleMotion)
    );
    let without = |change: &dyn Fn(&mut Reading)| {
        let mut readings = tumbling.clone();
        readings.iter_mut().for_each(change);
        align(&readings, true)
    };
    assert_eq!(
        without(&|r| r.rate_rad_s = None),
        Err(AlignmentError::NoSensors)
    );
    // Without one of the others, that one alone is not found.
    let found = without(&|r| r.specific_force_m_s2 = None).unwrap();
    assert!(found.accel.is_none() && found.mag.is_some());
    // A magnetometer that does not turn with the board.
    let dead =
        without(&|r| r.field_mgauss = r.field_mgauss.map(|_| [Some(100.0 + r.t_s.sin()); 3]));
    assert!(
        matches!(
            dead,
            Err(AlignmentError::Unrelated(_) | AlignmentError::Ambiguous(_))
        ),
        "{dead:?}"
    );
}

#[test]
fn the_command_prints_lines_for_the_configuration() {
    let folder = Folder::new();
    let board = Board {
        mountings: Mountings {
            mag: axes("+x -y -z"),
            gyro: axes("-y -x -z"),
            accel: axes("-y -x -z"),
        },
        turn_deg: [4.0, 0.0, 0.0],
        ..Board::default()
    };
    let entries: Vec<Entry> = readings(&board)
        .into_iter()
        .map(|reading| Entry {
            reading,
            ..Entry::default()
        })
        .collect();
    let path = folder.file("a.csv", log(&(Header::default(), entries)));
    let ran = headingd(&["align", &path]);
    assert_eq!((ran.status, ran.err.as_str()), (0, ""), "{ran:?}");
    let config: toml::Table = ran.out.parse().unwrap();
    let lines = headingd(&["align", &path, "--json"]).json();
    for (name, key) in [
        ("mag", "mag_axes"),
        ("gyro", "gyro_axes"),
        ("accel", "accel_axes"),
    ] {
        assert_eq!(
            config["mounting"][key].as_str(),
            lines[name]["axes"].as_str()
        );
    }
    let exact = ran
        .out
        .lines()
        .find(|line| line.starts_with("#mag_axes = "));
    assert!(exact.is_some(), "{}", ran.out);
    assert!(!ran.out.contains("gravity"), "{}", ran.out);
    let south = headingd(&["align", &path, "--south"]);
    assert!(south.out.contains("reads gravity"), "{}", south.out);

    let short = folder.file("b.csv", {
        let mut log = log(&(Header::default(), Vec::new()));
        log.extend_from_slice(b"0.0,1,2,3,0,0,0,0,0,-9.8,\n");
        log
    });
    let refused = headingd(&["align", &short]);
    assert_eq!(refused.status, 3, "{refused:?}");
    assert!(refused.err.contains("(little_motion)"), "{refused:?}");
}
