//! Headings and their deviations, from what the estimate knows.

use std::f64::consts::PI;

use nalgebra::{Matrix3, UnitQuaternion, Vector3};

use super::prior::USUAL_UNEVENNESS;
use super::strength::{MOST_RAW_MGAUSS, horizontal, sd_along};
use super::{Estimate, EstimatedHeading, kept, level};
use crate::attitude::Pose;
use crate::frame::{NO_HEADING, heading_deg, hypot, variance_along, wrap_360};
use crate::reading::STRONGEST_MGAUSS;

/// Deviation of a heading of which nothing is known, degrees: half a turn.
pub const UNKNOWN_SD_DEG: f64 = 180.0;
/// Weight of a contradiction between field and gyro in a heading's deviation: in one of five such cases the gyro is wrong, √(1/5).
const DOUBT: f64 = 0.45;
/// A scale error of the gyro turns the field in the frame by that share of the angle to the mean heading. RMS of this angle, radians:
/// uniform up to half a turn, π/√3.
const TURNED_RAD: f64 = PI / 1.732;

/// A field whose strength differs by more than so many deviations of a usual place's is not only the place's.
const PLACE_DEVIATIONS: f64 = 3.0;

impl EstimatedHeading {
    /// A heading in degrees with its deviation in radians, which is at most half a turn.
    pub(super) fn new(heading_deg: f64, sd_rad: f64) -> Self {
        Self {
            heading_deg,
            sd_deg: sd_rad.to_degrees().min(UNKNOWN_SD_DEG),
        }
    }
}

impl Estimate {
    /// The heading of body X in this pose, by the field's azimuth in the gyro's frame. `None` if X is vertical, or before the estimate has
    /// begun and taken a sample in this frame. The deviation covers the field, the tilt, and on a moving board the rotation, radians,
    /// that the gyro may have missed.
    pub fn heading(&self, pose: &Pose, missed_turn_rad: f64) -> Option<EstimatedHeading> {
        let last = self.last.as_ref()?;
        if !self.active.begun || last.motion.pose.frame_id != pose.frame_id {
            return None;
        }
        // No magnetometer measures early: a negative lag means that the gyro is late, and the board has turned on.
        let gyro_late_s = (-self.active.lag_s()).max(0.0);
        let turned_on = UnitQuaternion::from_scaled_axis(last.motion.rate_rad_s * gyro_late_s);
        let pose = &Pose {
            orientation: pose.orientation * turned_on,
            ..*pose
        };
        if !pose.vertical_known {
            let field = self.active.field();
            let seen = pose.orientation.inverse_transform_vector(&field);
            return self.level_heading(pose, &seen, missed_turn_rad);
        }
        let known = self.active.field_in_frame();
        let known = match &self.place {
            Some(place) => place.on(known),
            None => known,
        };
        let field = known.field();
        let by_attitude = pose.orientation * Vector3::x();
        let nose = by_attitude - known.tilt_rad().cross(&by_attitude);
        let horizontal2 = nose.xy().norm_squared();
        if horizontal2 < NO_HEADING * NO_HEADING {
            return None;
        }
        let heading = nose.x.atan2(nose.y) - field.x.atan2(field.y);
        let by_nose = Vector3::new(nose.y, -nose.x, 0.0) / horizontal2;
        let by_tilt = by_attitude.cross_matrix().transpose() * by_nose;
        let variance = known.variance(&by_field(&field), &by_tilt).max(0.0);
        // Innovations larger than expected: the covariance is too small.
        let variance = variance * self.active.consistency.max(self.iron.excess());
        let sd = hypot(variance.sqrt(), self.doubt_rad(missed_turn_rad));
        let sd = hypot(sd, reversed_rad(&field, &known.field_covariance()));
        let sd = if self.is_credible() { sd } else { PI };
        Some(EstimatedHeading::new(wrap_360(heading.to_degrees()), sd))
    }

