//! Whether gyro and field tell the same of how the board turns.
//!
//! The field moves across the board as the gyro says that the board turns, whatever iron is on it: iron adds a constant.
//! So the change of the raw field over a moment is held against the change that the gyro predicts. Over the
//! last turns, the slope of the one over the other is 1; a gyro of the wrong sign has −1, one that is 10 % off 1.1.

use nalgebra::Vector3;

use super::filter::{Filter, Input};

/// Changes are taken over this time, seconds: a turn of a few degrees is larger than the noise, and less than a radian.
const MOMENT_S: f64 = 0.25;
/// So much change of the field must have been seen before anything is said, as a share of the field, squared and summed:
/// two radians' worth.
const ENOUGH: f64 = 1.0;
/// Evidence fades over as much change.
const MEMORY: f64 = 4.0;
/// A slope further from 1 is a gyro with a wrong scale; below this, or above the other, field and gyro do not belong together at all.
const SCALE_TOLERANCE: f64 = 0.07;
/// Share of the field's change that the gyro explains, below which it explains nothing.
const EXPLAINS: f64 = 0.5;
/// Readings that are the same to the last bit for this long, seconds, while the field moves, are no measurement.
const FROZEN_S: f64 = 1.0;

/// What is wrong with the gyro.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GyroFault {
    /// It shows no motion where the field shows some.
    Dead,
    /// Its axes or signs are wrong.
    Axes,
    /// Its scale is off by more than 5 %.
    Scale,
}

impl GyroFault {
    /// The code that programs read.
    pub fn reason(self) -> &'static str {
        match self {
            Self::Dead => "gyro_dead",
            Self::Axes => "gyro_axes",
            Self::Scale => "gyro_scale",
        }
    }
}

/// Holds the gyro against the field.
#[derive(Clone, Debug, Default)]
pub(super) struct GyroCheck {
    start: Option<Start>,
    /// Sums over the moments: observed², predicted², observed · predicted, in shares of the field squared.
    observed2: f64,
    predicted2: f64,
    both: f64,
    same_s: f64,
    rate: Vector3<f64>,
    fault: Option<GyroFault>,
}

#[derive(Clone, Copy, Debug)]
struct Start {
    age_s: f64,
    field: Vector3<f64>,
    predicted: Vector3<f64>,
}

impl GyroCheck {
    /// Takes a sample, and what the filter knows.
    pub(super) fn take(&mut self, input: &Input, filter: &Filter) {
        if input.rate_rad_s == self.rate {
            self.same_s += input.period_s;
        } else {
            (self.same_s, self.rate) = (0.0, input.rate_rad_s);
        }
        if !filter.begun() || filter.least_known_mgauss() > 0.3 * filter.strength_mgauss() {
            return;
        }
        let predicted = filter.matrix() * (input.to_frame.transpose() * filter.field());
        let Some(start) = &mut self.start else {
            self.start = Some(Start {
                age_s: 0.0,
                field: input.field_mgauss,
                predicted,
            });
            return;
        };
        start.age_s += input.period_s;
        if start.age_s < MOMENT_S {
            return;
        }
        let strength = filter.strength_mgauss();
        let seen = (input.field_mgauss - start.field) / strength;
        let told = (predicted - start.predicted) / strength;
        self.start = Some(Start {
            age_s: 0.0,
            field: input.field_mgauss,
            predicted,
        });
        // A field that moves by less is noise.
        if seen.norm().max(told.norm()) < 0.05 || seen.norm().max(told.norm()) > 1.0 {
            return;
        }
        let weight = seen.norm_squared().max(told.norm_squared());
        let keep = (-weight / MEMORY).exp();
        self.observed2 = self.observed2 * keep + seen.norm_squared();
        self.predicted2 = self.predicted2 * keep + told.norm_squared();
        self.both = self.both * keep + seen.dot(&told);
        self.judge();
    }

    fn judge(&mut self) {
        self.fault = None;
        if self.observed2.max(self.predicted2) < ENOUGH {
            return;
        }
        let slope = self.both / self.observed2.max(1e-9);
        let agreement = self.both / (self.observed2 * self.predicted2).sqrt().max(1e-9);
        if self.same_s > FROZEN_S && self.predicted2 < 0.2 * self.observed2 {
            self.fault = Some(GyroFault::Dead);
        } else if agreement < -EXPLAINS {
            self.fault = Some(GyroFault::Axes);
        } else if agreement > 0.97 && (slope - 1.0).abs() > SCALE_TOLERANCE {
            self.fault = Some(GyroFault::Scale);
        }
    }

    /// What is wrong, if anything is.
    pub(super) fn fault(&self) -> Option<GyroFault> {
        self.fault
    }
}
