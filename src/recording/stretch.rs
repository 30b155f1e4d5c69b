//! Which times of a log can be right, from one row to the next. Pure.
//!
//! | a row's time is, after the last one used | then |
//! |---|---|
//! | up to a second later | it follows; a new stretch begins if the rows before it were dropped since the clock was set back |
//! | up to a second earlier | it is dropped |
//! | anything else, where the next row goes on from the last one used and this one does not lie between the two | it is odd: dropped |
//! | else up to a minute later | it follows: the log has a gap |
//! | anything else, and the next row goes on from this one | the time has jumped: a new stretch begins |
//! | anything else | it is odd: dropped |
//!
//! A row goes on from another if its time is the same or up to a minute later; a jump takes one that is later. The next
//! row is the next that can be understood.

use crate::reading::Reading;

/// Rows that are this near in time need no other to be judged by, seconds.
const NEAR_S: f64 = 1.0;

/// Longest gap in a stretch, seconds.
const GAP_S: f64 = 60.0;

/// If rows of gyro and magnetometer have been dropped for longer, seconds, the clock was set back, and nothing has followed the motion
/// meanwhile: a hand turns a board by 10° in that time. A shorter run may be rows in a wrong order.
const SET_BACK_S: f64 = 0.05;

/// What a row's time means.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum TimeOrder {
    /// It follows the last one.
    Follows,
    /// It cannot be right.
    Odd,
    /// From here on another time counts.
    Jump,
}

/// The order, if it is known without the next row. `last_s` is the last time used, if there is one.
pub(super) fn at_once(last_s: Option<f64>, t_s: f64) -> Option<TimeOrder> {
    let Some(last_s) = last_s else {
        return Some(TimeOrder::Follows);
    };
    match t_s - last_s {
        step_s if (0.0..=NEAR_S).contains(&step_s) => Some(TimeOrder::Follows),
        step_s if (-NEAR_S..0.0).contains(&step_s) => Some(TimeOrder::Odd),
        _ => None,
    }
}

/// The order where it depends on the time of the next row, if there is one.
pub(super) fn before(last_s: f64, t_s: f64, next_s: Option<f64>) -> TimeOrder {
    let goes_on = |from_s: f64, to_s: f64| (0.0..=GAP_S).contains(&(to_s - from_s));
    match next_s {
        Some(next_s) if goes_on(last_s, next_s) && (t_s < last_s || next_s < t_s) => TimeOrder::Odd,
        _ if goes_on(last_s, t_s) => TimeOrder::Follows,
        // A repeated time does not go on.
        Some(next_s) if next_s > t_s && goes_on(t_s, next_s) => TimeOrder::Jump,
        _ => TimeOrder::Odd,
    }
}

/// The rows that have been dropped since the last one used.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct DroppedRows {
    /// Times of the first and the last gyro row, as far as they rise, seconds.
    gyro_s: Option<(f64, f64)>,
    field: bool,
}

impl DroppedRows {
    /// Takes a row that was dropped, `behind_s` after the last one used. One that is far off has an odd time itself.
    pub(super) fn take(&mut self, reading: &Reading, behind_s: f64) {
        if !(0.0..=NEAR_S).contains(&behind_s) {
            return;
        }
        self.field |= reading.field_mgauss.is_some();
        if reading.rate_rad_s.is_some() {
            let first_s = match self.gyro_s {
                Some((first_s, last_s)) if reading.t_s >= last_s => first_s,
                _ => reading.t_s,
            };
            self.gyro_s = Some((first_s, reading.t_s));
        }
    }

    /// Whether motion has been lost with them. Rows of the gyro alone may come in blocks, late.
    pub(super) fn lost_motion(&self) -> bool {
        let lasts = |(first_s, last_s): (f64, f64)| last_s - first_s > SET_BACK_S;
        self.field && self.gyro_s.is_some_and(lasts)
    }
}
