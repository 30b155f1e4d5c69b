//! The gyro's bias: what the attitude has changed of it, and what a resting gyro reads.

use nalgebra::{Matrix3, SMatrix, Vector3};

use super::correct::HeldBack;
use super::{Filter, Input, State};
use crate::attitude::GyroBias;
use crate::estimate::covariance::{G, N, subtract};
use crate::frame::{add_variance, put};

/// A gyro at rest reads its bias within this over one second, rad/s (0.26°/s): several times the noise density of an ITG-3200, 0.03
/// °/s/√Hz, since a boat that swings slowly may pass for resting. With less, a simulated boat at anchor takes its swing for bias; with
/// more, north drifts further in hours of rest.
const REST_RATE_RAD_S: f64 = 0.0045;

/// Weight of the attitude's information on the bias. In simulation, the variance that the attitude states is right for a board that tumbles
/// or is moved by hand, and 3 to 17 times too small for boats and cars, which sway as they turn. With a quarter, recorded headings near a
/// magnet are off by 0.1° more; with all, by 0.2° less, but one resting board in twenty drifts by 0.3° more in 8 hours, beyond 3°.
const TAKEN: f64 = 0.4;

/// What the attitude has learnt of the gyro's bias from one sample to another, body axes.
pub struct BiasLearnt {
    /// Change of the bias that it takes out of the rates, rad/s.
    shift_rad_s: Vector3<f64>,
    /// Covariance afterwards, (rad/s)².
    covariance: Matrix3<f64>,
    /// The attitude has begun anew: it knows less than before.
    forgotten: bool,
    /// Variances that the attitude has added on each axis, (rad/s)²: the gyro may have been started again, or its bias has jumped; and its
    /// bias has walked.
    doubted2: f64,
    walked2: f64,
    /// What the attitude has measured of the bias that is left, times `TAKEN`: information matrix and vector. 0 if that does not count.
    information: Matrix3<f64>,
    information_vector: Vector3<f64>,
}

impl BiasLearnt {
    /// From one bias to a later one. Only the change itself counts unless it was `measured`.
    pub fn between(before: &GyroBias, after: &GyroBias, measured: bool) -> Self {
        let shift_rad_s = after.rad_s - before.rad_s;
        let walked2 = after.walked2 - before.walked2;
        let predicted = before.covariance + Matrix3::identity() * walked2;
        let mut learnt = Self {
            walked2,
            shift_rad_s,
            covariance: after.covariance,
            forgotten: after.begun_anew != before.begun_anew,
            doubted2: after.doubted2 - before.doubted2,
            information: Matrix3::zeros(),
            information_vector: Vector3::zeros(),
        };
        let unchanged = after.covariance == before.covariance;
        if !measured || unchanged || learnt.forgotten || learnt.doubted2 > 0.0 {
            return learnt;
        }
        let inverses = (predicted.try_inverse(), after.covariance.try_inverse());
        if let (Some(information_before), Some(information_after)) = inverses {
            learnt.information = (information_after - information_before) * TAKEN;
            learnt.information_vector = information_before * shift_rad_s * TAKEN;
        }
        learnt
    }

    /// The same change without what was measured.
    pub fn unmeasured(&self) -> Self {
        Self {
            information: Matrix3::zeros(),
            ..*self
        }
    }
}

impl Filter {
    /// Follows the attitude's bias: what it takes out of the rates, whether it has begun anew, and what it doubts.
    fn follow_gyro_bias(&mut self, learnt: &BiasLearnt) {
        if !self.begun || learnt.forgotten {
            self.restart(G..G + 3, 0.0);
            self.gyro_bias_walk.begin_window();
            put(&mut self.p, (G, G), &learnt.covariance);
            return;
        }
        // What the attitude takes out is no longer left.
        let mut left = self.x.fixed_rows_mut::<3>(G);
        left -= learnt.shift_rad_s;
        if learnt.doubted2 > 0.0 {
            self.gyro_bias_walk.doubt(learnt.doubted2);
            add_variance(&mut self.p, G..G + 3, learnt.doubted2);
        }
    }

    /// Follows the attitude's bias, and learns what the attitude has measured of it. With `walks`, the attitude's walk is added here, since
    /// this filter does not predict meanwhile. With `fixed`, hard iron and matrix stay as they are.
    pub fn take_gyro_bias(&mut self, learnt: &BiasLearnt, walks: bool, fixed: bool) {
        if walks {
            self.gyro_bias_walk.doubt(learnt.walked2);
            add_variance(&mut self.p, G..G + 3, learnt.walked2);
        }
        self.follow_gyro_bias(learnt);
        if !self.begun || learnt.information == Matrix3::zeros() {
            return;
        }
        let cross: SMatrix<f64, N, 3> = self.p.fixed_columns::<3>(G).into();
        let own: Matrix3<f64> = cross.fixed_rows::<3>(G).into();
        let Some(weight) = (Matrix3::identity() + learnt.information * own).try_inverse() else {
            return;
        };
        let held = HeldBack::parameters(fixed);
        self.correct_partly(&held, |filter| {
            let off = learnt.information_vector - learnt.information * filter.vector(G);
            filter.x += cross * (weight * off);
            let gain = cross * (weight * learnt.information);
            subtract(&mut filter.p, &gain, &cross);
        });
    }

