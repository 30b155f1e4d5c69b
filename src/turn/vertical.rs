//! Detects turns about the vertical: how far the board has turned as seen from above, however it is held.

use std::collections::VecDeque;
use std::f64::consts::PI;

use nalgebra::{UnitQuaternion, Vector3};

use super::{Settings, Turn, from_vertical_deg};
use crate::attitude::{TICK_S, Tick};
use crate::frame::{hypot, wrap_pi};

/// Time between two notes, seconds.
const NOTE_S: f64 = 0.1;
/// Slower rotation before the start does not belong to the turn, rad/s.
const CREEP_RAD_S: f64 = 3.0 * PI / 180.0;
/// Time over which that is judged, seconds.
const CREEP_S: f64 = 0.5;
/// How far orientation may lag behind the integrated rate: bias at rest, levelling.
const SLACK_RAD: f64 = 15.0 * PI / 180.0;
/// A body tipped further than this from where it started has no heading to compare.
const TIPPED_RAD: f64 = 90.0 * PI / 180.0;

/// The most candidates examined in one tick.
const LOOKS: usize = 30;

/// What a close look at a candidate shows.
enum Look {
    Turn(Turn),
    NotYet,
    /// Nothing that begins at this note can become a turn.
    NeverFrom(usize),
}

/// Running sums at one instant; what lies between two notes is their difference.
#[derive(Clone, Copy)]
struct Note {
    t_s: f64,
    /// Net rotation about up, radians.
    angle: f64,
    /// Rotation about up both ways, radians, and the body's up weighted with it.
    travel: f64,
    up: Vector3<f64>,
    /// Net rotation in earth axes, radians.
    earth: Vector3<f64>,
    orientation: UnitQuaternion<f64>,
}

pub(super) struct Vertical {
    angle: f64,
    time_limit_s: f64,
    now: Option<Note>,
    resting: bool,
    /// One each tenth of a second of motion and one at the end of each rest, no older than the time limit.
    notes: VecDeque<Note>,
    /// Where in `notes` the net rotation was least and most.
    least: usize,
    most: usize,
    /// A candidate has been looked at and refused: not again before this time.
    next_look_s: f64,
}

impl Vertical {
    pub(super) fn new(settings: &Settings) -> Self {
        Self {
            angle: settings.angle_deg.to_radians(),
            time_limit_s: settings.time_limit_s,
            now: None,
            resting: false,
            notes: VecDeque::new(),
            least: 0,
            most: 0,
            next_look_s: f64::NEG_INFINITY,
        }
    }

    pub(super) fn progress(&self) -> f64 {
        let Some(now) = &self.now else { return 0.0 };
        let (rise, fall) = self.spans(now);
        rise.max(fall) / self.angle
    }

    /// By how much the net rotation has risen since its least note, and fallen since its most, radians.
    fn spans(&self, now: &Note) -> (f64, f64) {
        let at = |index: usize| self.notes.get(index).map_or(now.angle, |note| note.angle);
        (now.angle - at(self.least), at(self.most) - now.angle)
    }

    /// Takes a tick of which the vertical is known.
    pub(super) fn tick(&mut self, tick: &Tick) -> Option<Turn> {
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
        for _ in 0..LOOKS {
            let (rise, fall) = self.spans(&now);
            if rise.max(fall) < self.angle {
                break;
            }
            self.next_look_s = now.t_s + NOTE_S;
            match self.look(&now, if rise > fall { 1.0 } else { -1.0 }) {
                Look::Turn(turn) => return Some(turn),
                Look::NotYet => break,
                Look::NeverFrom(start) => {
                    // Nothing that began there can become a turn any more; something later may.
                    self.notes.drain(..=start);
                    self.find_extremes();
                }
            }
        }
        None
    }

    fn advance(&mut self, tick: &Tick) -> Note {
        let orientation = tick.pose.orientation;
        let before = self.now.get_or_insert(Note {
            t_s: tick.t_s - TICK_S,
            angle: 0.0,
            travel: 0.0,
            up: Vector3::zeros(),
            earth: Vector3::zeros(),
            orientation,
        });
        if self.notes.is_empty() {
            self.notes.push_back(*before);
        }
        before.t_s = tick.t_s;
        before.orientation = orientation;
        if !tick.at_rest {
            let turned = tick.rate_rad_s * TICK_S;
            let up = orientation.inverse_transform_vector(&Vector3::z());
            let about_up = turned.dot(&up);
            before.angle += about_up;
            before.travel += about_up.abs();
            before.up += up * about_up.abs();
            before.earth += orientation * turned;
        }
        *before
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
            if note.angle <= self.notes[self.least].angle {
                self.least = i;
            }
            if note.angle >= self.notes[self.most].angle {
                self.most = i;
            }
        }
    }

    /// Looks closely at the rotation since the extreme note: trims its start, asks the orientation.
    fn look(&self, now: &Note, sign: f64) -> Look {
        let start = self.trim(if sign > 0.0 { self.least } else { self.most }, now, sign);
        let first = &self.notes[start];
        let angle = (now.angle - first.angle) * sign;
        let Some(heading) = self.heading_since(start, now) else {
            return Look::NeverFrom(start);
        };
        if angle < self.angle || heading * sign < self.angle - SLACK_RAD {
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

    /// The note at which the turn began: after the extreme one, past any creeping.
    fn trim(&self, extreme: usize, now: &Note, sign: f64) -> usize {
        let from = self.notes[extreme].angle;
        let half_way = from + 0.5 * (now.angle - from);
        let last_below = self
            .notes
            .iter()
            .rfind(|note| (note.angle - half_way) * sign < 0.0);
        // A turn that is slow throughout does not creep at its start.
        let late_rate = last_below.map_or(f64::INFINITY, |note| {
            (now.angle - note.angle).abs() / (now.t_s - note.t_s).max(NOTE_S)
        });
        let creep = CREEP_RAD_S.min(late_rate / 4.0);
        let mut start = extreme;
        while let Some(here) = self.notes.get(start) {
            let later = |note: &&Note| note.t_s - here.t_s >= CREEP_S;
            let Some(ahead) = self.notes.range(start..).find(later) else {
                break;
            };
            if (ahead.angle - here.angle) * sign >= creep * (ahead.t_s - here.t_s) {
                break;
            }
            start += 1;
        }
        start
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
