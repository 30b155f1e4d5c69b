//! Whether gyro, field and gravity agree on how the board turns.
//!
//! A field that stands still turns against the board as the gyro reads, and iron on the board adds a constant. So the
//! change of the raw field over a moment is compared with the change that the gyro predicts: a gyro of the wrong sign predicts the
//! opposite. Gravity turns in the same way, and no iron moves it: where both have turned and the gyro has not, the gyro is dead,
//! whatever it reads. `gyro_scale` checks the scale, `gyro_axes` the axes, and `field_turns` counts turns that the gyro does not see. Of
//! gyro, field and gravity, the one that turns another way than the other two is wrong.

use std::f64::consts::PI;

use nalgebra::Vector3;

use super::field_turns::FieldTurns;
use super::filter::{Filter, Input};
use super::gyro_axes::{AxesVerdict, GyroAxes};
use super::gyro_scale::{GyroScale, ScaleVerdict};
use super::prior::FIELD_MGAUSS;
use crate::attitude::GRAVITY_M_S2;

/// A moment ends when the field has changed by this share of it (a turn of 9°), or after this time, seconds.
const CHANGE: f64 = 0.15;
const MOMENT_S: f64 = 1.0;
/// Smaller changes are noise. Larger ones are too large for one moment: the field has jumped.
const NOISE: f64 = 0.05;
const JUMP: f64 = 0.6;
/// Sum of squared changes, as shares of the field, over which evidence is forgotten. A level board at a dip of 70°
/// adds 0.02 in 25° of turning, a tumbling one in 9°.
const MEMORY: f64 = 0.15;
/// Of that, so much must have been seen before anything is said.
const ENOUGH: f64 = 0.6;
/// Where the squares of what the gyro predicts are below this share of those of what is seen, a third in rotation, it has not turned.
const ALONE: f64 = 0.1;
/// Correlation of both changes below which gyro and field turn different ways.
const OPPOSES: f64 = -0.3;
/// The same for gravity. The limit is stricter, since accelerations change the measured gravity too.
const GRAVITY_OPPOSES: f64 = -0.5;
/// Fewer changes say nothing against the gyro: a filter that has just begun knows little of the iron.
const LEAST_CHANGES: u32 = 6;
/// Readings that are the same to the last bit are a real rotation, that of a turntable, only above this correlation.
const AGREES: f64 = 0.5;
/// Specific force that is longer or shorter than gravity by more than this share is not gravity.
const SHAKEN: f64 = 0.1;
/// A gyro is dead when gravity and field have moved together so often in a row, each by so much (6°), without it. A car that
/// brakes moves gravity, one that passes it the field; both at once are a chance.
const TOGETHER: u32 = 3;
const MOVED: f64 = 0.1;
/// A gyro that turns by less than this share of what gravity does is silent.
const SILENT: f64 = 0.3;
/// From this correlation on, a gyro that was at fault explains the field again. Wrong axes reach 0.8, by chance or by a filter that was misled.
const EXPLAINS_AGAIN: f64 = 0.9;
/// Readings of the gyro that are the same to the last bit for this long, seconds, are no measurement if the field
/// changes by so much meanwhile (squares summed: a level turn of 30° at a dip of 65°).
const CONSTANT_S: f64 = 0.5;
const CONSTANT_ENOUGH: f64 = 0.04;
/// A magnet that is put beside a board at rest changes the field once or twice, a turn again and again.
const CONSTANT_CHANGES: u32 = 3;

/// A difference between the change seen and the change predicted is explained below this: unevenness (1.5 %) and noise (as much),
/// each at both ends. Jitter of the sample times, seconds, adds its share of the rate.
const EXPLAINED: f64 = 0.06;
const SCATTER_S: f64 = 0.005;
/// A difference up to this share of the change is explained too: a drone's throttle changes the field during a turn.
const MOSTLY: f64 = 0.6;
/// Doubt about the gyro fades by 1/e over this much explained change: two moments.
const FADES: f64 = 0.3;
/// While readings are the same to the last bit, they may be no measurement: a moving gyro has noise. The board is then taken to turn
/// on at its mean rate over this time before, seconds.
const RATE_TAU_S: f64 = 1.0;

