//! The filter's correction by one sample.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use super::{FORGET_MOVING_S, Filter, Input, JITTER_S, LAG_RANGE_S};
use crate::estimate::covariance::{B, D, G, H, M, N, S, SampleJacobian, T, subtract};
use crate::estimate::prior::SCALE;
use crate::reading::STRONGEST_MGAUSS;

/// The normalised innovation squared is averaged over this time, seconds.
const CONSISTENCY_S: f64 = 2.0;
/// Largest value of one sample in that average.
const CONSISTENCY_MOST: f64 = 50.0;
/// Two odd innovations are alike if they differ by less than this share.
const ALIKE: f64 = 0.5;
/// The filter observes the tilt error mainly through the vertical field. So the tilt error corrects the field in the Jacobian only as far
/// as the vertical field is known: by half if its deviation is this share of it, and not at all at the magnetic equator. Without this limit
/// a car's first turns converge to a wrong vertical field and a tilt that matches it. With half the value a car that turns fast learns the
/// vertical field too late to be sure of its heading.
const VERTICAL_KNOWN: f64 = 0.0625;
/// Gate on the normalised innovation squared: chance exceeds it in 0.1 % of samples (3 degrees of freedom).
const GATE: f64 = 16.0;
/// Smaller shares count as 0, which saves a sixth of the estimate's time once the field is known.
const LEAST_HELD: f64 = 0.01;
/// The states from b to G.
const HELD: usize = S - B;

/// The share of a correction that each group of states does not receive, 0 to 1.
pub(super) struct HeldBack {
    pub(super) iron: f64,
    pub(super) matrix: f64,
    pub(super) gyro_bias: f64,
}

impl HeldBack {
    /// With `fixed`, hard iron and matrix stay as they are.
    pub(super) fn parameters(fixed: bool) -> Self {
        Self {
            iron: f64::from(fixed),
            matrix: f64::from(fixed),
            gyro_bias: 0.0,
        }
    }

    /// The shares of the states from b to G; M and T are among them and are corrected in full.
    fn shares(&self) -> SVector<f64, HELD> {
        SVector::from_fn(|index, _| {
            let share = match B + index {
                B..D => self.iron,
                D..M => self.matrix,
                M..G => 0.0,
                _ => self.gyro_bias,
            };
            if share < LEAST_HELD { 0.0 } else { share }
        })
    }
}

/// The share of the first in the sum, 0 to 1.
fn share(one: f64, other: f64) -> f64 {
    one / (one + other).max(f64::MIN_POSITIVE)
}

impl Filter {
    /// Takes the sample in.
    pub(super) fn correct(&mut self, input: &Input, fixed: bool) {
        let (r, dt) = (input.to_frame, input.period_s);
        let (predicted, innovation) = self.predicted(input);
        let jacobian = if input.board.still {
            // On a still board the Jacobian leaves out the estimates of unevenness, place and tilt error: they follow the innovation, and
            // the correlation would turn the field steadily, by 10° in some hours of a field that swells by 1 %.
            self.jacobian(input, &self.vector(H), &Vector3::zeros())
        } else {
            predicted
        };
        let mut cross = jacobian.cross(&self.p);
        let white = self.white_noise2(&input.turn_rate());
        let weigh = |cross: &_| {
            let s = jacobian.innovation_covariance(cross) + Matrix3::identity() * white;
            let inverse = s.try_inverse()?;
            let weighted = inverse * innovation;
            Some((s, inverse, weighted, innovation.dot(&weighted)))
        };
        let Some((mut s, mut inverse, mut weighted, mut squared)) = weigh(&cross) else {
            return;
        };
        self.measure_noise(&innovation, dt);
        self.jumped = false;
        self.jumps_mgauss *= (-dt / FORGET_MOVING_S).exp();
        self.odd_mgauss = Vector3::zeros();
        let squared_at_first = squared;
        if squared > GATE {
            if !self.record_odd(&innovation, &r) {
                self.whiteness.interrupt();
                // A rejected sample is explained no better than one at the gate.
                self.log_likelihood -= 0.5 * (GATE + s.determinant().ln());
                return;
            }
            // It is taken for unevenness of the field here, until turning shows otherwise.
            let jump = innovation.norm_squared();
            for axis in 0..3 {
                self.p[(M + axis, M + axis)] += jump;
                let mut row = cross.row_mut(M + axis);
                row += jacobian.field.column(axis).transpose() * jump;
            }
            let Some(again) = weigh(&cross) else {
                return;
            };
            (s, inverse, weighted, squared) = again;
        } else {
            self.odd = None;
        }
        // On a still board a large innovation means that the surroundings have changed. It is no test of the parameters.
        if input.board.still {
            self.whiteness.interrupt();
        } else {
            self.whiteness.take(&innovation, &weighted, dt);
            let now = (squared_at_first / 3.0).min(CONSISTENCY_MOST);
            self.consistency += (dt / CONSISTENCY_S).min(1.0) * (now - self.consistency);
        }
        self.log_likelihood -= 0.5 * (squared + s.determinant().ln());
        self.update(&(cross * inverse), &cross, &innovation, fixed);
    }

