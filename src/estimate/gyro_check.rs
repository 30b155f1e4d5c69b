//! Whether gyro and field tell the same of how the board turns.
//!
//! A field that stands still turns against the board, as the gyro says that the board turns, and iron on the board adds a
//! constant. So the change of the raw field over a moment is held against the change that the gyro predicts. The slope of
//! the one over the other is 1; a gyro of the wrong sign has −1, one whose scale is 10 % too small has 1.1.

use nalgebra::Vector3;

use super::filter::{Filter, Input};

/// A moment ends when the field has changed by this share of it (a turn of 9°), or after this time, seconds.
const CHANGE: f64 = 0.15;
const MOMENT_S: f64 = 1.0;
/// Changes below this are noise, and those above more than a moment: a jump.
const NOISE: f64 = 0.05;
const JUMP: f64 = 0.6;
/// Sums over squared changes, as shares of the field, over which evidence is forgotten: for sign and axes, and for a scale.
/// A level board at a dip of 70° changes its field by 0.02 in 30° of turning, a tumbling one in 9°.
const QUICK: f64 = 0.15;
const SLOW: f64 = 0.4;
/// Of that, so much must have been seen before anything is said.
const ENOUGH: f64 = 0.6;
/// A slope further from 1 is a gyro with a wrong scale: 5 %, and what noise and lag may add.
const SCALE_TOLERANCE: f64 = 0.07;
/// Correlation of both changes above which a slope says something, and below which gyro and field turn different ways.
const BELONG: f64 = 0.98;
const OPPOSES: f64 = -0.3;
const EXPLAINS_AGAIN: f64 = 0.8;
/// Readings of the gyro that are the same to the last bit for this long, seconds, are no measurement if the field
/// changes by so much meanwhile (squares summed: a turn of 15°).
const CONSTANT_S: f64 = 0.5;
const CONSTANT_ENOUGH: f64 = 0.06;
/// A magnet that is put beside a board at rest changes the field once or twice, a turn again and again.
const CONSTANT_CHANGES: u32 = 3;

/// What is wrong with the gyro.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GyroFault {
    /// It reads a constant while the field turns.
    Dead,
    /// Its axes or signs are wrong.
    Sign,
    /// Its scale is off by more than 5 %.
    Scale,
}

impl GyroFault {
    /// The code that programs read.
    pub fn reason(self) -> &'static str {
        match self {
            Self::Dead => "gyro_dead",
            Self::Sign => "gyro_sign",
            Self::Scale => "gyro_scale",
        }
    }
}

/// Holds the gyro against the field.
#[derive(Clone, Debug, Default)]
pub(super) struct GyroCheck {
    moment: Option<Moment>,
    quick: Sums,
    slow: Sums,
    constant: bool,
    fault: Option<GyroFault>,
}

#[derive(Clone, Copy, Debug)]
struct Moment {
    age_s: f64,
    field: Vector3<f64>,
    predicted: Vector3<f64>,
}

/// Squares and products of the changes seen and told, forgotten as more of them come.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    seen: f64,
    told: f64,
    both: f64,
    /// How many changes.
    count: u32,
}

impl Sums {
    fn take(&mut self, seen: &Vector3<f64>, told: &Vector3<f64>, memory: f64) {
        let (seen2, told2) = (seen.norm_squared(), told.norm_squared());
        let keep = (-seen2.max(told2) / memory).exp();
        self.seen = self.seen * keep + seen2;
        self.told = self.told * keep + told2;
        self.both = self.both * keep + seen.dot(told);
        self.count += 1;
    }

    fn correlation(&self) -> f64 {
        self.both / (self.seen * self.told).sqrt().max(1e-9)
    }
}

impl GyroCheck {
    /// Takes a sample, and what the filter knows.
    pub(super) fn take(&mut self, input: &Input, filter: &Filter) {
        let constant = input.gyro_constant_s > CONSTANT_S;
        if constant != self.constant {
            self.constant = constant;
            self.quick = Sums::default();
        }
        if !filter.begun() || !filter.iron_known_within(filter.strength_mgauss()) {
            return;
        }
        let matrix = filter.matrix();
        let Some(inverse) = matrix.try_inverse() else {
            return;
        };
        let field = inverse * (input.field_mgauss - filter.bias_mgauss());
        let change = matrix * field.cross(&input.rate_rad_s) * input.period_s;
        let moment = self.moment.get_or_insert(Moment {
            age_s: 0.0,
            field: input.field_mgauss,
            predicted: -change,
        });
        moment.age_s += input.period_s;
        moment.predicted += change;
        let strength = filter.strength_mgauss();
        let seen = (input.field_mgauss - moment.field) / strength;
        let told = moment.predicted / strength;
        let larger = seen.norm().max(told.norm());
        if larger < CHANGE && moment.age_s < MOMENT_S {
            return;
        }
        self.moment = None;
        if !(NOISE..JUMP).contains(&larger) {
            return;
        }
        self.quick.take(&seen, &told, QUICK);
        self.slow.take(&seen, &told, SLOW);
        self.fault = self.judged();
    }

    fn judged(&self) -> Option<GyroFault> {
        let Sums { seen, told, .. } = self.quick;
        let enough = |sums: &Sums, memory: f64| sums.seen.max(sums.told) > ENOUGH * memory;
        let silent = told < 0.1 * seen;
        if silent && self.constant && seen > CONSTANT_ENOUGH && self.quick.count >= CONSTANT_CHANGES
        {
            return Some(GyroFault::Dead);
        }
        if !silent && enough(&self.quick, QUICK) && self.quick.correlation() < OPPOSES {
            return Some(GyroFault::Sign);
        }
        // A fault is over when the gyro explains the field again.
        let wrong = self.fault.filter(|fault| {
            *fault != GyroFault::Scale && self.quick.correlation() < EXPLAINS_AGAIN
        });
        if wrong.is_some() {
            return wrong;
        }
        let slope = self.slow.both / self.slow.told.max(1e-9);
        (enough(&self.slow, SLOW)
            && self.slow.correlation() > BELONG
            && (slope - 1.0).abs() > SCALE_TOLERANCE)
            .then_some(GyroFault::Scale)
    }

    /// What is wrong, if anything is.
    pub(super) fn fault(&self) -> Option<GyroFault> {
        self.fault
    }
}
