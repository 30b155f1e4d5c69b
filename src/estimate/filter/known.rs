//! What the filter knows, and how well.

use nalgebra::{Matrix3, SMatrix, SVector, SymmetricEigen, Vector3, Vector5};

use super::{DISTURBED, Filter, State, USUAL_UNEVENNESS};
use crate::estimate::covariance::{B, D, E, G, H, M, Q, T};
use crate::frame::{hypot, put, variance_along};

/// The field in the frame, milligauss, then the frame's tilt error, radians: one block of the filter's state.
pub struct FieldInFrame {
    pub state: SVector<f64, 5>,
    pub covariance: SMatrix<f64, 5, 5>,
}

const _: () = assert!(E == H + 3);

impl Filter {
    /// What is left of the gyro's bias, body axes, rad/s, and its variance on each axis.
    pub fn gyro_bias(&self) -> (Vector3<f64>, Vector3<f64>) {
        let variance = self.p.fixed_view::<3, 3>(G, G).diagonal();
        (self.vector(G), variance)
    }

    /// The field in the frame, milligauss.
    pub fn field(&self) -> Vector3<f64> {
        self.vector(H)
    }

    /// The field in the frame with what disturbs it here, milligauss.
    pub fn field_here(&self) -> Vector3<f64> {
        self.vector(H) + self.vector(M) + self.vector(Q)
    }

    /// The field in the frame with the tilt error, and how well both are known.
    pub fn field_in_frame(&self) -> FieldInFrame {
        FieldInFrame {
            state: self.x.fixed_rows::<5>(H).into(),
            covariance: self.p.fixed_view::<5, 5>(H, H).into(),
        }
    }

    /// Covariance of the field in the frame, milligauss².
    pub fn field_covariance(&self) -> Matrix3<f64> {
        self.p.fixed_view::<3, 3>(H, H).into()
    }

    /// Covariance of the gyro's bias, body axes, (rad/s)².
    pub fn gyro_bias_covariance(&self) -> Matrix3<f64> {
        self.p.fixed_view::<3, 3>(G, G).into()
    }

    /// D.
    pub fn matrix(&self) -> Matrix3<f64> {
        matrix_of(&self.x)
    }

    /// Mean variance of the entries of D.
    pub fn matrix_variance(&self) -> f64 {
        self.trace(D, 9) / 9.0
    }

    /// b, body axes, milligauss.
    pub fn bias_mgauss(&self) -> Vector3<f64> {
        self.vector(B)
    }

    /// Covariance of b, milligauss².
    pub fn bias_covariance(&self) -> Matrix3<f64> {
        self.p.fixed_view::<3, 3>(B, B).into()
    }

    /// Covariance of b and of D, row by row.
    pub fn parameter_covariance(&self) -> SMatrix<f64, 12, 12> {
        self.p.fixed_view::<12, 12>(B, B).into()
    }

    /// Estimated strength of the field, milligauss.
    pub fn strength_mgauss(&self) -> f64 {
        self.vector(H).norm()
    }

    /// Lag of the magnetometer behind the gyro, seconds.
    pub fn lag_s(&self) -> f64 {
        self.x[T]
    }

    /// RMS of the lag that is left after this correction, seconds.
    pub fn lag_beyond_s(&self, corrected_s: f64) -> f64 {
        hypot(self.x[T] - corrected_s, self.p[(T, T)].max(0.0).sqrt())
    }

    /// White noise of a sample, one standard deviation, milligauss.
    pub fn noise_mgauss(&self) -> f64 {
        self.noise2.sqrt()
    }

    /// By how much the field is more uneven than usual places are: variance on each axis, as a share of the field's square. On a board that
    /// turns that means iron that has come or gone.
    pub fn unusual_unevenness2(&self) -> f64 {
        (self.unevenness2 - USUAL_UNEVENNESS.powi(2)).max(0.0)
    }

    /// Whether the field here is not the earth's: it has just jumped, is far off, or is more uneven than places are.
    pub fn disturbed(&self) -> bool {
        self.jumped
            || self.unevenness_share() > DISTURBED
            || (!self.still && self.unevenness2 > (3.0 * USUAL_UNEVENNESS).powi(2))
    }

    /// Whether the last sample was beyond the gate. The first such sample changes no state.
    pub fn odd(&self) -> bool {
        self.odd.is_some()
    }

    /// |m|, milligauss.
    pub fn unevenness_mgauss(&self) -> f64 {
        self.vector(M).norm()
    }