    /// Whether a sample that is not taken is beyond the gate.
    pub fn is_odd(&self, input: &Input) -> bool {
        let (innovation, covariance) = self.foresee(input);
        let white = self.white_noise2(&input.turn_rate());
        let inverse = (covariance + Matrix3::identity() * white).try_inverse();
        inverse.is_some_and(|inverse| innovation.dot(&(inverse * innovation)) > GATE)
    }

    /// The innovation of a sample that is not taken, body axes, milligauss, and its covariance but for the noise of samples, milligauss².
    pub fn foresee(&self, input: &Input) -> (Vector3<f64>, Matrix3<f64>) {
        let (predicted, innovation) = self.predicted(input);
        let covariance = predicted.innovation_covariance(&predicted.cross(&self.p));
        (innovation, covariance)
    }

    /// How the sample depends on the states as they are, and the innovation, body axes, milligauss.
    fn predicted(&self, input: &Input) -> (SampleJacobian, Vector3<f64>) {
        let predicted = self.jacobian(input, &self.field_here(), &self.tilt_rad());
        let innovation = input.field_mgauss - self.matrix() * predicted.body_field - self.vector(B);
        (predicted, innovation)
    }

    /// How the sample depends on the states where field and tilt error are these, in the frame. The predicted sample is
    /// `matrix · body_field + bias`.
    fn jacobian(&self, input: &Input, here: &Vector3<f64>, tilt: &Vector3<f64>) -> SampleJacobian {
        let w = input.turn_rate();
        let to_body = input.to_frame.transpose();
        let lag = self.x[T] - input.lag_s;
        let matrix = self.matrix();
        let body = to_body * (here + tilt.cross(here));
        // First order in what `input.lag_s` leaves of the lag: the field in body axes when the magnetometer measured.
        let body_rate = w.cross(&body);
        let by_field = matrix
            * (Matrix3::identity() + w.cross_matrix() * lag)
            * to_body
            * (Matrix3::identity() + tilt.cross_matrix() * self.tilt_worth());
        let by_tilt = by_field * -self.tilted(here).cross_matrix();
        SampleJacobian {
            field: by_field,
            tilt: [by_tilt.column(0).into(), by_tilt.column(1).into()],
            lag: matrix * body_rate,
            body_field: body + body_rate * lag,
        }
    }

    /// The field in the tilt's Jacobian: its vertical part is √(z² + P_zz), at most the strongest field on earth. So it covers the product
    /// of both errors, which lasts as long as the tilt error and is no white noise.
    fn tilted(&self, here: &Vector3<f64>) -> Vector3<f64> {
        if !self.vertical_known {
            return *here;
        }
        let known2 = here.z * here.z;
        let most2 = known2.max(STRONGEST_MGAUSS.powi(2));
        let vertical = (known2 + self.p[(H + 2, H + 2)]).min(most2).sqrt();
        Vector3::new(here.x, here.y, vertical.copysign(here.z))
    }