    /// What no covariance covers: errors of the gyro, and iron that fixed parameters do not learn, radians.
    fn doubt_rad(&self, missed_turn_rad: f64) -> f64 {
        let lasting = hypot(self.scale_doubt_rad(), self.fixed_doubt_rad());
        hypot(self.turn_doubt_rad(missed_turn_rad), lasting)
    }

    /// Error of a moving board's heading, radians, if the gyro is wrong and the field right.
    fn turn_doubt_rad(&self, missed_turn_rad: f64) -> f64 {
        if self.active.still {
            return 0.0;
        }
        let field = self.active.field();
        let horizontal = field.xy().norm().max(1.0);
        let contradicted = self.gyro.contradicted() * field.norm() / horizontal;
        let differ = if self.active.disturbed() {
            field.xy().angle(&self.active.field_here().xy())
        } else {
            0.0
        };
        let missed = self.active.missed_mgauss().xy().norm() / horizontal;
        let contradicted = DOUBT * hypot(contradicted, differ);
        // Neither the filter nor the check of the gyro has explained these yet, so they count in full.
        let unseen = hypot(missed, hypot(self.gyro.unseen_rad, missed_turn_rad));
        hypot(contradicted, unseen)
    }

    /// Error of north by the gyro's scale if that is probably wrong, radians.
    fn scale_doubt_rad(&self) -> f64 {
        DOUBT * TURNED_RAD * self.gyro.suspected_scale
    }

    /// Error of the heading by iron that has come or gone, which fixed parameters do not learn, radians.
    fn fixed_doubt_rad(&self) -> f64 {
        if !self.parameters_fixed {
            return 0.0;
        }
        let field = self.active.field();
        let unusual = self.active.unusual_unevenness2().sqrt();
        unusual * field.norm() / field.xy().norm().max(1.0)
    }

    /// Without an accelerometer the board is taken for level on average; the further it is from that, the less
    /// certain is its heading.
    fn level_heading(
        &self,
        pose: &Pose,
        seen: &Vector3<f64>,
        missed_turn_rad: f64,
    ) -> Option<EstimatedHeading> {
        let (down, leaning_rad) = self.level.down()?;
        let covariance = self.active.field_covariance() * self.iron.excess();
        // A board that stays level never learns the vertical field, and its headings need it only as far as it tilts.
        let east = down.cross(&self.active.field());
        let own = variance_along(&covariance, &east.try_normalize(1e-6)?);
        let vertical_variance = variance_along(&covariance, &down);
        let down = pose.orientation.inverse_transform_vector(&down);
        let (vertical, horizontal) = level::split(seen, &down);
        // No field on earth has more.
        let most2 = STRONGEST_MGAUSS.powi(2) - horizontal * horizontal;
        let vertical2 = (vertical * vertical + vertical_variance).min(most2.max(0.0));
        let tilted = down.z.clamp(-1.0, 1.0).acos();
        let tilt2 = (level::SD_RAD + 0.5 * tilted).powi(2) * vertical2;
        // The lean may be in any direction, so all of the field counts.
        let lean2 = leaning_rad.powi(2) * (horizontal * horizontal + vertical2);
        let sd = (own + tilt2 + lean2).sqrt() / horizontal;
        let sd = hypot(sd, self.doubt_rad(missed_turn_rad));
        Some(EstimatedHeading::new(heading_deg(seen, &down)?, sd))
    }

