//! A sudden change of the field while the board turns: something magnetic came or went.

use nalgebra::Vector3;

use super::gyro_agreement::Sighting;
use super::medians::{median, median_of};

/// Samples before and after a jump, whose medians are compared: a spike or three do not count.
const AROUND: usize = 7;
/// In what time a jump may take place, seconds: a hand attaches a magnet in a moment, a passing car swells for
/// a second or two. The longer look alone would miss what comes near the end of a turn.
const DURING_S: [f64; 2] = [0.15, 0.85];
/// Samples that lie further apart in time are not compared, seconds.
const LONGEST_S: f64 = 2.0;
/// A longer step in time is a gap, seconds.
const GAP_S: f64 = 0.5;
/// With fewer moments of the turns nothing is usual.
const LEAST_MOMENTS: usize = 200;

/// The board turns while this goes by in the time of one comparison, radians: at rest nothing but noise
/// moves the field, and says little of what is usual in a turn.
const TURNING_RAD: f64 = 0.035;

/// The largest scale error of a gyro by its data sheet. It turns the frame by this share of every angle, and the more within a comparison
/// the faster the board turns: no jump of the field.
const GYRO_SCALE: f64 = 0.03;

/// The largest jump.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Jump {
    /// Over the field's strength.
    pub share: f64,
    /// Over the median of all moments of the turns.
    pub times_usual: f64,
}

/// The largest jump of the corrected field, turned into the gyro's frame, where it should be constant.
/// `None` where the gyro followed too few samples, or these are too far apart.
pub fn largest_jump(sightings: &[Sighting]) -> Option<Jump> {
    // With bursts, the mean of the steps is a better period than their median, once gaps are left out.
    let steps = sightings.windows(2).map(|pair| pair[1].t_s - pair[0].t_s);
    let (count, sum_s) = steps
        .filter(|step_s| (0.0..GAP_S).contains(step_s))
        .fold((0.0f64, 0.0), |(count, sum), step| {
            (count + 1.0, sum + step)
        });
    let period_s = (sum_s / count.max(1.0)).max(1e-3);
    let fields: Vec<Vector3<f64>> = sightings
        .iter()
        .map(|sighting| sighting.pose.orientation * sighting.field_body)
        .collect();
    let strength = fields.iter().map(Vector3::norm).sum::<f64>() / fields.len() as f64;
    let middle = |seven: &[Vector3<f64>]| {
        Vector3::from_fn(|axis, _| median_of::<AROUND>(std::array::from_fn(|k| seven[k][axis])))
    };
    let middles: Vec<Vector3<f64>> = fields.windows(AROUND).map(middle).collect();
    DURING_S
        .iter()
        .filter_map(|during_s| {
            let during = (during_s / period_s).round() as usize;
            let (largest, usual) = changes(sightings, &middles, AROUND + during, strength)?;
            Some(Jump {
                share: largest / strength.max(1e-9),
                times_usual: largest / usual.max(1e-9),
            })
        })
        .max_by(|a, b| a.times_usual.total_cmp(&b.times_usual))
}

/// The largest change of the medians over `apart` samples, less what the gyro's scale may make of it, and what is usual while the board
/// turns.
fn changes(
    sightings: &[Sighting],
    middles: &[Vector3<f64>],
    apart: usize,
    strength: f64,
) -> Option<(f64, f64)> {
    // The components of a quaternion have half the angle of its rotation.
    let turning_cosine = (0.5 * TURNING_RAD).cos();
    let mut largest = 0.0f64;
    let mut turning = Vec::with_capacity(sightings.len());
    let later = sightings.iter().skip(apart + AROUND - 1);
    let ends = sightings.iter().zip(later);
    let jumps = middles.iter().zip(middles.iter().skip(apart));
    for ((first, last), (before, after)) in ends.zip(jumps) {
        if first.pose.frame_id != last.pose.frame_id || last.t_s - first.t_s > LONGEST_S {
            continue;
        }
        let jump = (after - before).norm_squared();
        let cosine = first.pose.orientation.dot(&last.pose.orientation).abs();
        if jump > largest * largest {
            // The chord of the angle, which takes no inverse function.
            let turned = 2.0 * (1.0 - cosine * cosine).max(0.0).sqrt();
            largest = largest.max(jump.sqrt() - GYRO_SCALE * turned * strength);
        }
        if cosine < turning_cosine {
            turning.push(jump);
        }
    }
    (turning.len() >= LEAST_MOMENTS)
        .then(|| median(&mut turning))
        .flatten()
        .map(|usual| (largest, usual.sqrt()))
}

