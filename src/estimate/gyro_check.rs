//! Whether gyro, field and gravity agree on how the board turns.
//!
//! A field that stands still turns against the board as the gyro reads, and iron on the board adds a constant. So the
//! change of the raw field over a moment is compared with the change that the gyro predicts: a gyro of the wrong sign predicts the
//! opposite. Gravity turns in the same way, and no iron moves it: where both have turned and the gyro has not, the gyro is dead,
//! whatever it reads. `witness` compares a vector's change with the gyro's prediction, `unexplained` sums field change that the gyro does
//! not explain, `shaking` tells whether what the accelerometer measures is gravity, `scale` checks the scale, `axes` the axes, and
//! `field_turns` counts turns that the gyro does not see. Of gyro, field and gravity, the one that turns another way than the other two is
//! wrong.

use nalgebra::Vector3;

use super::filter::{Filter, Input};
use super::prior::FIELD_MGAUSS;
use crate::attitude::GRAVITY_M_S2;
use crate::reading::WEAKEST_MGAUSS;

mod axes;
mod field_turns;
mod scale;
mod shaking;
mod unexplained;
mod witness;

use axes::GyroAxes;
use field_turns::FieldTurns;
use scale::GyroScale;
use shaking::Shaking;
use unexplained::Unexplained;
use witness::Witness;

/// Readings that are the same to the last bit are a real rotation, that of a turntable, only above this correlation.
const CONSTANT_CORRELATES: f64 = 0.5;
/// A gyro is dead when gravity and field have moved together so often in a row, each by so much of itself (6°), without it. A car that
/// brakes moves gravity, one that passes it the field; both at once is a coincidence.
const TOGETHER: u32 = 3;
const MOVED: f64 = 0.1;
/// A gyro that turns by less than this share of what gravity and field do is silent.
const SILENT: f64 = 0.3;
/// Readings of the gyro that are the same to the last bit for this long, seconds, may be no measurement.
const CONSTANT_S: f64 = 0.5;
/// Number of changes that rule out a magnet placed beside a board at rest, which makes one or two.
const CONSTANT_CHANGES: u32 = 3;

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

/// What gravity says of the gyro's axes, or the field of its scale.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum GyroVerdict {
    #[default]
    Unknown,
    Right,
    Wrong,
    /// The gyro turns another way. Only the field says so.
    Opposed,
}

/// Compares the gyro with the field and with gravity.
#[derive(Clone, Debug, Default)]
pub(super) struct GyroCheck {
    field: Witness,
    gravity: Witness,
    shaking: Shaking,
    axes: GyroAxes,
    unexplained: Unexplained,
    /// The field when gravity's moment began, milligauss, how far the gyro has turned since, radians, and how often both have moved without
    /// it.
    field_at_start: Vector3<f64>,
    turned_rad: f64,
    together: u32,
    constant: bool,
    fault: Option<GyroFault>,
    scale: GyroScale,
    /// How far the gyro's scale is from 1, if that is probably more than a right gyro's, though perhaps not certainly; else 0.
    pub(super) suspected_scale: f64,
    /// The field's turns, until the gyro has been shown to be right: later a magnet that turns beside the board is the likelier cause.
    turns: FieldTurns,
    was_right: bool,
    /// Whether the field was disturbed at the last sample.
    disturbed: bool,
    /// Mean rate while the readings differ, rad/s, and how far the board may have turned since they repeat, radians.
    rate_rad_s: f64,
    pub(super) unseen_rad: f64,
}

impl GyroCheck {
    /// Takes a sample, and what the filter knows. Returns whether this sample proves the gyro right. While iron may just have come or gone
    /// (`iron_open`), only a gyro that repeats its reading or misses the field's turns is judged: neither depends on the iron.
    pub(super) fn take(&mut self, input: &Input, filter: &Filter, iron_open: bool) -> bool {
        let constant = input.board.gyro_constant_s > CONSTANT_S;
        if constant != self.constant {
            self.constant = constant;
            self.field.forget();
            self.gravity.forget();
        }
        self.count_unseen(input);
        let strength = if filter.begun {
            filter.strength_mgauss().max(1.0)
        } else {
            FIELD_MGAUSS
        };
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
        let by_scale = self.scale.take(input, filter);
        let by_gravity = self.take_gravity(input, strength);
        let Some(by_field) = self.take_field(input, filter, strength) else {
            return false;
        };
        let judge = by_scale || by_gravity || silent || by_field;
        if !judge || (iron_open && !self.constant && !silent) {
            return false;
        }
        self.conclude()
    }

    /// Decides what is wrong with the gyro. Whether it is shown to be right.
    fn conclude(&mut self) -> bool {
        let scale = self.scale.verdict();
        self.suspected_scale = self.scale.suspected(self.was_right);
        let fault = self.judged(scale);
        if self.fault.is_none() && fault.is_some_and(|fault| fault != GyroFault::Scale) {
            // What was seen before the fault must neither end it nor show the magnetometer to be the wrong one.
            self.scale.begin_anew();
            if self.axes.verdict == GyroVerdict::Right {
                self.axes = GyroAxes::default();
            }
        }
        self.fault = fault;
        let right = fault.is_none() && scale == GyroVerdict::Right;
        if right {
            self.was_right = true;
            self.turns = FieldTurns::default();
        }
        right
    }

