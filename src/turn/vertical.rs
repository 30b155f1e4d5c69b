//! Detects turns about the vertical: how far the board has turned as seen from above, however it is held.

use std::collections::VecDeque;
use std::f64::consts::PI;

use nalgebra::{UnitQuaternion, Vector3};

use super::{Settings, Turn, from_vertical_deg};
use crate::attitude::{BoardMotion, TICK_S};
use crate::frame::{hypot, wrap_pi};

/// Time between two notes, seconds.
const NOTE_S: f64 = 0.1;
/// Slower rotation before the start does not belong to the turn, rad/s.
const CREEP_RAD_S: f64 = 3.0 * PI / 180.0;
/// Time over which creeping is judged, seconds.
const CREEP_S: f64 = 0.5;
/// How far the turn by orientation may be behind that by the integrated rate, radians (15°): rest and levelling take from it.
const SLACK_RAD: f64 = 15.0 * PI / 180.0;
/// Turning back by more than this, radians, starts a new turn; a hand wavers by less.
const BACK_RAD: f64 = 10.0 * PI / 180.0;
/// A board that has turned on by this share of a turn is about to complete it.
const HALF_MADE: f64 = 0.5;
/// A board that stands still for this long, seconds, is not about to complete a turn.
const STOPPED_S: f64 = 1.0;
/// A body tipped further than this from where it started has no heading to compare.
const TIPPED_RAD: f64 = 90.0 * PI / 180.0;

/// The most candidates examined in one tick.
const LOOKS: usize = 30;

/// What a close look at a candidate shows.
enum Look {
    Turn(Turn),
    NotYet,
    /// A turn, but a better one is about to be complete.
    Wait,
    /// Nothing that begins at this note can become a turn.
    NeverFrom(usize),
}

/// Running sums at one instant; what lies between two notes is their difference.
#[derive(Clone, Copy)]
struct Note {
    t_s: f64,
    /// Net rotation about up, radians.
    turned_rad: f64,
    /// Rotation about up both ways, radians, and the body's up weighted with it.
    travel: f64,
    up: Vector3<f64>,
    /// Net rotation in earth axes, radians.
    earth: Vector3<f64>,
    orientation: UnitQuaternion<f64>,
}

#[derive(Default)]
pub(super) struct Vertical {
    full_turn_rad: f64,
    time_limit_s: f64,
    now: Option<Note>,
    resting: bool,
    /// One each tenth of a second of motion and one at the end of each rest, no older than the time limit.
    notes: VecDeque<Note>,
    /// Where in `notes` the net rotation was least and most.
    least: usize,
    most: usize,
    /// After a refused candidate, no other is looked at before this time.
    next_look_s: f64,
    /// The last candidate was a turn, but a better one is about to be complete.
    pub(super) waits: bool,
}

impl Vertical {
    pub(super) fn new(settings: &Settings) -> Self {
        Self {
            full_turn_rad: settings.angle_deg.to_radians(),
            time_limit_s: settings.time_limit_s,
            next_look_s: f64::NEG_INFINITY,
            ..Self::default()
        }
    }

    pub(super) fn progress(&self) -> f64 {
        let Some(now) = &self.now else { return 0.0 };
        let (rise, fall) = self.spans(now);
        rise.max(fall) / self.full_turn_rad
    }

    /// By how much the net rotation has risen since its least note, and fallen since its most, radians.
    fn spans(&self, now: &Note) -> (f64, f64) {
        let turned_rad = |index: usize| self.notes.get(index).unwrap_or(now).turned_rad;
        let rise = now.turned_rad - turned_rad(self.least);
        (rise, turned_rad(self.most) - now.turned_rad)
    }

