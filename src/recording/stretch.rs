//! Which times of a log can be right, from one row to the next. Pure.
//!
//! | a row's time is, after the last one used | then |
//! |---|---|
//! | up to a second later | it follows |
//! | up to a second earlier | it is dropped |
//! | anything else, and the next row goes on from the last one used, and this one is earlier than the last or later than the next | it is odd: dropped |
//! | else up to a minute later | it follows: the log has a gap |
//! | anything else, and the next row goes on from this one | the time has jumped: a new stretch begins |
//! | anything else | it is odd: dropped |
//!
//! A row goes on from another if its time is the same or up to a minute later; a jump takes one that is later. The next
//! row is the next that can be understood.

/// Rows that are this near in time need no other to be judged by, seconds.
const NEAR_S: f64 = 1.0;

/// Longest gap in a stretch, seconds.
const GAP_S: f64 = 60.0;

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