    /// The heading from one sample alone, for when the gyro is not trusted. Down is a unit vector of body axes with its standard deviation,
    /// radians. The rate, rad/s, times the uncertain lag adds to the deviation.
    pub fn heading_of_sample(
        &self,
        field_mgauss: &Vector3<f64>,
        down: Option<(Vector3<f64>, f64)>,
        rate_rad_s: f64,
    ) -> Option<EstimatedHeading> {
        if field_mgauss.norm() > MOST_RAW_MGAUSS {
            return None;
        }
        let corrected = self.corrected(field_mgauss)?;
        let (axis, tilt_sd) = level::known_or_level(down);
        let (vertical, horizontal) = level::split(&corrected, &axis);
        let strange = self.strange_mgauss(&corrected) / horizontal;
        if let Some(kept) = self.kept_alone() {
            let (heading, sd) = kept::heading(kept, &self.mounting, &corrected, (axis, tilt_sd))?;
            return Some(EstimatedHeading::new(heading, hypot(sd, strange)));
        }
        let heading = heading_deg(&corrected, &axis)?;
        let east = axis.cross(&corrected) / horizontal;
        let (known_vertical, known_horizontal) =
            self.known_parts().unwrap_or((vertical, horizontal));
        // A tilt that shows in the dip may be as much off in the other direction.
        let dip_off = vertical.atan2(horizontal) - known_vertical.atan2(known_horizontal);
        let tilt_sd = hypot(tilt_sd, dip_off);
        let vertical = vertical.abs().max(known_vertical.abs()) + tilt_sd * corrected.norm();
        let horizontal = horizontal.min(known_horizontal);
        let covariance = self.active.sample_covariance(&corrected);
        let own = variance_along(&covariance, &east);
        let tilt = tilt_sd * vertical;
        let sd = (own + tilt * tilt).sqrt() / horizontal;
        let sd = hypot(sd, rate_rad_s * self.active.lag_beyond_s(0.0));
        Some(EstimatedHeading::new(heading, hypot(sd, strange)))
    }

    /// By how much a corrected field is stronger or weaker than the known one, beyond what places differ by, milligauss. Its direction is off
    /// by as much.
    fn strange_mgauss(&self, corrected: &Vector3<f64>) -> f64 {
        let known = self.strength_mgauss();
        let off = (corrected.norm() - known).abs();
        (off - PLACE_DEVIATIONS * USUAL_UNEVENNESS * known).max(0.0)
    }

    /// The parts of the known field along down and across it, milligauss; `None` if the vertical is unknown.
    fn known_parts(&self) -> Option<(f64, f64)> {
        let up = self.active.vertical_known.then(Vector3::z)?;
        Some(level::split(&self.active.field(), &-up))
    }

    /// Deviation of north in the gyro's frame, degrees: that of every heading of a level board.
    pub fn north_sd_deg(&self) -> f64 {
        if !self.active.begun || !self.is_credible() {
            return UNKNOWN_SD_DEG;
        }
        let field = self.active.field();
        let covariance = self.active.field_covariance();
        let variance = variance_along(&covariance, &by_field(&field));
        let sd = hypot(variance.max(0.0).sqrt(), self.scale_doubt_rad());
        let sd = hypot(sd, reversed_rad(&field, &covariance));
        sd.to_degrees().min(UNKNOWN_SD_DEG)
    }
}

/// Error of north, radians, by the chance that the horizontal field points the other way. A board that has turned about one horizontal axis
/// knows the field across that axis, and along it cannot tell the field from iron: where all of the horizontal field lies along the axis,
/// its slope says nothing of that. The tail of the normal distribution beyond z is at most exp(−z²/2) / 2.
fn reversed_rad(field: &Vector3<f64>, covariance: &Matrix3<f64>) -> f64 {
    let north = horizontal(field);
    let deviations = north.norm() / sd_along(covariance, &north);
    PI * (0.5 * (-0.5 * deviations.powi(2)).exp()).sqrt()
}

/// Slope of the heading by the field, radians a milligauss: minus that of the field's azimuth. For a field within 1 mG of the
/// vertical it is the slope at 1 mG: the azimuth of such a field is unknown.
fn by_field(field: &Vector3<f64>) -> Vector3<f64> {
    let horizontal = field.xy();
    let across = horizontal
        .try_normalize(0.0)
        .map_or(Vector3::y(), |north| Vector3::new(-north.y, north.x, 0.0));
    across / horizontal.norm().max(1.0)
}