/// What is wrong with the gyro.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GyroFault {
    /// Field or gravity turn, and the gyro does not measure it.
    Dead,
    /// The gyro's axes or signs are wrong, or nothing shows yet which chip's are.
    Sign,
    /// The magnetometer's axes or signs are wrong: gravity turns as the gyro reads, and the field does not.
    MagAxes,
    /// The accelerometer's axes or signs are wrong: the field turns as the gyro reads, and gravity does not.
    AccelAxes,
    /// Its scale is off by more than 5 %.
    Scale,
}

/// Compares the gyro with the field and with gravity.
#[derive(Clone, Debug, Default)]
pub(super) struct GyroCheck {
    field: Witness,
    gravity: Witness,
    axes: GyroAxes,
    unexplained: Unexplained,
    /// The field when gravity's moment began, as a share of its strength, how far the gyro has turned since, radians, and how often both
    /// have moved without it.
    field_at_start: Vector3<f64>,
    turned_rad: f64,
    together: u32,
    constant: bool,
    fault: Option<GyroFault>,
    scale: GyroScale,
    /// The field's turns, until the gyro has been shown to be right: later a magnet that turns beside the board is the likelier cause.
    turns: FieldTurns,
    was_right: bool,
    /// Whether the field was disturbed at the last sample.
    disturbed: bool,
    /// Mean rate while the readings differ, rad/s, and how far the board may have turned since they repeat, radians.
    rate_rad_s: f64,
    unseen_rad: f64,
}

/// A vector that stands still in the world, as the board has seen it change and as the gyro predicts.
#[derive(Clone, Debug, Default)]
struct Witness {
    moment: Option<Moment>,
    sums: Sums,
}

/// Change of the field that the gyro does not explain, as a share of it: in recent moments, and in the current one.
#[derive(Clone, Copy, Debug, Default)]
struct Unexplained {
    recent: f64,
    current: f64,
}

/// How a vector has changed since a moment began.
#[derive(Clone, Copy, Debug)]
struct VectorChange {
    /// As it was seen, and the larger of this and what the gyro predicts.
    seen: f64,
    larger: f64,
    /// By how much the gyro misses it.
    missed: f64,
    /// Whether the moment ends with it.
    ended: bool,
}

impl VectorChange {
    /// Whether it is evidence: a whole moment's, and neither noise nor a jump.
    fn counts(&self) -> bool {
        self.ended && (NOISE..JUMP).contains(&self.larger)
    }
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

impl Sums {
    fn take(&mut self, seen: &Vector3<f64>, predicted: &Vector3<f64>) {
        let (seen2, predicted2) = (seen.norm_squared(), predicted.norm_squared());
        let keep = (-seen2.max(predicted2) / MEMORY).exp();
        self.seen = self.seen * keep + seen2;
        self.predicted = self.predicted * keep + predicted2;
        self.both = self.both * keep + seen.dot(predicted);
        self.count += 1;
    }

    fn enough(&self) -> bool {
        self.seen.max(self.predicted) > ENOUGH * MEMORY
    }

    fn correlation(&self) -> f64 {
        self.both / (self.seen * self.predicted).sqrt().max(1e-9)
    }
}

impl Witness {
    /// Takes the vector and the change that the gyro predicts since the sample before.
    fn take(&mut self, now: Vector3<f64>, change: Vector3<f64>, period_s: f64) -> VectorChange {
        let moment = self.moment.get_or_insert(Moment {
            age_s: 0.0,
            start: now,
            predicted: -change,
        });
        moment.age_s += period_s;
        moment.predicted += change;
        let (seen, predicted) = (now - moment.start, moment.predicted);
        let larger = seen.norm().max(predicted.norm());
        let change = VectorChange {
            seen: seen.norm(),
            larger,
            missed: (seen - predicted).norm(),
            ended: larger >= CHANGE || moment.age_s >= MOMENT_S,
        };
        if change.ended {
            self.moment = None;
        }
        if change.counts() {
            self.sums.take(&seen, &predicted);
        }
        change
    }

    /// Whether it has turned by enough to say something, and the gyro, whose readings are the same, has not.
    fn turns_alone(&self) -> bool {
        self.sums.seen > CONSTANT_ENOUGH && self.sums.predicted < ALONE * self.sums.seen
    }

    /// Whether it turns as the gyro does.
    fn agrees(&self) -> bool {
        self.sums.enough() && self.sums.correlation() >= EXPLAINS_AGAIN
    }

