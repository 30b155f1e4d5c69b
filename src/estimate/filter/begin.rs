//! Begins the filter's state with one sample, and begins it anew where the frame is lost or the iron in doubt.

use nalgebra::{Matrix3, Matrix3x2, SMatrix, Vector3};

use super::known::matrix_of;
use super::{DISTURBED, Filter, Input, JITTER_S, State, USUAL_UNEVENNESS};
use crate::estimate::covariance::{B, D, E, H, M, N, Q, T};
use crate::frame::{add_variance, angle_between_rad, put, variance_along};

/// A squared change of the field counts only beyond this many variances (two deviations).
const LIKELY: f64 = 4.0;
/// Before the board has turned this far, the field does not tell iron from north, radians.
const BEGIN_RAD: f64 = 0.1;
/// Added to the measured disturbance when iron is in doubt, as a share of the field: the filter may have taken part of the change for
/// unevenness.
const IRON_UNSEEN: f64 = 0.1;

impl Filter {
    /// The frame has been lost: the field in it comes anew from one sample.
    pub fn restart_frame(&mut self, input: &Input) {
        let about = self.x;
        self.restart_frame_about(input, &about);
    }

    /// The same, linearised about the iron, the matrix and the lag of this state.
    fn restart_frame_about(&mut self, input: &Input, about: &State) {
        let vertical_known = self.vertical_known && input.vertical_known;
        let before = (self.vector(H), self.field_covariance());
        self.undisturbed_s = 0.0;
        self.still = input.board.still;
        self.vertical_known = input.vertical_known;
        self.last_attitude = input.to_frame;
        if !self.begun {
            self.first_attitude = None;
            return;
        }
        let Some(inverse) = matrix_of(about).try_inverse() else {
            return;
        };
        let rate = input.turn_rate().cross_matrix();
        let lag = about[T] - input.lag_s;
        let turn = input.to_frame * (Matrix3::identity() - rate * lag);
        let map = turn * inverse;
        let corrected = inverse * (input.field_mgauss - about.fixed_rows::<3>(B));
        let field = turn * corrected;
        self.restart(H..H + 3, 0.0);
        self.restart(E..E + 2, input.board.tilt_error.whole_sd_rad.powi(2));
        self.restart_offset(M, self.unevenness2);
        self.restart_offset(Q, self.place2);
        // h = R (I − [ω]× lag) D⁻¹ (y − b) − ε × h − m − q, where the lag is what `input.lag_s` leaves of it
        let mut jacobian = SMatrix::<f64, 3, N>::zeros();
        put(&mut jacobian, (0, B), &-map);
        let by_matrix = (-map).kronecker(&corrected.transpose());
        put(&mut jacobian, (0, D), &by_matrix);
        for at in [M, Q] {
            put(&mut jacobian, (0, at), &-Matrix3::identity());
        }
        let by_tilt: Matrix3x2<f64> = field.cross_matrix().fixed_columns::<2>(0).into();
        put(&mut jacobian, (0, E), &by_tilt);
        let by_time = input.to_frame * rate * corrected;
        put(&mut jacobian, (0, T), &-by_time);
        let mut cross = jacobian * self.p;
        let timed = by_time * by_time.transpose() * JITTER_S.powi(2);
        let mut own = cross * jacobian.transpose() + map * map.transpose() * self.noise2 + timed;
        // A change of strength or dip means that the azimuth may have changed too.
        let strange2 = strange2(&(field, own), &before, vertical_known);
        for axis in 0..3 {
            self.p[(M + axis, M + axis)] += strange2;
            cross[(axis, M + axis)] -= strange2;
            own[(axis, axis)] += strange2;
        }
        put(&mut self.p, (H, 0), &cross);
        put(&mut self.p, (0, H), &cross.transpose());
        put(&mut self.p, (H, H), &own);
        // ε, m and q, just restarted, count as 0 in `about`.
        let mut off = self.x - about;
        for (at, count) in [(E, 2), (M, 3), (Q, 3)] {
            off.rows_mut(at, count).fill(0.0);
        }
        let field = field + jacobian * off;
        put(&mut self.x, (H, 0), &field);
        self.innovation = None;
        self.whiteness.interrupt();
        self.odd = None;
        self.jumped = false;
        self.jumps_mgauss = Vector3::zeros();
        self.odd_mgauss = Vector3::zeros();
    }