#[cfg(test)]
mod tests {
    use nalgebra::UnitQuaternion;

    use super::*;
    use crate::attitude::Pose;

    /// A level turn in a field of 100 that `added` adds to, seen with a ripple of 1.
    fn turn(added: impl Fn(usize) -> f64) -> Vec<Sighting> {
        (0..400)
            .map(|i| {
                let orientation = UnitQuaternion::from_scaled_axis(Vector3::z() * 0.016 * i as f64);
                let ripple = (i as f64 * 2.0).sin();
                let earth = Vector3::new(100.0 + added(i), ripple, 300.0);
                Sighting {
                    t_s: i as f64 * 0.025,
                    pose: Pose {
                        orientation,
                        vertical_known: true,
                        frame_id: 0,
                    },
                    field_body: orientation.inverse() * earth,
                }
            })
            .collect()
    }

    #[test]
    fn a_magnet_jumps_and_a_spike_or_a_slow_change_does_not() {
        let magnet = largest_jump(&turn(|i| if i < 250 { 0.0 } else { 30.0 })).unwrap();
        assert!(magnet.times_usual > 12.0, "{magnet:?}");
        // 30 of 316, less what a gyro of a wrong scale might make of it.
        assert!((magnet.share - 0.07).abs() < 0.01, "{magnet:?}");
        for added in [
            |i: usize| if i == 100 || i == 200 { 200.0 } else { 0.0 },
            |i: usize| 0.05 * i as f64,
        ] {
            let jump = largest_jump(&turn(added)).unwrap();
            assert!(jump.times_usual < 5.0, "{jump:?}");
        }
    }

    #[test]
    fn a_gyro_of_a_wrong_scale_is_no_jump() {
        // A slow turn, and a fast one.
        let angle = |i: usize| 0.007 * i as f64 + 0.045 * i.saturating_sub(900) as f64;
        let about_z = |angle: f64| UnitQuaternion::from_scaled_axis(Vector3::z() * angle);
        let sightings = |magnet: f64| {
            let mut sightings: Vec<Sighting> = (0..1000).map(|_| turn(|_| 0.0)[0]).collect();
            for (i, sighting) in sightings.iter_mut().enumerate() {
                let added = if i < 700 { 0.0 } else { magnet };
                let earth = Vector3::new(100.0 + added, (i as f64 * 2.0).sin(), 300.0);
                sighting.t_s = i as f64 * 0.025;
                sighting.pose.orientation = about_z(1.025 * angle(i));
                sighting.field_body = about_z(-angle(i)) * earth;
            }
            sightings
        };
        let jump = largest_jump(&sightings(0.0)).unwrap();
        assert!(jump.times_usual < 6.0, "{jump:?}");
        let jump = largest_jump(&sightings(30.0)).unwrap();
        assert!(jump.times_usual > 10.0, "{jump:?}");
    }

    #[test]
    fn nothing_is_said_of_a_board_at_rest_or_of_few_samples() {
        assert_eq!(largest_jump(&turn(|_| 0.0)[..100]), None);
        let still = vec![turn(|_| 0.0)[0]; 400];
        assert_eq!(largest_jump(&still), None);
    }
}