    fn opposes(&self, limit: f64) -> bool {
        let Sums {
            seen,
            predicted,
            count,
            ..
        } = self.sums;
        count >= LEAST_CHANGES
            && predicted > ALONE * seen
            && self.sums.enough()
            && self.sums.correlation() < limit
    }
}

impl Unexplained {
    /// Takes a change, and the rate at which the board turns.
    fn take(&mut self, change: &VectorChange, rate_rad_s: f64) {
        let beyond = change.missed - EXPLAINED - rate_rad_s * SCATTER_S;
        let unexplained = if change.larger < JUMP && change.missed > MOSTLY * change.larger {
            beyond.max(0.0)
        } else {
            0.0
        };
        self.current = if change.ended { 0.0 } else { unexplained };
        if change.ended && unexplained > 0.0 {
            // Bounded, so that it fades in time: a heading is off by half a turn at most.
            self.recent = (self.recent + unexplained).min(PI);
        } else if change.counts() {
            self.recent *= (-change.larger / FADES).exp();
        }
    }
}

impl GyroCheck {
    /// Takes a sample, and what the filter knows. Whether the sample has shown the gyro to be right. While iron may just have come or gone
    /// (`iron_open`) only a gyro that repeats its reading is judged: that predicts no change, whatever the iron.
    pub(super) fn take(&mut self, input: &Input, filter: &Filter, iron_open: bool) -> bool {
        let constant = input.board.gyro_constant_s > CONSTANT_S;
        if constant != self.constant {
            self.constant = constant;
            self.field.sums = Sums::default();
            self.gravity.sums = Sums::default();
        }
        let (turned_rad, dt) = (input.turned_rad, input.period_s);
        self.count_unseen(input);
        let strength = if filter.begun {
            filter.strength_mgauss().max(1.0)
        } else {
            FIELD_MGAUSS
        };
        let field = input.field_mgauss / strength;
        let disturbed = filter.begun && filter.disturbed();
        // At first the axes may be wrong. That looks like one disturbance after the other, and only a longer record shows it.
        if disturbed && !self.disturbed && self.was_right {
            self.scale.begin_anew();
        }
        self.disturbed = disturbed;
        if filter.odd() {
            // The field jumps, and not by turning.
            self.scale.lose_moment();
        }
        if !self.was_right {
            self.turns.take(input);
        }
        let silent = self.turns.gyro_is_silent();
        let mut judge = self.scale.take(input, filter) || silent;
        if let Some(force) = input.board.force_m_s2 {
            let up = force / GRAVITY_M_S2;
            if self.gravity.moment.is_none() {
                self.field_at_start = field;
                self.turned_rad = 0.0;
            }
            self.turned_rad += turned_rad.norm();
            if (up.norm() - 1.0).abs() > SHAKEN {
                self.gravity.moment = None;
            } else {
                if self.gravity.moment.is_none() {
                    self.axes.begin(up);
                } else {
                    self.axes.turn(&up, &turned_rad);
                }
                let change = self.gravity.take(up, up.cross(&turned_rad), dt);
                if change.counts() {
                    judge = true;
                    self.axes.end(up, change.larger);
                    self.compare(change.seen, &field);
                }
            }
        }
        // A gyro that repeats its reading is judged with unknown iron, too: a dead one predicts no change, whatever the iron.
        let known = constant || filter.iron_known_within(strength);
        if filter.begun && known {
            let matrix = filter.matrix();
            let Some(inverse) = matrix.try_inverse() else {
                return false;
            };
            let corrected = inverse * (input.field_mgauss - filter.bias_mgauss());
            let change = matrix * corrected.cross(&turned_rad) / strength;
            let change = self.field.take(field, change, dt);
            self.unexplained.take(&change, input.rate_rad_s.norm());
            judge |= change.counts();
        }
        if !judge || (iron_open && !constant && !silent) {
            return false;
        }
        let scale = self.scale.verdict();
        let fault = self.judged(scale);
        if self.fault.is_none() && fault.is_some_and(|fault| fault != GyroFault::Scale) {
            // What was seen before the fault must neither end it nor show the magnetometer to be the wrong one.
            self.scale.begin_anew();
            if self.axes.verdict == AxesVerdict::Right {
                self.axes = GyroAxes::default();
            }
        }
        self.fault = fault;
        let right = fault.is_none() && scale == ScaleVerdict::Right;
        if right {
            self.was_right = true;
            self.turns = FieldTurns::default();
        }
        right
    }