    /// Iron may have come or gone: adds the disturbance to the hard iron's deviation, and resets the unevenness to that of usual places.
    pub fn doubt_iron(&mut self, disturbance_mgauss: f64) {
        let disturbance = disturbance_mgauss + IRON_UNSEEN * self.strength_rms_mgauss;
        self.unevenness2 = USUAL_UNEVENNESS.powi(2);
        self.restart_offset(M, self.unevenness2);
        add_variance(&mut self.p, B..B + 3, disturbance * disturbance);
    }

    /// Resets the unevenness or the place's offset to 0 with this variance, a share of the field's square.
    fn restart_offset(&mut self, at: usize, share2: f64) {
        let variance = share2 * self.strength_rms_mgauss.powi(2);
        self.restart(at..at + 3, variance);
    }

    /// How far the field's strength is from this one, milligauss, if no place explains that; else 0.
    fn differs_by_mgauss(&self, strength: f64) -> f64 {
        let field = self.vector(H);
        let variance = variance_along(&self.field_covariance(), &field.normalize());
        let off = (field.norm() - strength).abs();
        let usual2 = (DISTURBED * strength).powi(2) + LIKELY * variance;
        if off * off > usual2 { off } else { 0.0 }
    }

    /// Begins the state. With a calibration it begins at once; otherwise once the board has turned by `BEGIN_RAD`, with half of the field
    /// taken for iron. With `fixed`, a calibration holds whatever the field's strength. Returns whether the caller is to
    /// apply this sample: not before the state has begun, nor where a calibration begins it, since then the field is from this sample.
    pub(super) fn begin(&mut self, input: &Input, fixed: bool) -> bool {
        let first = *self.first_attitude.get_or_insert(input.to_frame);
        if let Some(measured) = self.measured.take() {
            self.begun = true;
            // The field comes from the sample less the iron, and D multiplies it. So the iron is found first, and then all is linearised
            // about that.
            let mut found = self.clone();
            found.restart_frame(input);
            found.learn_all(&measured);
            self.restart_frame_about(input, &found.x);
            self.learn_all(&measured);
            let made_in = self.made_in_mgauss.take();
            let off = made_in.map_or(0.0, |strength| self.differs_by_mgauss(strength));
            if off > 0.0 && !fixed {
                // Iron may have come or gone since the calibration was made.
                self.doubt_iron(off);
                self.restart_frame(input);
            }
            return false;
        }
        if angle_between_rad(&first, &input.to_frame) < BEGIN_RAD {
            return false;
        }
        self.begun = true;
        self.last_attitude = input.to_frame;
        let half = 0.5 * input.field_mgauss;
        put(&mut self.x, (H, 0), &(input.to_frame * half));
        put(&mut self.x, (B, 0), &half);
        true
    }
}

/// A field, milligauss, with its covariance.
type KnownField = (Vector3<f64>, Matrix3<f64>);

/// Variance on each axis, mG², by which the changes of the horizontal strength and of the vertical field exceed `LIKELY` variances; that of
/// the whole strength if the vertical is unknown.
fn strange2(now: &KnownField, before: &KnownField, vertical_known: bool) -> f64 {
    let beyond = |direction: fn(&Vector3<f64>) -> Vector3<f64>| {
        let [now, before] = [now, before].map(|(field, covariance)| {
            let along = direction(field)
                .try_normalize(1e-9)
                .unwrap_or_else(Vector3::z);
            (along.dot(field), variance_along(covariance, &along))
        });
        ((now.0 - before.0).powi(2) - LIKELY * (now.1 + before.1)).max(0.0)
    };
    if !vertical_known {
        return beyond(|field| *field);
    }
    0.5 * (beyond(|field| Vector3::new(field.x, field.y, 0.0)) + beyond(|_| Vector3::z()))
}

#[cfg(test)]
mod tests {
    use nalgebra::Rotation3;

