//! The gyro's bias: what the attitude has changed of it, and what a resting gyro reads.

use nalgebra::{SVector, Vector3};

use super::{Filter, Input, State};
use crate::estimate::covariance::{G, subtract};

/// A gyro at rest reads its bias within this over one second, rad/s (0.3°/s): four times the noise of an ITG-3200, since a boat that
/// swings slowly may pass for resting.
const REST_RATE_RAD_S: f64 = 0.0052;

impl Filter {
    /// The gyro's filter has changed its own bias by this much, body axes, rad/s: what is left changes the other way.
    pub(in crate::estimate) fn shift_gyro_bias(&mut self, by_rad_s: &Vector3<f64>) {
        for axis in 0..3 {
            self.x[G + axis] -= by_rad_s[axis];
        }
    }

    /// Learns the gyro's bias at rest, and measures its noise. With `frozen`, hard iron and matrix stay as they are.
    pub(super) fn learn_bias_at_rest(&mut self, input: &Input, frozen: bool) {
        let before = frozen.then(|| (self.parameters(), self.parameter_covariance()));
        let turned_rad = input.turned_rad - self.vector(G) * input.period_s;
        self.rest
            .take(turned_rad, input.period_s, self.trace(G, 3) / 3.0);
        let variance = REST_RATE_RAD_S.powi(2) / input.period_s;
        for axis in 0..3 {
            let innovation = input.rate_rad_s[axis] - self.x[G + axis];
            let column: State = self.p.column(G + axis).into();
            let gain = column / (column[G + axis] + variance);
            self.x += gain * innovation;
            subtract(&mut self.p, &gain, &column);
        }
        if let Some((parameters, covariance)) = before {
            self.hold(&SVector::repeat(1.0), &parameters, &covariance);
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, Rotation3};

    use super::*;
    use crate::estimate::prior::Prior;

    /// The iron is correlated with the gyro's bias, which the filter learns at rest.
    #[test]
    fn frozen_iron_stays_while_the_gyro_shows_its_bias() {
        let earth = Vector3::new(60.0, 190.0, -420.0);
        let iron = Vector3::new(90.0, -40.0, 150.0);
        let gyro_bias = Vector3::new(0.0, 0.0, 0.03);
        let learnt = |frozen: bool| {
            let mut filter = Filter::new(&Prior::unknown());
            let rate = Vector3::z() * 0.5;
            let mut to_frame = Matrix3::identity();
            for step in 0..100 {
                let turned = Rotation3::new(rate * 0.1 * f64::from(step));
                to_frame = Rotation3::new((rate + gyro_bias) * 0.1 * f64::from(step)).into_inner();
                let field = turned.inverse() * earth + iron;
                filter.follow(
                    &Input::turning_at(to_frame, rate + gyro_bias, field),
                    false,
                    false,
                );
            }
            let before = filter.parameters();
            for _ in 0..20 {
                let resting = Input {
                    at_rest: true,
                    still: true,
                    ..Input::turning_at(to_frame, gyro_bias, to_frame.transpose() * earth + iron)
                };
                filter.follow(&resting, false, frozen);
            }
            (before, filter.parameters())
        };
        let (before, after) = learnt(true);
        assert_eq!(before, after);
        let (before, after) = learnt(false);
        assert_ne!(before, after);
    }
}
