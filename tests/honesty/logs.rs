//! Recorded logs of real chips, each with what its description says must come out of it.

use std::path::Path;

use headingd::condition::Condition;
use headingd::frame::Mountings;
use headingd::reading::Reading;
use nalgebra::{Rotation3, UnitQuaternion, Vector3};

use crate::daemon::{Daemon, Log, Shown, log};
use crate::score::{Score, apart_deg};
use crate::table::{Limits, NONE, Row};

/// A log, its limits, and how it is judged.
pub struct Recording {
    pub name: &'static str,
    file: &'static str,
    limits: Limits,
    play: fn(&Log, &Path, &mut Score),
}

const RECORDED: Limits = Limits {
    first_s: Some(10.0),
    false_share: Some(0.0),
    ..NONE
};
/// The upper limit of nerr holds for each log, the lower one for all of them together.
const BROAD: Limits = Limits {
    nerr: Some((0.0, 1.5)),
    ..RECORDED
};
const TOGETHER: Limits = Limits {
    nerr: Some((0.5, 1.5)),
    first_s: None,
    ..RECORDED
};
/// Recordings whose name starts with this have a truth.
const WITH_TRUTH: &str = "broad_";

pub const ALL: &[Recording] = &[
    Recording {
        name: "broad_magnet_2cm",
        file: "broad_magnet_2cm.csv",
        limits: Limits {
            rms_deg: Some(2.5),
            p95_deg: Some(5.0),
            share: Some(0.9),
            ..BROAD
        },
        play: |log, _, score| {
            // The magnet is attached at about 43 s and taken off at about 98 s.
            score.excluded = vec![(43.0, 58.0), (98.0, 113.0)];
            by_truth(log, score);
        },
    },
    Recording {
        name: "broad_fast_rotation_iron",
        file: "broad_fast_rotation_iron.csv",
        limits: Limits {
            rms_deg: Some(1.5),
            ..BROAD
        },
        play: |log, _, score| by_truth(log, score),
    },
    Recording {
        name: "broad_stationary_magnet",
        file: "broad_stationary_magnet.csv",
        limits: Limits {
            rms_deg: Some(3.5),
            ..BROAD
        },
        play: |log, _, score| by_truth(log, score),
    },
    Recording {
        name: "hmc5883l_full_sphere",
        file: "hmc5883l_set2_full_sphere.csv",
        limits: Limits {
            other: &[
                ("bias X off, mG", 8.0),
                ("Y", 8.0),
                ("Z", 8.0),
                ("rotation off 3.5°", 1.0),
                ("its axis off", 20.0),
            ],
            ..RECORDED
        },
        play: |log, _, score| sphere(log, score),
    },
    Recording {
        name: "hmc5883l_zrot_alone",
        file: "hmc5883l_set2_zrot_2turns.csv",
        limits: Limits {
            first_s: None,
            first_deg: Some(200.0),
            other: &[("RMS against gyro", 2.5)],
            ..RECORDED
        },
        play: |log, _, score| against_gyro(log, Daemon::new(log.0, None), score),
    },
    Recording {
        name: "hmc5883l_zrot_by_sphere",
        file: "hmc5883l_set2_zrot_2turns.csv",
        limits: Limits {
            first_s: None,
            other: &[("RMS against gyro", 2.0)],
            ..RECORDED
        },
        play: |zrot, folder, score| {
            let sphere = log(&folder.join("hmc5883l_set2_full_sphere.csv"));
            let stored = sphere.and_then(|sphere| {
                let mut daemon = Daemon::new(sphere.0, None);
                play(&sphere, &mut daemon, |_, _, _, _| {});
                daemon.calibration()
            });
            against_gyro(zrot, Daemon::new(zrot.0, stored), score);
        },
    },
    Recording {
        name: "hmc5883l_roll_tilt",
        file: "hmc5883l_set2_roll_tilt_45_90.csv",
        limits: Limits {
            first_s: None,
            ..RECORDED
        },
        play: |log, _, score| by_truth(log, score),
    },
    Recording {
        name: "xio_fusion_calibrated",
        file: "xio_fusion_calibrated.csv",
        limits: Limits {
            first_s: None,
            other: &[
                ("moved by, °", 5.0),
                ("disturbed after, s", 3.0),
                ("good after, s", 10.0),
            ],
            ..RECORDED
        },
        play: |log, _, score| magnet_near(log, score),
    },
];