    /// Variance of what is white in a sample of a board that turns at this rate, rad/s: noise, jitter, and the product of the field's and
    /// the matrix's errors, which linearising neglects. Milligauss².
    fn white_noise2(&self, rate_rad_s: &Vector3<f64>) -> f64 {
        let neglected = self.trace(H, 3) * self.matrix_variance();
        let jitter = rate_rad_s.norm() * JITTER_S * self.strength_rms_mgauss;
        self.noise2 + neglected + jitter.powi(2)
    }

    /// Records an innovation beyond the gate. Returns whether the field has jumped: one odd sample is a spike, two alike are a change.
    fn record_odd(&mut self, innovation: &Vector3<f64>, to_frame: &Matrix3<f64>) -> bool {
        let again = self
            .odd
            .is_some_and(|odd| (innovation - odd).norm() < ALIKE * innovation.norm());
        self.odd = Some(*innovation);
        if again {
            self.jumped = true;
            self.jumps_mgauss += to_frame * innovation;
        } else {
            self.odd_mgauss = to_frame * innovation;
        }
        again
    }

    /// x ← x + K ν, P ← P − K Cᵀ. D and G are corrected only in part, and b too while innovations repeat (`whiteness`). With `fixed`, b and
    /// D stay.
    fn update(
        &mut self,
        gain: &SMatrix<f64, N, 3>,
        cross: &SMatrix<f64, N, 3>,
        innovation: &Vector3<f64>,
        fixed: bool,
    ) {
        let repeats = self.whiteness.held();
        let held = HeldBack {
            iron: repeats.max(f64::from(fixed)),
            matrix: self.matrix_held().max(repeats).max(f64::from(fixed)),
            gyro_bias: self.gyro_bias_held().max(repeats),
        };
        self.correct_partly(&held, |filter| {
            filter.x += gain * innovation;
            filter.x[T] = filter.x[T].clamp(*LAG_RANGE_S.start(), *LAG_RANGE_S.end());
            subtract(&mut filter.p, gain, cross);
        });
    }

    /// Applies `correct`, then takes back these shares of it for the states from b to G: a partial-update Schmidt–Kalman filter (Brink, J.
    /// Guid. Control Dyn. 40, 2017). Covariances take back the product of both shares.
    pub(super) fn correct_partly(&mut self, held: &HeldBack, correct: impl FnOnce(&mut Self)) {
        let held = held.shares();
        if held.iter().all(|&share| share == 0.0) {
            return correct(self);
        }
        let (x, p) = (self.x, self.p);
        correct(self);
        // As slices: over nalgebra's views the compiler does not vectorise this, which costs 8 % of a sample's time.
        let take_back = |now: &mut [f64], before: &[f64], shares: &[f64]| {
            let pairs = now[B..B + HELD].iter_mut().zip(&before[B..B + HELD]);
            for ((now, before), share) in pairs.zip(shares) {
                *now = share * before + (1.0 - share) * *now;
            }
        };
        take_back(self.x.as_mut_slice(), x.as_slice(), held.as_slice());
        for index in (0..HELD).filter(|&index| held[index] > 0.0) {
            let shares = held * held[index];
            let (now, before) = (&mut self.p.data.0[B + index], &p.data.0[B + index]);
            take_back(now, before, shares.as_slice());
        }
    }

    /// The share of a correction of D that is taken back: one half if the field's relative deviation equals `SCALE`, the initial deviation
    /// of D. The model multiplies D by the field, and linearising it neglects the product of their errors. Without this, cars that pass
    /// before or in a car's first turn teach a wrong D for good.
    fn matrix_held(&self) -> f64 {
        let unknown2 = self.trace(H, 3) / 3.0;
        share(unknown2, SCALE.powi(2) * self.vector(H).norm_squared())
    }

    /// The share of a correction of the gyro's bias that is taken back: half if the field's deviation equals its strength, both of the
    /// horizontal field if the vertical is known. A field of unknown direction also turns in an unknown direction. Linearising takes that
    /// for known: without this, the first seconds teach a bias wrong by five deviations.
    fn gyro_bias_held(&self) -> f64 {
        let axes = if self.vertical_known { 2 } else { 3 };
        let unknown2 = self.trace(H, axes) / axes as f64;
        share(unknown2, self.x.rows(H, axes).norm_squared())
    }

