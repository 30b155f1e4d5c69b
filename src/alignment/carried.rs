//! What the gyro measures of a motion, and what a vector sensor measures in the frame that the gyro carries along.

use nalgebra::{Matrix3, Rotation3, SMatrix, Vector3};

use crate::frame::rows;
use crate::reading::Reading;

/// A gyro that is silent for longer has left a gap, seconds.
const GAP_S: f64 = 0.3;
/// Knots are this far apart, seconds.
pub(super) const KNOT_S: f64 = 0.2;
/// Two knots make a pair when the board has turned this far between them, radians (30°), in at most this time, seconds.
const PAIR_RAD: f64 = 0.52;
const PAIR_S: f64 = 4.0;

/// What a sensor's samples become by a matrix M, chip to gyro axes, row by row, and an offset c: `by_matrix · M − by_offset · c`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Linear {
    pub(super) by_matrix: SMatrix<f64, 3, 9>,
    pub(super) by_offset: Matrix3<f64>,
}

impl Linear {
    /// The vector by this matrix and offset.
    pub(super) fn at(&self, matrix: &Matrix3<f64>, offset: &Vector3<f64>) -> Vector3<f64> {
        self.by_matrix * rows(matrix) - self.by_offset * offset
    }
}

/// The rotation measured by the gyro, corrected for a bias, gyro axes: one knot a reading.
pub(super) struct Carried {
    knots: Vec<Knot>,
}

/// An instant of the motion.
#[derive(Clone, Copy, Debug)]
pub(super) struct Knot {
    pub(super) t_s: f64,
    segment: u32,
    /// Turns gyro axes into the frame, and the same summed up over time.
    to_frame: Rotation3<f64>,
    sum: Matrix3<f64>,
    /// On the way here from the reading before, rad/s.
    pub(super) rate_rad_s: Vector3<f64>,
}

/// A knot, and the sensor's vector there.
pub(super) type SensedKnot = (Knot, Linear);

/// Two knots between which the board has turned, counted among those seen.
#[derive(Clone, Copy, Debug)]
pub(super) struct KnotPair {
    pub(super) first: usize,
    pub(super) second: usize,
    /// Takes vectors of the first knot's gyro axes into the second's.
    pub(super) carry: Matrix3<f64>,
    /// How a bias of the gyro, rad/s, turns what was carried, radians.
    pub(super) by_bias: Matrix3<f64>,
}

impl Carried {
    /// `sense` is −1 for a gyro that counts every rotation the other way round.
    pub(super) fn new(readings: &[Reading], bias_rad_s: &Vector3<f64>, sense: f64) -> Self {
        let mut knots: Vec<Knot> = Vec::new();
        let mut last_rate = Vector3::zeros();
        for reading in readings {
            let Some(rate) = reading.rate_rad_s else {
                continue;
            };
            let rate = sense * (rate - bias_rad_s);
            let t_s = reading.t_s;
            let knot = match knots.last() {
                Some(last) if t_s - last.t_s <= GAP_S && t_s > last.t_s => {
                    let step_s = t_s - last.t_s;
                    let mean = 0.5 * (rate + last_rate);
                    let half = last.to_frame * Rotation3::new(mean * (0.5 * step_s));
                    Knot {
                        t_s,
                        segment: last.segment,
                        to_frame: last.to_frame * Rotation3::new(mean * step_s),
                        sum: last.sum + half.matrix() * step_s,
                        rate_rad_s: mean,
                    }
                }
                Some(last) if t_s == last.t_s => continue,
                last => Knot {
                    t_s,
                    segment: last.map_or(0, |last| last.segment + 1),
                    to_frame: Rotation3::identity(),
                    sum: Matrix3::zeros(),
                    rate_rad_s: rate,
                },
            };
            last_rate = rate;
            knots.push(knot);
        }
        Self { knots }
    }

    /// The instant `t_s`, between two knots of a segment.
    fn knot(&self, t_s: f64) -> Option<Knot> {
        let next = self.knots.partition_point(|knot| knot.t_s < t_s);
        let (before, after) = (self.knots.get(next.checked_sub(1)?)?, self.knots.get(next)?);
        if before.segment != after.segment {
            return None;
        }
        let step_s = t_s - before.t_s;
        Some(Knot {
            t_s,
            segment: before.segment,
            to_frame: before.to_frame * Rotation3::new(after.rate_rad_s * step_s),
            sum: before.sum + before.to_frame.matrix() * step_s,
            rate_rad_s: after.rate_rad_s,
        })
    }

    /// Evenly spaced knots over the whole motion, each with what the sensor measures about it; knots without a sample are left out.
    pub(super) fn means(
        &self,
        samples: &[(f64, Vector3<f64>)],
        half_window_s: f64,
    ) -> Vec<SensedKnot> {
        let (Some(first), Some(last)) = (self.knots.first(), self.knots.last()) else {
            return Vec::new();
        };
        let count = ((last.t_s - first.t_s) / KNOT_S) as usize;
        (0..=count)
            .filter_map(|index| {
                let knot = self.knot(first.t_s + index as f64 * KNOT_S)?;
                Some((knot, self.mean(&knot, samples, half_window_s)?))
            })
            .collect()
    }

    /// The mean of the samples (time and chip axes) within half a window of a knot, carried to it.
    fn mean(
        &self,
        knot: &Knot,
        samples: &[(f64, Vector3<f64>)],
        half_window_s: f64,
    ) -> Option<Linear> {
        let first = samples.partition_point(|(t_s, _)| *t_s < knot.t_s - half_window_s);
        let near = samples[first..].iter();
        let near = near.take_while(|(t_s, _)| *t_s < knot.t_s + half_window_s);
        let mut linear = Linear {
            by_matrix: SMatrix::zeros(),
            by_offset: Matrix3::zeros(),
        };
        let mut count = 0.0;
        for (t_s, chip) in near {
            let Some(at) = self.knot(*t_s).filter(|at| at.segment == knot.segment) else {
                continue;
            };
            let turn = (knot.to_frame.inverse() * at.to_frame).into_inner();
            linear.by_matrix += turn.kronecker(&chip.transpose());
            linear.by_offset += turn;
            count += 1.0;
        }
        let share = 1.0 / count;
        (count > 0.0).then(|| Linear {
            by_matrix: linear.by_matrix * share,
            by_offset: linear.by_offset * share,
        })
    }
}

/// One pair after the other. They are so far apart that they share no sample.
pub(super) fn pairs(seen: &[SensedKnot], apart_s: f64) -> Vec<KnotPair> {
    let mut pairs = Vec::new();
    let mut first = 0;
    while first < seen.len() {
        let (from, _) = &seen[first];
        let together = |knot: &Knot| knot.segment == from.segment && knot.t_s - from.t_s <= PAIR_S;
        let far = |knot: &Knot| {
            knot.t_s - from.t_s >= apart_s && from.to_frame.angle_to(&knot.to_frame) >= PAIR_RAD
        };
        let steps = seen[first..]
            .iter()
            .take_while(|(knot, _)| together(knot))
            .position(|(knot, _)| far(knot));
        let Some(steps) = steps else {
            first += 1;
            continue;
        };
        let second = first + steps;
        let (to, _) = &seen[second];
        let back = to.to_frame.inverse();
        pairs.push(KnotPair {
            first,
            second,
            carry: (back * from.to_frame).into_inner(),
            by_bias: back.matrix() * (to.sum - from.sum),
        });
        first = second;
    }
    pairs
}