    /// Compares how the field turns with the gyro. Whether the sample ended a moment that counts; `None` if D has no inverse.
    fn take_field(&mut self, input: &Input, filter: &Filter, strength: f64) -> Option<bool> {
        // A gyro that repeats its reading is judged with unknown iron, too: a dead one predicts no change, whatever the iron.
        let known = self.constant || filter.iron_known_within(strength);
        if !filter.begun || !known {
            return Some(false);
        }
        let matrix = filter.matrix();
        let corrected = matrix.try_inverse()? * (input.field_mgauss - filter.bias_mgauss());
        let change = matrix * corrected.cross(&input.turned_rad) / strength;
        let field = input.field_mgauss / strength;
        let change = self.field.take(field, change, input.period_s);
        self.unexplained
            .take(&change, input.rate_rad_s.norm(), &input.to_frame);
        Some(change.counts())
    }

    /// Compares how gravity turns with the gyro, and with the field, whose strength is this, milligauss. Whether the sample ended a moment that
    /// counts.
    fn take_gravity(&mut self, input: &Input, strength: f64) -> bool {
        let (turned_rad, dt) = (input.turned_rad, input.period_s);
        let Some(force) = input.board.force_m_s2 else {
            self.gravity.lose_moment();
            return false;
        };
        let up = force / GRAVITY_M_S2;
        if !self.shaking.take(&up, &input.rate_rad_s, dt) {
            self.gravity.lose_moment();
            return false;
        }
        if self.gravity.begins() {
            self.field_at_start = input.field_mgauss;
            self.turned_rad = 0.0;
            self.axes.begin(up);
        } else {
            self.turned_rad += turned_rad.norm();
            self.axes.turn(&up, &turned_rad);
        }
        let change = self.gravity.take(up, up.cross(&turned_rad), dt);
        if change.counts() {
            self.axes.end(up, change.larger);
            // A filter that has just begun may believe in a weaker field than any on earth, of which noise is a large share.
            let strength = strength.max(WEAKEST_MGAUSS);
            let by_field = (input.field_mgauss - self.field_at_start).norm() / strength;
            self.count_together(change.seen.norm(), by_field);
        }
        change.counts()
    }

    /// Iron has come or gone, as far as is known: what the field has shown before is no evidence any more.
    pub(super) fn forget_field(&mut self) {
        self.field = Witness::default();
    }

    /// The gyro has a gap: what has changed meanwhile is no evidence against it.
    pub(super) fn lose_frame(&mut self) {
        self.field.lose_moment();
        self.gravity.lose_moment();
        self.unexplained.lose_moment();
        self.together = 0;
        self.scale.lose_moment();
        self.turns = FieldTurns::default();
    }

    /// Counts the rotation that a repeating gyro may miss, until its reading changes.
    fn count_unseen(&mut self, input: &Input) {
        if input.board.gyro_constant_s == 0.0 {
            self.unseen_rad = 0.0;
            let share = (input.period_s / RATE_TAU_S).min(1.0);
            self.rate_rad_s += share * (input.rate_rad_s.norm() - self.rate_rad_s);
        } else if !input.board.still {
            self.unseen_rad = self.rate_rad_s * input.board.gyro_constant_s;
        }
    }

    /// Recent field change that the gyro does not explain, as a share.
    pub(super) fn contradicted(&self) -> f64 {
        self.unexplained.share()
    }

    /// Gravity and field have changed by these shares in a moment.
    fn count_together(&mut self, gravity: f64, field: f64) {
        if self.turned_rad > SILENT * gravity {
            self.together = 0;
        } else if gravity.min(field) > MOVED && self.turned_rad < SILENT * field {
            self.together += 1;
        }
    }

    fn judged(&self, scale: GyroVerdict) -> Option<GyroFault> {
        let no_measurement = || {
            let alone = self.gravity.turns_alone()
                || self.field.turns_alone() && self.field.count() >= CONSTANT_CHANGES;
            // A rotation that is the same to the last bit, and not the one that field and gravity show.
            let uncorrelated = |witness: &Witness| witness.correlates_below(CONSTANT_CORRELATES);
            alone || uncorrelated(&self.field) && uncorrelated(&self.gravity)
        };
        let dead = self.together >= TOGETHER || self.turns.gyro_is_silent();
        if dead || self.constant && no_measurement() {
            return Some(GyroFault::Dead);
        }
        // The predicted change of the field depends on the filter's iron, which may be out of date, or learnt with a gyro of a wrong
        // scale. The check of the scale needs no iron, so it overrules the field.
        let field_agrees = self.field.agrees();
        let other_axes = self.axes.verdict == GyroVerdict::Wrong;
        let field_opposes = scale == GyroVerdict::Opposed;
        let still_accel_axes = self.fault == Some(GyroFault::AccelAxes) && !field_opposes;
        if other_axes && (field_agrees || scale == GyroVerdict::Right || still_accel_axes) {
            return Some(GyroFault::AccelAxes);
        }
        if other_axes || field_opposes {
            return Some(GyroFault::Sign);
        }
        // A fault is over when the gyro explains the field again. But a filter that was misled from the beginning agrees with what has
        // misled it.
        let over = |fault: &GyroFault| match fault {
            GyroFault::Scale => false,
            GyroFault::Dead => field_agrees,
            _ => field_agrees && self.was_right,
        };
        let lasts = |fault: &GyroFault| scale != GyroVerdict::Right && !over(fault);
        let wrong = self.fault.filter(lasts);
        wrong.or((scale == GyroVerdict::Wrong).then_some(GyroFault::Scale))
    }

    /// What is wrong, if anything is.
    pub(super) fn fault(&self) -> Option<GyroFault> {
        match self.fault {
            // Gravity turns as the gyro reads, so it is the field that does not.
            Some(GyroFault::Sign) if self.axes.verdict == GyroVerdict::Right => {
                Some(GyroFault::MagAxes)
            }
            fault => fault,
        }
    }
}
