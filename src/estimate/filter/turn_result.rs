//! Puts the result of a full turn into the filter.

use super::{Filter, Input, State, USUAL_UNEVENNESS};
use crate::estimate::covariance::{B, D, H};
use crate::estimate::prior::Measured;
use crate::frame::{put, variance_along};

impl Filter {
    /// Replaces the parameters that a turn has measured. The filter has already used these samples, so it first forgets what it knew of
    /// these parameters: no sample counts twice.
    pub fn replace(&mut self, measured: &[Measured], input: &Input) {
        for one in measured {
            let weights = one.weights();
            let mut parameters = self.p.fixed_view_mut::<12, 12>(B, B);
            parameters += weights * weights.transpose() * one.inflation;
        }
        // The turn was accepted, so the field was even all the way round.
        for variance in [
            &mut self.unevenness2,
            &mut self.mean_unevenness2,
            &mut self.place2,
        ] {
            *variance = variance.min(USUAL_UNEVENNESS.powi(2));
        }
        self.restart_frame(input);
        self.learn_all(measured);
    }

    /// Variance of what a turn has measured, as far as it is known here.
    pub fn variance_of(&self, measured: &Measured) -> f64 {
        variance_along(&self.p, &self.jacobian_of(measured))
    }

    fn jacobian_of(&self, measured: &Measured) -> State {
        let mut jacobian = State::zeros();
        put(&mut jacobian, (B, 0), &measured.weights());
        jacobian[H + 2] = measured.up;
        if let Some(across) = measured.across {
            // The turn was level: the normal of its plane is vertical. Body Z points down where the frame's Z points up.
            let field = -across.z * self.x[H + 2];
            for row in 0..3 {
                for column in 0..3 {
                    jacobian[D + 3 * row + column] += measured.bias[row] * across[column] * field;
                }
            }
        }
        jacobian
    }

    /// Updates the state by what a turn has measured.
    pub(super) fn learn_all(&mut self, measured: &[Measured]) {
        for one in measured {
            let jacobian = self.jacobian_of(one);
            let predicted = jacobian.dot(&self.x);
            let cross = self.p * jacobian;
            let variance = jacobian.dot(&cross) + one.variance;
            self.correct_by_scalar(one.value - predicted, &cross, variance);
        }
    }
}