    /// Takes a tick of which the vertical is known.
    pub(super) fn tick(&mut self, tick: &BoardMotion) -> Option<Turn> {
        if let Some(before) = self.now
            && self.resting
            && !tick.at_rest
        {
            self.notes.push_back(before);
        }
        self.resting = tick.at_rest;
        let now = self.advance(tick);
        self.keep_notes(&now, tick.at_rest);
        if now.t_s < self.next_look_s {
            return None;
        }
        self.waits = false;
        for _ in 0..LOOKS {
            let (rise, fall) = self.spans(&now);
            if rise.max(fall) < self.full_turn_rad {
                break;
            }
            self.next_look_s = now.t_s + NOTE_S;
            match self.look(&now, if rise > fall { 1.0 } else { -1.0 }) {
                Look::Turn(turn) => return Some(turn),
                Look::NotYet => break,
                Look::Wait => {
                    self.waits = true;
                    break;
                }
                Look::NeverFrom(start) => {
                    // Nothing that began there can become a turn any more; something later may.
                    self.notes.drain(..=start);
                    self.find_extremes();
                }
            }
        }
        None
    }

    fn advance(&mut self, tick: &BoardMotion) -> Note {
        let orientation = tick.pose.orientation;
        let now = self.now.get_or_insert(Note {
            t_s: tick.t_s - TICK_S,
            turned_rad: 0.0,
            travel: 0.0,
            up: Vector3::zeros(),
            earth: Vector3::zeros(),
            orientation,
        });
        if self.notes.is_empty() {
            self.notes.push_back(*now);
        }
        now.t_s = tick.t_s;
        now.orientation = orientation;
        if !tick.at_rest {
            let turned = tick.rate_rad_s * TICK_S;
            let up = orientation.inverse_transform_vector(&Vector3::z());
            let about_up = turned.dot(&up);
            now.turned_rad += about_up;
            now.travel += about_up.abs();
            now.up += up * about_up.abs();
            now.earth += orientation * turned;
        }
        *now
    }

    /// Adds a note when due, but a rest fills no memory; drops those too old.
    fn keep_notes(&mut self, now: &Note, at_rest: bool) {
        let oldest_s = now.t_s - self.time_limit_s;
        let mut changed = false;
        while self.notes.front().is_some_and(|note| note.t_s < oldest_s) {
            self.notes.pop_front();
            changed = true;
        }
        let due = |note: &Note| now.t_s - note.t_s >= NOTE_S;
        if self.notes.is_empty() || !at_rest && self.notes.back().is_some_and(due) {
            self.notes.push_back(*now);
            changed = true;
        }
        if changed {
            self.find_extremes();
        }
    }

    fn find_extremes(&mut self) {
        (self.least, self.most) = (0, 0);
        for (i, note) in self.notes.iter().enumerate() {
            // The last of equals: a rest before the turn does not belong to it.
            if note.turned_rad <= self.notes[self.least].turned_rad {
                self.least = i;
            }
            if note.turned_rad >= self.notes[self.most].turned_rad {
                self.most = i;
            }
        }
    }

    /// Looks closely at the rotation since the extreme note: trims its start, asks the orientation.
    fn look(&self, now: &Note, sign: f64) -> Look {
        let extreme = if sign > 0.0 { self.least } else { self.most };
        let creep_rad_s = self.creep_rad_s(extreme, now, sign);
        let goes_on = |from: &Note, to: &Note| {
            (to.turned_rad - from.turned_rad) * sign >= creep_rad_s * (to.t_s - from.t_s)
        };
        let steady = self.steady(extreme, goes_on, sign);
        let made = (now.turned_rad - self.notes[steady].turned_rad) * sign;
        let before = (self.notes[steady].turned_rad - self.notes[extreme].turned_rad) * sign;
        let whole = made >= self.full_turn_rad;
        let a_while_ago = self
            .notes
            .iter()
            .rfind(|note| now.t_s - note.t_s >= STOPPED_S);
        let turns_on = a_while_ago.is_some_and(|then| goes_on(then, now));
        if !whole && before > BACK_RAD && made >= HALF_MADE * self.full_turn_rad && turns_on {
            return Look::Wait;
        }
        let start = self.trim(if whole { steady } else { extreme }, goes_on);
        let first = &self.notes[start];
        let turned_rad = (now.turned_rad - first.turned_rad) * sign;
        let Some(heading) = self.heading_since(start, now) else {
            return Look::NeverFrom(start);
        };
        if turned_rad < self.full_turn_rad || heading * sign < self.full_turn_rad - SLACK_RAD {
            return Look::NotYet;
        }
        let up = (now.up - first.up) / (now.travel - first.travel);
        let Some(axis) = up.try_normalize(1e-3) else {
            return Look::NeverFrom(start);
        };
        Look::Turn(Turn {
            start_s: first.t_s,
            end_s: now.t_s,
            axis_body: axis * sign,
            from_vertical_deg: from_vertical_deg(now.earth - first.earth),
        })
    }