    /// Learns the gyro's bias at rest, and measures its noise. With `fixed`, hard iron and matrix stay as they are.
    pub(super) fn learn_bias_at_rest(&mut self, input: &Input, fixed: bool) {
        let turned_rad = input.turned_rad - self.vector(G) * input.period_s;
        self.rest
            .take(turned_rad, input.period_s, self.trace(G, 3) / 3.0);
        let variance = REST_RATE_RAD_S.powi(2) / input.period_s;
        let held = HeldBack::parameters(fixed);
        self.correct_partly(&held, |filter| {
            for axis in 0..3 {
                let innovation = input.rate_rad_s[axis] - filter.x[G + axis];
                let column: State = filter.p.column(G + axis).into();
                filter.correct_by_scalar(innovation, &column, column[G + axis] + variance);
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, Rotation3};

    use super::*;
    use crate::estimate::prior::Prior;

    /// The iron is correlated with the gyro's bias, which the filter learns at rest.
    #[test]
    fn fixed_iron_stays_while_the_gyro_shows_its_bias() {
        let earth = Vector3::new(60.0, 190.0, -420.0);
        let iron = Vector3::new(90.0, -40.0, 150.0);
        let gyro_bias = Vector3::new(0.0, 0.0, 0.03);
        let learnt = |fixed: bool| {
            let mut filter = Filter::new(&Prior::unknown()).unsure_of_gyro();
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
            let parameters = |filter: &Filter| (filter.bias_mgauss(), filter.matrix());
            let before = parameters(&filter);
            for _ in 0..20 {
                let field = to_frame.transpose() * earth + iron;
                let resting = Input::turning_at(to_frame, gyro_bias, field).resting();
                filter.follow(&resting, false, fixed);
            }
            (before, parameters(&filter))
        };
        let (before, after) = learnt(true);
        assert_eq!(before, after);
        let (before, after) = learnt(false);
        assert_ne!(before, after);
    }

    /// A filter that has begun, and knows what the attitude does of the gyro.
    fn begun_with(bias: &GyroBias) -> Filter {
        let mut filter = Filter::new(&Prior::unknown());
        filter.take_gyro_bias(&BiasLearnt::between(bias, bias, false), false, false);
        filter.begun = true;
        filter
    }

    #[test]
    fn what_the_attitude_learns_counts_in_part_and_its_doubts_in_full() {
        let before = GyroBias {
            covariance: Matrix3::identity() * 0.05f64.powi(2),
            ..GyroBias::default()
        };
        let after = GyroBias {
            rad_s: Vector3::new(0.03, 0.0, -0.02),
            covariance: Matrix3::identity() * 0.01f64.powi(2),
            ..before
        };
        let mut filter = begun_with(&before);
        filter.take_gyro_bias(&BiasLearnt::between(&before, &after, true), false, false);
        // The attitude's bias is the mean of what it had and of what it measured, each weighted by its information.
        let (had, gained) = (1.0 / 0.05f64.powi(2), 1.0 / 0.01f64.powi(2));
        let information = had + TAKEN * (gained - had);
        let (left, variance) = filter.gyro_bias();
        assert!((variance * information).add_scalar(-1.0).amax() < 1e-9);
        let measured = after.rad_s * gained / (gained - had);
        let expected = measured * (TAKEN * (gained - had)) / information - after.rad_s;
        assert!((left - expected).norm() < 1e-9, "{left} {expected}");

        let walked2 = 0.0007f64.powi(2);
        let walked = GyroBias {
            covariance: after.covariance + Matrix3::identity() * walked2,
            walked2,
            ..after
        };
        filter.take_gyro_bias(&BiasLearnt::between(&after, &walked, true), false, false);
        let (still_left, same) = filter.gyro_bias();
        assert!((still_left - left).norm() < 1e-12 && (same - variance).norm() < 1e-12);

        let doubted2 = 0.006f64.powi(2);
        let doubted = GyroBias {
            covariance: walked.covariance + Matrix3::identity() * doubted2,
            doubted2,
            ..walked
        };
        let doubts = BiasLearnt::between(&walked, &doubted, true);
        assert!(!doubts.forgotten);
        filter.take_gyro_bias(&doubts, false, false);
        let (still_left, more) = filter.gyro_bias();
        assert!((still_left - left).norm() < 1e-12);
        let expected = same.add_scalar(doubted2);
        assert!((more - expected).amax() < 1e-12, "{more} {expected}");
    }

    #[test]
    fn an_attitude_that_begins_anew_knows_less_and_so_does_the_filter() {
        let certain = GyroBias {
            rad_s: Vector3::new(0.1, 0.0, 0.0),
            covariance: Matrix3::identity() * 0.005f64.powi(2),
            ..GyroBias::default()
        };
        let anew = GyroBias {
            covariance: Matrix3::identity() * 0.05f64.powi(2),
            begun_anew: 1,
            ..GyroBias::default()
        };
        let mut filter = begun_with(&certain);
        filter.take_gyro_bias(&BiasLearnt::between(&certain, &anew, true), false, false);
        assert_eq!(
            filter.gyro_bias(),
            (Vector3::zeros(), anew.covariance.diagonal())
        );
    }

    #[test]
    fn before_the_filter_has_begun_it_knows_as_much_as_the_attitude() {
        let bias = GyroBias {
            rad_s: Vector3::new(0.03, 0.0, -0.02),
            covariance: Matrix3::identity() * 0.02f64.powi(2),
            ..GyroBias::default()
        };
        let mut filter = begun_with(&bias);
        assert_eq!(filter.gyro_bias().1, bias.covariance.diagonal());
        // The filter reads the bias of a still board itself, so what the attitude learns then does not count.
        let known = GyroBias {
            covariance: bias.covariance * 0.01,
            ..bias
        };
        filter.take_gyro_bias(&BiasLearnt::between(&bias, &known, false), false, false);
        assert_eq!(filter.gyro_bias().1, bias.covariance.diagonal());
    }
}