    /// The same as a share of the field.
    pub fn unevenness_share(&self) -> f64 {
        self.unevenness_mgauss() / self.strength_rms_mgauss
    }

    /// Recent jumps of the field and the innovation of a rejected sample, in the frame, milligauss.
    pub fn missed_mgauss(&self) -> Vector3<f64> {
        self.jumps_mgauss + self.odd_mgauss
    }

    /// The least known direction of the hard iron, body axes. A rotation about any perpendicular axis would show most.
    pub fn least_known(&self) -> Vector3<f64> {
        let eigen = SymmetricEigen::new(self.bias_covariance());
        eigen.eigenvectors.column(eigen.eigenvalues.imax()).into()
    }

    /// Whether the hard iron has a deviation below this in every direction, milligauss.
    pub fn iron_known_within(&self, limit_mgauss: f64) -> bool {
        // Sylvester's criterion on limit² I − P: no eigenvalue needs to be found.
        let left = Matrix3::identity() * limit_mgauss.powi(2) - self.bias_covariance();
        left.m11 > 0.0 && left.m11 * left.m22 > left.m12 * left.m21 && left.determinant() > 0.0
    }

    /// Covariance of one raw sample whose corrected field is this: parameters, unevenness, place and noise, milligauss².
    pub fn sample_covariance(&self, corrected: &Vector3<f64>) -> Matrix3<f64> {
        let mut jacobian = SMatrix::<f64, 3, 12>::identity();
        for row in 0..3 {
            put(&mut jacobian, (row, 3 + 3 * row), &corrected.transpose());
        }
        let uneven = (self.unevenness2 + self.place2) * self.strength_rms_mgauss.powi(2);
        jacobian * self.parameter_covariance() * jacobian.transpose()
            + Matrix3::identity() * (uneven + self.noise2)
    }

    /// One standard deviation of the hard iron along each body axis, milligauss.
    pub fn bias_sd_mgauss(&self) -> Vector3<f64> {
        Vector3::from_fn(|axis, _| self.p[(B + axis, B + axis)].max(0.0).sqrt())
    }
}

/// D in this state.
pub(super) fn matrix_of(state: &State) -> Matrix3<f64> {
    Matrix3::identity() + Matrix3::from_row_slice(state.fixed_rows::<9>(D).as_slice())
}

impl FieldInFrame {
    /// Milligauss.
    pub fn field(&self) -> Vector3<f64> {
        self.state.fixed_rows::<3>(0).into()
    }

    /// Milligauss².
    pub fn field_covariance(&self) -> Matrix3<f64> {
        self.covariance.fixed_view::<3, 3>(0, 0).into()
    }

    /// A rotation vector in the frame.
    pub fn tilt_rad(&self) -> Vector3<f64> {
        Vector3::new(self.state[3], self.state[4], 0.0)
    }

    /// Variance of an angle that has these slopes by the field in the frame and by its tilt error.
    pub fn variance(&self, by_field: &Vector3<f64>, by_tilt: &Vector3<f64>) -> f64 {
        let slopes = Vector5::new(by_field.x, by_field.y, by_field.z, by_tilt.x, by_tilt.y);
        variance_along(&self.covariance, &slopes)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Rotation3;

    use super::*;
    use crate::estimate::filter::{Input, LAG_RANGE_S};
    use crate::estimate::prior::Prior;

    /// The lag found on a board that swings and whose magnetometer is this late, or early if negative, seconds.
    fn found_s(late_s: f64) -> f64 {
        let mut filter = Filter::new(&Prior::unknown());
        let angle = |t_s: f64| Rotation3::new(Vector3::z() * (3.0 * t_s).sin());
        for step in 0..300 {
            let t_s = 0.1 * f64::from(step);
            let rate = Vector3::z() * (3.0 * (3.0 * t_s).cos());
            let field = angle(t_s - late_s).inverse() * Vector3::new(60.0, 190.0, -420.0);
            let input = Input::turning_at(angle(t_s).into_inner(), rate, field);
            filter.correct(&input, false);
        }
        filter.lag_s()
    }

    #[test]
    fn the_lag_is_within_what_chips_have() {
        let found = found_s(0.05);
        assert!((found - 0.05).abs() < 0.01, "{found}");
        for late_s in [0.3, -0.15] {
            let found = found_s(late_s);
            assert!(LAG_RANGE_S.contains(&found), "{late_s}: {found}");
        }
    }
}
