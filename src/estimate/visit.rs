//! Something magnetic that comes near a resting board and goes again.
//!
//! While it is there, the active filter takes the place for very uneven, and iron for what may have moved. Once the field is as it was,
//! all this is void: the filter of before, carried on by the gyro meanwhile, becomes active again.

use nalgebra::Matrix3;

use super::filter::{DISTURBED, Filter, Input, SWING_RAD};
use crate::frame::turned_rad;

/// The field must be as it was for this long, seconds: by then a hand has taken the magnet away.
const GONE_S: f64 = 1.0;
/// Whoever puts down a magnet moves the table for no longer than this, seconds.
const TOUCH_S: f64 = 3.0;

/// Watches a resting board for visits.
#[derive(Default)]
pub(super) struct VisitWatch {
    rest: Option<Rest>,
}

/// A board that has not been turned since it came to rest.
struct Rest {
    /// The active filter, as it was before the visit.
    before: Filter,
    lay: Matrix3<f64>,
    visited: bool,
    /// For how long the board has moved without a pause, and for how long the field has been as it was, seconds.
    touched_s: f64,
    gone_s: f64,
}

impl VisitWatch {
    /// Takes a sample that the active filter has followed. Returns the filter of before a visit that has just ended.
    pub(super) fn take(&mut self, input: &Input, active: &Filter) -> Option<Filter> {
        let Some(rest) = &mut self.rest else {
            let undisturbed = input.still && active.begun() && !active.disturbed();
            self.rest = undisturbed.then(|| Rest::begin(input, active));
            return None;
        };
        if rest.has_ended(input) {
            self.rest = None;
            return None;
        }
        rest.visited |= active.disturbed();
        if !rest.visited {
            rest.before = active.clone();
        } else if rest.is_over(input) {
            return self.rest.take().map(|rest| rest.before);
        }
        None
    }

    /// The filter of before a visit, or of the sample before.
    pub(super) fn before(&mut self) -> Option<&mut Filter> {
        self.rest.as_mut().map(|rest| &mut rest.before)
    }
}

impl Rest {
    fn begin(input: &Input, active: &Filter) -> Self {
        Self {
            before: active.clone(),
            lay: input.to_frame,
            visited: false,
            touched_s: 0.0,
            gone_s: 0.0,
        }
    }

    fn has_ended(&mut self, input: &Input) -> bool {
        let touched_s = self.touched_s + input.period_s;
        self.touched_s = if input.still { 0.0 } else { touched_s };
        self.touched_s > TOUCH_S || turned_rad(&self.lay, &input.to_frame) > SWING_RAD
    }

    /// Whether the visit is over.
    fn is_over(&mut self, input: &Input) -> bool {
        self.before.pass(input);
        let gone = input.still && self.before.expects(input, DISTURBED);
        self.gone_s = if gone {
            self.gone_s + input.period_s
        } else {
            0.0
        };
        self.gone_s > GONE_S
    }
}