    /// Slowest rotation that belongs to the turn since a note, rad/s: a turn that is slow throughout does not creep at its start.
    fn creep_rad_s(&self, extreme: usize, now: &Note, sign: f64) -> f64 {
        let from = self.notes[extreme].turned_rad;
        let half_way = from + 0.5 * (now.turned_rad - from);
        let last_below = self
            .notes
            .iter()
            .rfind(|note| (note.turned_rad - half_way) * sign < 0.0);
        let late_rate = last_below.map_or(f64::INFINITY, |note| {
            (now.turned_rad - note.turned_rad).abs() / (now.t_s - note.t_s).max(NOTE_S)
        });
        CREEP_RAD_S.min(late_rate / 4.0)
    }

    /// The note since which the board has turned without a stop and never back; `extreme` if it always has. What a hand did with the
    /// board before that may have tilted it.
    fn steady(&self, extreme: usize, goes_on: impl Fn(&Note, &Note) -> bool, sign: f64) -> usize {
        let mut steady = self.notes.len() - 1;
        for i in (extreme..self.notes.len()).rev() {
            let here = &self.notes[i];
            let back = (here.turned_rad - self.notes[steady].turned_rad) * sign;
            let ahead = self.ahead(i, STOPPED_S);
            if back > BACK_RAD || ahead.is_some_and(|ahead| !goes_on(here, ahead)) {
                break;
            }
            if back <= 0.0 {
                steady = i;
            }
        }
        steady
    }

    /// The first note that is so many seconds later than this one.
    fn ahead(&self, index: usize, seconds: f64) -> Option<&Note> {
        let from_s = self.notes[index].t_s + seconds;
        self.notes.range(index..).find(|note| note.t_s >= from_s)
    }

    /// The note at which the turn began: after this one, past any creeping.
    fn trim(&self, from: usize, goes_on: impl Fn(&Note, &Note) -> bool) -> usize {
        let creeps = |&start: &usize| {
            let ahead = self.ahead(start, CREEP_S);
            ahead.is_some_and(|ahead| !goes_on(&self.notes[start], ahead))
        };
        (from..self.notes.len())
            .find(|start| !creeps(start))
            .unwrap_or(from)
    }

    /// How far the heading has come round since a note, by orientation; `None` if the body was tipped over.
    ///
    /// The integrated rate alone would count a board that is swung in circles without ever coming round:
    /// its rate has a vertical part that adds up.
    fn heading_since(&self, start: usize, now: &Note) -> Option<f64> {
        let first = self.notes[start].orientation.inverse();
        let mut heading = 0.0;
        for note in self.notes.range(start..).chain([now]) {
            let since = note.orientation * first;
            // The cosine of half the angle by which the body's up has tipped.
            let upright = hypot(since.w, since.k);
            if upright < (0.5 * TIPPED_RAD).cos() {
                return None;
            }
            let twist = 2.0 * since.k.atan2(since.w);
            heading += wrap_pi(twist - heading);
        }
        Some(heading)
    }
}