    /// How far the estimated tilt error may correct the field in the Jacobian, 0 to 1. There is no limit if the vertical is unknown.
    fn tilt_worth(&self) -> f64 {
        if !self.vertical_known {
            return 1.0;
        }
        let known2 = (VERTICAL_KNOWN * self.x[H + 2]).powi(2);
        share(known2, self.p[(H + 2, H + 2)])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::covariance::G;
    use crate::estimate::prior::Prior;

    /// The variance of the gyro's bias after a sample, as a share of the variance before, where the field is known to this deviation,
    /// milligauss, and goes with the bias about the vertical by nine tenths.
    fn bias_variance_left(field_sd: f64) -> f64 {
        let mut filter = Filter::new(&Prior::unknown()).unsure_of_gyro();
        filter.vertical_known = true;
        let earth = Vector3::new(60.0, 190.0, -420.0);
        filter.x.fixed_rows_mut::<3>(H).copy_from(&earth);
        for axis in 0..3 {
            filter.p[(B + axis, B + axis)] = 1.0;
            filter.p[(H + axis, H + axis)] = field_sd * field_sd;
        }
        let before = filter.p[(G + 2, G + 2)];
        let both = 0.9 * field_sd * before.sqrt();
        filter.p[(H, G + 2)] = both;
        filter.p[(G + 2, H)] = both;
        let sample = Input::turning_at(Matrix3::identity(), Vector3::zeros(), earth);
        filter.correct(&sample, false);
        filter.p[(G + 2, G + 2)] / before
    }

    #[test]
    fn an_innovation_that_repeats_teaches_less_of_the_iron() {
        // The variance of the hard iron that a sample leaves after 5 s of such innovations.
        let variance = |wave: &dyn Fn(f64) -> f64| {
            let mut filter = Filter::new(&Prior::unknown());
            let earth = Vector3::new(60.0, 190.0, -420.0);
            filter.x.fixed_rows_mut::<3>(H).copy_from(&earth);
            for step in 0..50 {
                let innovation = Vector3::z() * wave(f64::from(step) * 0.1);
                (filter.whiteness).take(&innovation, &(innovation / 25.0), 0.1);
            }
            let sample = Input::turning_at(Matrix3::identity(), Vector3::zeros(), earth);
            filter.correct(&sample, false);
            filter.p[(B, B)]
        };
        let white = variance(&|_| 0.0);
        let hum = variance(&|t_s| 20.0 * (std::f64::consts::TAU * 0.5 * t_s).sin());
        assert!(hum > 1.2 * white, "{hum} and {white} mG²");
    }

    /// How far a sample moves for each radian of tilt error.
    fn moved_by_tilt(vertical: f64, vertical_sd: f64) -> f64 {
        let mut filter = Filter::new(&Prior::unknown());
        filter.vertical_known = true;
        filter.p[(H + 2, H + 2)] = vertical_sd.powi(2);
        let input = Input::turning_at(Matrix3::identity(), Vector3::zeros(), Vector3::zeros());
        let here = Vector3::new(0.0, 0.0, vertical);
        let [tilt, _] = filter.jacobian(&input, &here, &Vector3::zeros()).tilt;
        tilt.norm()
    }

    #[test]
    fn a_tilt_error_moves_a_sample_by_the_vertical_field_that_there_may_be() {
        let moved = |vertical, sd| moved_by_tilt(vertical, sd).round();
        assert_eq!(moved(-400.0, 0.0), 400.0);
        assert_eq!(moved(0.0, 300.0), 300.0);
        assert_eq!(moved(-400.0, 300.0), 500.0);
        assert_eq!(moved(0.0, 5000.0), STRONGEST_MGAUSS);
        assert_eq!(moved(1000.0, 5000.0), 1000.0);
    }

    #[test]
    fn a_field_of_unknown_direction_teaches_little_of_the_gyros_bias() {
        let (known, unknown) = (bias_variance_left(50.0), bias_variance_left(1500.0));
        assert!(known < 0.5, "{known}");
        assert!(unknown > 0.9, "{unknown}");
    }
}