/// The rows of the logs in this folder.
pub fn rows(
    folder: Option<&Path>,
    wanted: &dyn Fn(&str) -> bool,
    new_score: &dyn Fn() -> Score,
) -> Vec<Row> {
    let mut rows = Vec::new();
    let mut with_truth = Vec::new();
    for recording in ALL.iter().filter(|recording| wanted(recording.name)) {
        let Some(folder) = folder else {
            rows.push(Row::skipped(recording.name, "no --logs"));
            continue;
        };
        let Some(log) = log(&folder.join(recording.file)) else {
            rows.push(Row::skipped(recording.name, "not among --logs"));
            continue;
        };
        let mut score = new_score();
        (recording.play)(&log, folder, &mut score);
        let scores = [score];
        rows.push(Row::new(recording.name, &scores, &recording.limits));
        if recording.name.starts_with(WITH_TRUTH) {
            with_truth.extend(scores);
        }
    }
    if with_truth.len() > 1 {
        rows.push(Row::new("broad_ logs together", &with_truth, &TOGETHER));
    }
    rows
}

/// Plays the log; `each` gets what is shown for every magnetometer reading.
fn play(
    (_, rows): &Log,
    daemon: &mut Daemon,
    mut each: impl FnMut(&mut Daemon, &Reading, Option<f64>, Shown),
) {
    for (reading, truth) in rows {
        if let Some(shown) = daemon.read(*reading) {
            each(daemon, reading, *truth, shown);
        }
    }
}

/// When more than half of the following half second turns faster than 0.3 rad/s.
fn motion_starts_s((_, rows): &Log) -> f64 {
    let rates: Vec<(f64, bool)> = rows
        .iter()
        .filter_map(|(reading, _)| Some((reading.t_s, reading.rate_rad_s?.norm() > 0.3)))
        .collect();
    let mut end = 0;
    let mut fast = 0;
    for (start, (t_s, turns)) in rates.iter().enumerate() {
        while end < rates.len() && rates[end].0 < t_s + 0.5 {
            fast += usize::from(rates[end].1);
            end += 1;
        }
        if 2 * fast > end - start {
            return *t_s;
        }
        fast -= usize::from(*turns);
    }
    0.0
}

fn by_truth(log: &Log, score: &mut Score) {
    score.starts_s = motion_starts_s(log);
    let mut daemon = Daemon::new(log.0, None);
    play(log, &mut daemon, |_, reading, truth, shown| {
        score.take(reading.t_s, truth, &shown);
    });
}

/// References: a fit of bias and scales, and one with a symmetric matrix, chip axes, milligauss.
const SPHERE_BIAS: [[f64; 3]; 2] = [[-5.6, -105.3, 12.6], [-6.5, -105.4, 20.3]];
/// From asking for a constant dip, chip axes, degrees.
const SPHERE_ROTATION: [f64; 3] = [3.5, -0.5, 1.0];
/// From when on it must be known.
const SPHERE_KNOWN_S: f64 = 25.0;

fn sphere(log: &Log, score: &mut Score) {
    score.starts_s = motion_starts_s(log);
    let reference = Vector3::from(SPHERE_ROTATION);
    let mut daemon = Daemon::new(log.0, None);
    let mut worst = [f64::NAN; 5];
    play(log, &mut daemon, |daemon, reading, truth, shown| {
        score.take(reading.t_s, truth, &shown);
        if reading.t_s < SPHERE_KNOWN_S {
            return;
        }
        // What is not known is infinitely far off.
        let mut off = [f64::INFINITY; 5];
        let spatial = daemon.spatial();
        if let Some(spatial) = spatial {
            let bias = spatial.bias_mgauss;
            let [first, second] = SPHERE_BIAS;
            for axis in 0..3 {
                let beyond = [bias[axis] - first[axis], bias[axis] - second[axis]];
                off[axis] = if axis < 2 {
                    beyond[0].abs().max(beyond[1].abs())
                } else {
                    // Between the two, or so far outside.
                    (-beyond[0]).max(beyond[1]).max(0.0)
                };
            }
        }
        let turn = spatial.and_then(|spatial| spatial.alignment_rad());
        if let Some((axis, angle)) = turn.and_then(|turn| Rotation3::new(turn).axis_angle()) {
            off[3] = (angle.to_degrees() - 3.5).abs();
            // Either chip may be the one that is turned against the other.
            let along = (axis.dot(&reference) / reference.norm()).abs();
            off[4] = along.min(1.0).acos().to_degrees();
        }
        for index in 0..5 {
            worst[index] = worst[index].max(off[index]);
        }
    });
    score.other = worst.to_vec();
}

