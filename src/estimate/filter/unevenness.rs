//! The noise of the samples and the unevenness of the field, as innovations and the state show them.

use nalgebra::{Matrix3, SMatrix, Vector3};

use super::{Filter, Input};
use crate::estimate::covariance::{M, N, Q, subtract};

/// Least white noise of a sample, milligauss: somewhat less than the 2 of an HMC5883L's data sheet.
pub(super) const LEAST_NOISE_MGAUSS: f64 = 1.5;
/// The noise is measured over this time, seconds.
const NOISE_TAU_S: f64 = 2.0;
/// Largest weight of one sample in the measured noise, for long periods.
const NOISE_GAIN: f64 = 0.5;
/// Largest squared step that counts as noise, as a multiple of the noise variance: chance exceeds it in 0.4 % of steps (3 degrees of
/// freedom).
const NOISE_STEP2: f64 = 4.5;
/// Least unevenness of the field, as a share of it.
const LEAST_UNEVENNESS: f64 = 0.004;
/// The measured unevenness grows over so many lengths in which m is forgotten, so that its mean has about as many independent values. With
/// half of it a robot on an uneven floor is not sure enough.
const LENGTHS_UP: f64 = 3.0;
/// The same when it shrinks, and of `mean_unevenness2`. With half of it a board to which a magnet is attached in motion is falsely sure.
const LENGTHS_DOWN: f64 = 4.0;
/// Most that a place as a whole is taken to be off, as a share of the field: rooms are uneven by 1 to 2 %. More than that is a magnet
/// nearby, whose field does not reach across a whole place. Without this limit a sensor that passes a magnet takes north from it; with
/// half as much again or a quarter less the simulated families hold as well.
const MOST_PLACE: f64 = 0.02;
/// The variance of a place's offset follows the mean unevenness in steps of this share: to follow it at each sample costs a quarter
/// more time.
const PLACE_STEP: f64 = 0.05;

impl Filter {
    /// The steps from innovation to innovation are noise, whatever else is wrong.
    pub(super) fn measure_noise(&mut self, innovation: &Vector3<f64>, dt: f64) {
        if let Some(before) = self.innovation.replace(*innovation) {
            // Three axes, and the noise of two samples.
            let step = (innovation - before).norm_squared() / 6.0;
            let gain = (dt / NOISE_TAU_S).min(NOISE_GAIN);
            self.noise2 += gain * (step.min(NOISE_STEP2 * self.noise2) - self.noise2);
            self.noise2 = self.noise2.max(LEAST_NOISE_MGAUSS.powi(2));
        }
    }

    /// Measures how uneven the field is. Places are taken to differ from each other as much as the field does within one.
    pub(super) fn measure_unevenness(&mut self, input: &Input, forgotten: f64, fixed: bool) {
        let m = self.vector(M).norm_squared() + self.trace(M, 3);
        let share2 = m / 3.0 / self.strength_rms_mgauss.powi(2);
        let lengths = if share2 > self.unevenness2 {
            LENGTHS_UP
        } else {
            LENGTHS_DOWN
        };
        self.unevenness2 += forgotten / lengths * (share2 - self.unevenness2);
        self.unevenness2 = self.unevenness2.max(LEAST_UNEVENNESS.powi(2));
        if !input.board.still {
            let here = self.unevenness2.min(MOST_PLACE.powi(2));
            self.mean_unevenness2 += forgotten / LENGTHS_DOWN * (here - self.mean_unevenness2);
            let ratio = self.mean_unevenness2 / self.place2;
            if (ratio - 1.0).abs() > PLACE_STEP {
                self.place2 = self.mean_unevenness2;
                if !fixed {
                    self.scale_offset(ratio);
                }
            }
        }
    }

    /// Multiplies the variance of the place's offset, and corrects all states that are correlated with it. That variance was assumed, since
    /// samples hardly tell the offset from the earth's field: a better one holds for the past, too.
    fn scale_offset(&mut self, ratio: f64) {
        let cross: SMatrix<f64, N, 3> = self.p.fixed_columns::<3>(Q).into();
        let own: Matrix3<f64> = cross.fixed_rows::<3>(Q).into();
        let Some(inverse) = own.try_inverse() else {
            return;
        };
        let gain = cross * inverse * (1.0 - ratio);
        self.x -= gain * self.vector(Q);
        subtract(&mut self.p, &gain, &cross);
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix2, Rotation3};

    use super::*;
    use crate::estimate::prior::Prior;

    /// A filter that has seen a level turn, which began with this variance of the place's offset, milligauss².
    fn turned(offset2: f64) -> Filter {
        let mut filter = Filter::new(&Prior::unknown());
        for axis in Q..Q + 3 {
            filter.p[(axis, axis)] = offset2;
        }
        for step in 0..200 {
            let rate_rad_s = Vector3::z() * 0.5;
            let to_frame = Rotation3::new(rate_rad_s * 0.1 * f64::from(step)).into_inner();
            let earth = Vector3::new(60.0, 190.0, -420.0);
            let iron = Vector3::new(90.0, -40.0, 150.0);
            let field = to_frame.transpose() * earth + iron;
            filter.correct(&Input::turning_at(to_frame, rate_rad_s, field), false);
        }
        filter
    }

    /// The covariance of the horizontal field, which is what a level turn shows.
    fn level(filter: &Filter) -> Matrix2<f64> {
        filter.field_covariance().fixed_view::<2, 2>(0, 0).into()
    }

    #[test]
    fn a_new_variance_of_the_offset_is_as_though_it_had_been_there_from_the_start() {
        let (usual2, other2) = (56.0, 400.0);
        for (before2, after2) in [(usual2, other2), (other2, usual2)] {
            let expected = turned(after2);
            let apart = |filter: &Filter| (level(filter) - level(&expected)).amax();
            let mut filter = turned(before2);
            let before = apart(&filter);
            filter.scale_offset(after2 / before2);
            let off = (filter.x - expected.x).amax();
            assert!(off < 1.0, "{off} mG");
            let after = apart(&filter);
            assert!(after < 0.02 * before, "{after} and {before} mG²");
        }
    }
}
