//! A sudden change of the field while the board turns: something magnetic came or went.

use nalgebra::Vector3;

use super::agreement::Sighting;
use super::refine::median;

/// Samples before and after a jump, whose medians are compared: a spike or three do not count.
const AROUND: usize = 7;
/// Samples in which a jump may take place: attaching a magnet takes a hand a moment.
const DURING: usize = 6;
/// Samples that lie further apart in time are not compared, seconds.
const LONGEST_S: f64 = 1.0;

/// The board turns while this goes by in the time of one comparison, radians: at rest nothing but noise
/// moves the field, and says little of what is usual in a turn.
const TURNING_RAD: f64 = 0.035;

/// The largest jump.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Jump {
    /// Over the field's strength.
    pub share: f64,
    /// Over the median of all moments of the turns.
    pub times_usual: f64,
}

/// The largest jump of the corrected field, turned into the gyro's frame, where it should stand still.
/// `None` where the gyro followed too few samples, or these are too far apart.
pub fn largest_jump(sightings: &[Sighting]) -> Option<Jump> {
    const COUNT: usize = 2 * AROUND + DURING;
    let fields: Vec<Vector3<f64>> = sightings
        .iter()
        .map(|s| s.pose.orientation * s.field_body)
        .collect();
    let middles: Vec<Vector3<f64>> = fields.windows(AROUND).map(middle).collect();
    // Half the cosine's angle: a quaternion turns by half of what it stands for.
    let turned = (0.5 * TURNING_RAD).cos();
    let mut largest = 0.0f64;
    let mut turning = Vec::with_capacity(fields.len());
    for (around, middles) in sightings
        .windows(COUNT)
        .zip(middles.windows(COUNT - AROUND + 1))
    {
        let (first, last) = (&around[0], &around[COUNT - 1]);
        if first.pose.stretch != last.pose.stretch || last.t_s - first.t_s > LONGEST_S {
            continue;
        }
        let jump = (middles[COUNT - AROUND] - middles[0]).norm();
        largest = largest.max(jump);
        if first.pose.orientation.dot(&last.pose.orientation).abs() < turned {
            turning.push(jump);
        }
    }
    if turning.len() < 10 * COUNT {
        return None;
    }
    let strength = fields.iter().map(Vector3::norm).sum::<f64>() / fields.len() as f64;
    let usual = median(&mut turning)?;
    Some(Jump {
        share: largest / strength.max(1e-9),
        times_usual: largest / usual.max(1e-9),
    })
}

/// The median of each component.
fn middle(fields: &[Vector3<f64>]) -> Vector3<f64> {
    Vector3::from_fn(|axis, _| median_of_7(std::array::from_fn(|k| fields[k][axis])))
}

/// By thirteen exchanges (Paeth, Graphics Gems, 1990): this runs three times a sample.
fn median_of_7(mut v: [f64; AROUND]) -> f64 {
    for (a, b) in [
        (0, 5),
        (0, 3),
        (1, 6),
        (2, 4),
        (0, 1),
        (3, 5),
        (2, 6),
        (2, 3),
        (3, 6),
        (4, 5),
        (1, 4),
        (1, 3),
        (3, 4),
    ] {
        (v[a], v[b]) = (v[a].min(v[b]), v[a].max(v[b]));
    }
    v[3]
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
                        stretch: 0,
                    },
                    field_body: orientation.inverse() * earth,
                }
            })
            .collect()
    }

    #[test]
    fn the_median_of_seven_is_the_fourth_of_them_in_any_order() {
        let mut order = [0, 1, 2, 3, 4, 5, 6];
        // Heap's algorithm: all 5040.
        fn permute(order: &mut [usize; 7], n: usize) {
            if n == 1 {
                assert_eq!(median_of_7(order.map(|k| k as f64)), 3.0, "{order:?}");
                return;
            }
            for i in 0..n {
                permute(order, n - 1);
                order.swap(if n.is_multiple_of(2) { i } else { 0 }, n - 1);
            }
        }
        permute(&mut order, 7);
    }

    #[test]
    fn a_magnet_jumps_and_a_spike_or_a_slow_change_does_not() {
        let magnet = largest_jump(&turn(|i| if i < 250 { 0.0 } else { 30.0 })).unwrap();
        assert!(magnet.times_usual > 12.0, "{magnet:?}");
        assert!((magnet.share - 0.1).abs() < 0.01, "{magnet:?}");
        for added in [
            |i: usize| if i == 100 || i == 200 { 200.0 } else { 0.0 },
            |i: usize| 0.05 * i as f64,
        ] {
            let jump = largest_jump(&turn(added)).unwrap();
            assert!(jump.times_usual < 5.0, "{jump:?}");
        }
    }

    #[test]
    fn nothing_is_said_of_a_board_at_rest_or_of_few_samples() {
        assert_eq!(largest_jump(&turn(|_| 0.0)[..100]), None);
        let still = vec![turn(|_| 0.0)[0]; 400];
        assert_eq!(largest_jump(&still), None);
    }
}
