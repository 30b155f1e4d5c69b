//! A vector that stands still in the world, field or gravity: how the board sees it change, and what change the gyro predicts.

use nalgebra::Vector3;

/// A moment ends when the vector has changed by this share of it (a turn of 9°), or after this time, seconds.
const CHANGE: f64 = 0.15;
const MOMENT_S: f64 = 1.0;
/// Smaller changes are noise. Larger ones are too large for one moment: the vector has jumped.
const NOISE: f64 = 0.05;
const JUMP: f64 = 0.6;
/// Sum of squared changes, as shares of the vector, over which evidence is forgotten. A level board at a dip of 70°
/// adds 0.02 in 25° of turning, a tumbling one in 9°.
const MEMORY: f64 = 0.15;
/// Of that, so much must have been seen before anything is said.
const ENOUGH: f64 = 0.6;
/// Where the squares of what the gyro predicts are below this share of those of what is seen, a third in rotation, it has not turned.
const ALONE: f64 = 0.1;
/// A gyro that was at fault agrees with the vector once the correlation reaches this. Wrong axes reach 0.8, by chance or by a filter that
/// was misled.
const AGREES: f64 = 0.9;
/// Readings of the gyro that are the same to the last bit are no measurement if the squared changes meanwhile add up to this: two
/// moments, in a level turn of 41° at a dip of 65°.
const CONSTANT_ENOUGH: f64 = 0.04;

/// The changes of recent moments, seen and predicted.
#[derive(Clone, Debug, Default)]
pub(super) struct Witness {
    moment: Option<Moment>,
    sums: Sums,
}

#[derive(Clone, Copy, Debug)]
struct Moment {
    age_s: f64,
    start: Vector3<f64>,
    predicted: Vector3<f64>,
}

/// Squares and products of the changes seen and predicted, forgotten as more of them come.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    seen: f64,
    predicted: f64,
    both: f64,
    /// How many changes.
    count: u32,
}

/// How a vector has changed since a moment began, body axes, as a share of it.
#[derive(Clone, Copy, Debug)]
pub(super) struct VectorChange {
    /// As it was seen.
    pub(super) seen: Vector3<f64>,
    /// As the gyro predicts.
    pub(super) predicted: Vector3<f64>,
    /// The length of the larger of both.
    pub(super) larger: f64,
    /// Whether the moment ends with it.
    pub(super) ended: bool,
}

impl VectorChange {
    /// Whether it is too large for one moment.
    pub(super) fn is_jump(&self) -> bool {
        self.larger >= JUMP
    }

    /// Whether it is evidence: a whole moment's, and neither noise nor a jump.
    pub(super) fn counts(&self) -> bool {
        self.ended && (NOISE..JUMP).contains(&self.larger)
    }

    /// Whether the gyro has hardly turned.
    pub(super) fn is_alone(&self) -> bool {
        self.predicted.norm_squared() < ALONE * self.seen.norm_squared()
    }
}

impl Sums {
    fn take(&mut self, change: &VectorChange) {
        let (seen2, predicted2) = (change.seen.norm_squared(), change.predicted.norm_squared());
        let keep = (-seen2.max(predicted2) / MEMORY).exp();
        self.seen = self.seen * keep + seen2;
        self.predicted = self.predicted * keep + predicted2;
        self.both = self.both * keep + change.seen.dot(&change.predicted);
        self.count += 1;
    }

    fn correlation(&self) -> f64 {
        self.both / (self.seen * self.predicted).sqrt().max(1e-9)
    }
}

impl Witness {
    /// Takes the vector and the change that the gyro predicts since the sample before.
    pub(super) fn take(
        &mut self,
        now: Vector3<f64>,
        change: Vector3<f64>,
        period_s: f64,
    ) -> VectorChange {
        let first = self.moment.is_none();
        let moment = self.moment.get_or_insert(Moment {
            age_s: 0.0,
            start: now,
            predicted: Vector3::zeros(),
        });
        moment.age_s += period_s;
        if !first {
            moment.predicted += change;
        }
        let (seen, predicted) = (now - moment.start, moment.predicted);
        let larger = seen.norm().max(predicted.norm());
        let change = VectorChange {
            seen,
            predicted,
            larger,
            ended: larger >= CHANGE || moment.age_s >= MOMENT_S,
        };
        if change.ended {
            self.moment = None;
        }
        if change.counts() {
            self.sums.take(&change);
        }
        change
    }

    /// Whether the next vector begins a moment.
    pub(super) fn begins(&self) -> bool {
        self.moment.is_none()
    }

    /// What has changed in this moment is no evidence.
    pub(super) fn lose_moment(&mut self) {
        self.moment = None;
    }

    /// Forgets the changes of the moments before.
    pub(super) fn forget(&mut self) {
        self.sums = Sums::default();
    }

    /// How many changes there were.
    pub(super) fn count(&self) -> u32 {
        self.sums.count
    }

    /// Whether it has turned by enough to say something, and the gyro, whose readings are the same, has not.
    pub(super) fn turns_alone(&self) -> bool {
        self.sums.seen > CONSTANT_ENOUGH && self.sums.predicted < ALONE * self.sums.seen
    }

    /// Whether it turns as the gyro does.
    pub(super) fn agrees(&self) -> bool {
        self.enough() && self.sums.correlation() >= AGREES
    }

    /// Whether the correlation with what the gyro predicts is certainly below this limit.
    pub(super) fn correlates_below(&self, limit: f64) -> bool {
        self.enough() && self.sums.correlation() < limit
    }

    fn enough(&self) -> bool {
        self.sums.seen.max(self.sums.predicted) > ENOUGH * MEMORY
    }
}