    /// Iron has come or gone, as far as is known: what the field has shown before is no evidence any more.
    pub(super) fn forget_field(&mut self) {
        self.field = Witness::default();
    }

    /// The gyro has a gap: what has changed meanwhile is no evidence against it.
    pub(super) fn lose_frame(&mut self) {
        (self.field.moment, self.gravity.moment) = (None, None);
        self.unexplained.current = 0.0;
        self.together = 0;
        self.scale.lose_moment();
        self.turns = FieldTurns::default();
    }

    /// A gyro that reads the same again and again does not see how the board turns.
    fn count_unseen(&mut self, input: &Input) {
        if input.board.gyro_constant_s == 0.0 {
            self.unseen_rad = 0.0;
            let share = (input.period_s / RATE_TAU_S).min(1.0);
            self.rate_rad_s += share * (input.rate_rad_s.norm() - self.rate_rad_s);
        } else if !input.board.still {
            self.unseen_rad = self.rate_rad_s * input.board.gyro_constant_s;
        }
    }

    /// What the field has turned lately against the gyro, as a share of it.
    pub(super) fn contradicted(&self) -> f64 {
        self.unexplained.recent + self.unexplained.current
    }

    /// How far the board may have turned without the gyro, radians.
    pub(super) fn unseen_rad(&self) -> f64 {
        self.unseen_rad
    }

    /// Gravity has changed by `seen` in a moment.
    fn compare(&mut self, seen: f64, field: &Vector3<f64>) {
        if self.turned_rad > SILENT * seen {
            self.together = 0;
        } else if seen > MOVED && (field - self.field_at_start).norm() > MOVED {
            self.together += 1;
        }
    }

    fn judged(&self, scale: ScaleVerdict) -> Option<GyroFault> {
        let constant = self.constant
            && (self.gravity.turns_alone()
                || self.field.turns_alone() && self.field.sums.count >= CONSTANT_CHANGES);
        // A rotation that is the same to the last bit, and not the one that field and gravity show.
        let frozen = self.constant
            && [&self.field, &self.gravity]
                .iter()
                .all(|witness| witness.sums.enough() && witness.sums.correlation() < AGREES);
        if self.together >= TOGETHER || constant || frozen || self.turns.gyro_is_silent() {
            return Some(GyroFault::Dead);
        }
        // The predicted change of the field depends on the filter's iron, which may be out of date, or learnt with a gyro of a wrong
        // scale. The check of the scale needs no iron, so it overrules the field. The field overrules gravity: on an arm that swings faster
        // than a pendulum of its length, the measured gravity tilts the opposite way.
        let field_agrees = self.field.agrees();
        let other_axes = self.axes.verdict == AxesVerdict::Wrong;
        let field_opposes = scale == ScaleVerdict::Opposed
            || (self.field.opposes(OPPOSES) && !self.scale.same_way());
        let told = self.fault == Some(GyroFault::AccelAxes) && !field_opposes;
        if other_axes && (field_agrees || scale == ScaleVerdict::Right || told) {
            return Some(GyroFault::AccelAxes);
        }
        let gravity_opposes = self.gravity.opposes(GRAVITY_OPPOSES) && !field_agrees;
        if other_axes || field_opposes || gravity_opposes {
            return Some(GyroFault::Sign);
        }
        // A fault is over when the gyro explains the field again. But a filter that was misled from the beginning agrees with what has
        // misled it.
        let over = |fault: &GyroFault| match fault {
            GyroFault::Scale => false,
            GyroFault::Dead => field_agrees,
            _ => field_agrees && self.was_right,
        };
        let lasts = |fault: &GyroFault| scale != ScaleVerdict::Right && !over(fault);
        let wrong = self.fault.filter(lasts);
        wrong.or((scale == ScaleVerdict::Wrong).then_some(GyroFault::Scale))
    }

    /// What is wrong, if anything is.
    pub(super) fn fault(&self) -> Option<GyroFault> {
        match self.fault {
            // Gravity turns as the gyro reads, so it is the field that does not.
            Some(GyroFault::Sign) if self.axes.verdict == AxesVerdict::Right => {
                Some(GyroFault::MagAxes)
            }
            fault => fault,
        }
    }
}
