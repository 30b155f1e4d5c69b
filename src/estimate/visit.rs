//! Something magnetic that comes near a still board and goes again.
//!
//! While it is there, the active filter learns that the field here is very uneven and, if the board is touched, that its iron may have
//! changed. Once the field is as before, both are wrong: the filters from before, carried on by the gyro, take over again.

use nalgebra::{Matrix3, Vector3};

use super::filter::{DISTURBED, Filter, Input, SWING_RAD};
use super::rival::Rival;
use crate::frame::angle_between_rad;

/// The offset of the field from the expected one is averaged over this time, seconds: longer than a hand takes to remove a magnet.
const GONE_S: f64 = 1.0;
/// A sample counts for at most this share of the average, so that those after a pause do not count alone.
const MOST_A_SAMPLE: f64 = 0.1;
/// The averaged offset is as expected if its normalised square is below this (3 degrees of freedom: 95 %).
const EXPECTED: f64 = 7.8;
/// A visitor has gone only once the field is off by less than this share of the largest offset in the visit.
const LEFT: f64 = 0.5;
/// Whoever puts a magnet down shakes the board for at most this long, seconds.
const TOUCH_S: f64 = 3.0;

/// Watches a still board for visits.
#[derive(Default)]
pub(super) struct VisitWatch {
    /// Boxed: an empty `Option` of this size is copied with each sample, at two thirds of the filter's cost.
    rest: Option<Box<Rest>>,
}

/// The filters from before a visit.
pub(super) struct FiltersBefore {
    pub(super) active: Filter,
    pub(super) rival: Option<Rival>,
}

/// A board that has not been turned since it became still.
struct Rest {
    before: FiltersBefore,
    /// Orientation at the beginning, body to frame.
    attitude: Matrix3<f64>,
    /// For how long the board has moved without a pause, seconds.
    touched_s: f64,
    /// Average of what the field differs by from what is expected, body axes, milligauss; `None` without a visit.
    off_mgauss: Option<Vector3<f64>>,
    /// Largest norm of that in this visit, milligauss.
    most_mgauss: f64,
}

impl VisitWatch {
    /// Takes a sample that the filters have followed, with `fixed` parameters or free ones. Returns the filters from before the visit, if a
    /// visit has just ended.
    pub(super) fn take(
        &mut self,
        input: &Input,
        active: &Filter,
        rival: Option<&Rival>,
        fixed: bool,
    ) -> Option<FiltersBefore> {
        let disturbed = active.disturbed();
        let now = || FiltersBefore {
            active: active.clone(),
            rival: rival.cloned(),
        };
        let Some(rest) = &mut self.rest else {
            let rests = input.board.still && active.begun && !disturbed;
            self.rest = rests.then(|| {
                Box::new(Rest {
                    before: now(),
                    attitude: input.to_frame,
                    touched_s: 0.0,
                    off_mgauss: None,
                    most_mgauss: 0.0,
                })
            });
            return None;
        };
        if rest.board_moved(input) {
            self.rest = None;
        } else if !disturbed && rest.off_mgauss.is_none() {
            rest.before = now();
        } else if rest.follow_visit(input, fixed) {
            return self.rest.take().map(|rest| rest.before);
        }
        None
    }

    /// The kept filters: from before the visit or, without one, from the last sample.
    pub(super) fn filters(&mut self) -> impl Iterator<Item = &mut Filter> {
        self.rest
            .iter_mut()
            .flat_map(|rest| rest.before.filters_mut())
    }
}

impl FiltersBefore {
    fn filters_mut(&mut self) -> impl Iterator<Item = &mut Filter> {
        let rival = self.rival.as_mut().map(|rival| &mut rival.filter);
        [&mut self.active].into_iter().chain(rival)
    }
}

impl Rest {
    /// Whether the board does not lie as it did.
    fn board_moved(&mut self, input: &Input) -> bool {
        let touched_s = self.touched_s + input.period_s;
        self.touched_s = if input.board.still { 0.0 } else { touched_s };
        self.touched_s > TOUCH_S || angle_between_rad(&self.attitude, &input.to_frame) > SWING_RAD
    }

    /// Carries the kept filters on through the visit. Whether it is over.
    fn follow_visit(&mut self, input: &Input, fixed: bool) -> bool {
        for filter in self.before.filters_mut() {
            filter.pass(input, fixed);
        }
        let filter = &self.before.active;
        let (innovation, covariance) = filter.foresee(input);
        let off = self.off_mgauss.get_or_insert(innovation);
        *off += (innovation - *off) * (input.period_s / GONE_S).min(MOST_A_SAMPLE);
        self.most_mgauss = self.most_mgauss.max(off.norm());
        let less = off.norm() < LEFT * self.most_mgauss;
        // If the prediction is less certain, it does not exclude a disturbance.
        let disturbance2 = (DISTURBED * filter.strength_mgauss()).powi(2);
        let certain = covariance.trace() * EXPECTED / 3.0 < disturbance2;
        let expected = |inverse: Matrix3<f64>| off.dot(&(inverse * *off)) < EXPECTED;
        input.board.still && less && certain && covariance.try_inverse().is_some_and(expected)
    }
}