    use super::*;
    use crate::calibration::model::{Calibration, Parameters, Spatial};
    use crate::estimate::prior::Prior;
    use crate::frame::Mounting;

    /// A level board at rest with much iron, which a turn has measured.
    #[test]
    fn of_a_still_board_the_second_sample_tells_no_more_than_the_first() {
        let iron = Vector3::new(700.0, -400.0, 900.0);
        let spatial = Spatial::diagonal(iron, Vector3::new(1.05, 1.0, 0.95));
        let calibration = Calibration::of(Parameters::Spatial(spatial), 500.0, 2.0, 0.1);
        let mut filter = Filter::new(&Prior::of(&calibration, &Mounting::default()));
        let earth = Vector3::new(60.0, 190.0, -420.0);
        let to_frame = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0));
        let field = spatial.matrix * (to_frame.transpose() * earth) + iron;
        let resting = Input::turning_at(to_frame, Vector3::zeros(), field).still();
        let mut known = || {
            filter.follow(&resting, false, false);
            let level = filter.field_covariance().fixed_view::<2, 2>(0, 0).trace();
            (filter.field(), level, filter.bias_covariance().trace())
        };
        let (first, second) = (known(), known());
        assert!(
            (second.0 - first.0).norm() < 1.0,
            "{} {}",
            first.0,
            second.0
        );
        for (first, second) in [(first.1, second.1), (first.2, second.2)] {
            assert!((0.97..1.01).contains(&(second / first)), "{first} {second}");
        }
        assert!((first.0 - earth).norm() < 10.0, "{}", first.0);
    }

    /// The frame is lost on a board that has turned enough to know its iron, once in the same field and once beside a magnet.
    #[test]
    fn a_field_that_has_become_another_has_no_certain_azimuth() {
        let mut prior = Prior::unknown();
        prior.covariance *= 1e-4;
        prior.strength_mgauss = Some(470.0);
        let mut filter = Filter::new(&prior);
        let earth = Vector3::new(60.0, 190.0, -420.0);
        let sample = |step: u32, field: Vector3<f64>| {
            let turned = Rotation3::new(Vector3::z() * 0.05 * f64::from(step)).into_inner();
            Input::turning_at(turned, Vector3::z() * 0.5, turned.transpose() * field)
        };
        for step in 0..100 {
            filter.follow(&sample(step, earth), false, false);
        }
        let azimuth_sd_deg = |field: Vector3<f64>| {
            let mut filter = filter.clone();
            filter.follow(&sample(100, field), true, false);
            let across = Vector3::z().cross(&filter.field()).normalize();
            let variance = variance_along(&filter.field_covariance(), &across);
            (variance.sqrt() / filter.field().xy().norm()).to_degrees()
        };
        let same_deg = azimuth_sd_deg(earth);
        assert!(same_deg < 10.0, "{same_deg}");
        // Its azimuth is nearly the same: that shows in nothing.
        let strange_deg = azimuth_sd_deg(earth + Vector3::new(10.0, -20.0, 300.0));
        assert!(strange_deg > 30.0, "{strange_deg}");
    }

    /// A board that stayed level does not tell the iron along its vertical from the field's.
    #[test]
    fn a_calibration_with_an_axis_that_is_not_known_is_used_as_it_is() {
        let iron = Vector3::new(90.0, -40.0, 0.0);
        let mut prior = Prior::unknown();
        prior.bias_mgauss = iron;
        prior.covariance *= 1e-4;
        prior.covariance[(2, 2)] = 671.0 * 671.0;
        prior.strength_mgauss = Some(470.0);
        let mut filter = Filter::new(&prior);
        let earth = Vector3::new(60.0, 190.0, -420.0);
        for step in 0..10 {
            let turned = Rotation3::new(Vector3::z() * 0.05 * f64::from(step)).into_inner();
            let field = turned.transpose() * earth + iron;
            let sample = Input::turning_at(turned, Vector3::z() * 0.5, field);
            filter.follow(&sample, false, false);
        }
        let off = (filter.bias_mgauss() - iron).xy().norm();
        assert!(off < 5.0, "{off}");
    }
}