/// That board's gyro bias, chip axes, degrees a second.
const GYRO_BIAS_DEG_S: [f64; 3] = [4.5, 0.05, 1.1];

/// The heading that the gyro alone gives, from level by the accelerometer at first, at each row with a rate.
fn gyro_headings((mountings, rows): &Log) -> Vec<(f64, f64)> {
    let Mountings { gyro, accel, .. } = *mountings;
    let bias = Vector3::from(GYRO_BIAS_DEG_S).map(f64::to_radians);
    let first: Vector3<f64> = rows
        .iter()
        .filter_map(|(reading, _)| reading.specific_force_m_s2)
        .take(50)
        .sum();
    let up = -accel.to_body(first);
    let mut attitude = UnitQuaternion::rotation_between(&up, &Vector3::z()).unwrap_or_default();
    let mut last_s = None;
    let mut headings = Vec::new();
    for (reading, _) in rows {
        let Some(rate) = reading.rate_rad_s else {
            continue;
        };
        let dt = reading.t_s - last_s.unwrap_or(reading.t_s);
        last_s = Some(reading.t_s);
        attitude *= UnitQuaternion::new(gyro.to_body(rate - bias) * dt);
        let x = attitude * Vector3::x();
        let heading = x.y.atan2(x.x).to_degrees();
        let last = headings.last().map_or(0.0, |(_, last)| *last);
        headings.push((reading.t_s, last + apart_deg(heading, last)));
    }
    headings
}

/// Heading against gyro, linear drift removed.
fn against_gyro(log: &Log, mut daemon: Daemon, score: &mut Score) {
    score.starts_s = motion_starts_s(log);
    let headings = gyro_headings(log);
    let start = headings[0].1;
    let mut index = 0;
    let mut apart: Vec<(f64, f64)> = Vec::new();
    play(log, &mut daemon, |_, reading, truth, shown| {
        while index + 1 < headings.len() && headings[index + 1].0 <= reading.t_s {
            index += 1;
        }
        let by_gyro = headings[index].1;
        score.turned_deg = (by_gyro - start).abs();
        score.take(reading.t_s, truth, &shown);
        if let Some(heading) = shown.heading_deg {
            let last = apart.last().map_or(0.0, |(_, last)| *last);
            apart.push((reading.t_s, last + apart_deg(heading - by_gyro, last)));
        }
    });
    score.other = vec![rms_about_line(&apart)];
}

/// RMS of values about the straight line through them.
fn rms_about_line(points: &[(f64, f64)]) -> f64 {
    let count = points.len() as f64;
    let (mean_t, mean_y) = points
        .iter()
        .fold((0.0, 0.0), |(t, y), p| (t + p.0 / count, y + p.1 / count));
    let (tt, ty) = points.iter().fold((0.0, 0.0), |(tt, ty), p| {
        let t = p.0 - mean_t;
        (tt + t * t, ty + t * (p.1 - mean_y))
    });
    let slope = ty / tt;
    let square = |p: &(f64, f64)| (p.1 - mean_y - slope * (p.0 - mean_t)).powi(2);
    (points.iter().map(square).sum::<f64>() / count).sqrt()
}

/// At rest from 96 s; something magnetic is near from 101 to 116 s.
fn magnet_near(log: &Log, score: &mut Score) {
    const STILL_S: (f64, f64) = (98.0, 134.0);
    const NEAR_S: (f64, f64) = (101.0, 116.0);
    score.starts_s = motion_starts_s(log);
    let mut daemon = Daemon::new(log.0, None);
    let mut first = None;
    let mut moved = f64::NAN;
    let (mut disturbed_s, mut good_s) = (f64::NAN, f64::NAN);
    play(log, &mut daemon, |_, reading, _, shown| {
        let t = reading.t_s;
        let still = (STILL_S.0..STILL_S.1).contains(&t);
        if still && let Some(heading) = shown.heading_deg {
            let first = *first.get_or_insert(heading);
            moved = moved.max(apart_deg(heading, first).abs());
        }
        // The board does not move, so its heading is what it was.
        score.take(t, first.filter(|_| still), &shown);
        if t >= NEAR_S.0 && disturbed_s.is_nan() && shown.condition == Condition::Disturbed {
            disturbed_s = t - NEAR_S.0;
        }
        if t >= NEAR_S.1 && good_s.is_nan() && shown.good() {
            good_s = t - NEAR_S.1;
        }
    });
    score.other = vec![moved, disturbed_s, good_s];
}
