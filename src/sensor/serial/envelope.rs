//! The straight line under a cloud of arrivals: estimates when items were sent, from the least delayed arrivals.
//!
//! What is sent at even intervals arrives late by whatever the USB and the system take, never early. So the arrivals lie on
//! or above the line of the device's clock, and the lower hull of a few seconds of them finds its offset and its slope: by
//! how much the device's clock is fast or slow.
//!
//! Arrivals that are late may catch up, as buffered ones do, or stay late. The line learns nothing until that is clear.

use std::collections::VecDeque;

/// The least delayed arrival of each block of this length is kept, seconds.
const BLOCK_S: f64 = 0.25;
/// So many of them: 16 seconds.
const BLOCKS: usize = 64;
/// From this span of them on, seconds, the slope is learnt.
const SLOPE_FROM_S: f64 = 1.0;
/// Until the slope is learnt, the line follows only this many of the newest points.
const FOLLOWED: usize = 2;

/// A line from the device's clock (seconds, of any origin) to ours, beneath all arrivals.
#[derive(Clone, Debug)]
pub(super) struct Envelope {
    /// How far the device's clock may be off, as a share.
    tolerance: f64,
    slope: f64,
    pub(super) learnt: bool,
    /// A point of the line: device's clock, ours.
    anchor: Option<(f64, f64)>,
    /// The least delayed arrivals, oldest first: device's clock, ours.
    points: VecDeque<(f64, f64)>,
    block: Option<Block>,
    /// Late arrivals that come nearer to the line by more than this, seconds, are catching up.
    late_step_s: f64,
    late: Option<LateRun>,
}

#[derive(Clone, Debug)]
struct Block {
    begun_s: f64,
    best: (f64, f64),
}

/// Late arrivals since they caught up last.
#[derive(Clone, Copy, Debug)]
pub(super) struct LateRun {
    since_s: f64,
    from_s: f64,
    /// For how long they have been late, seconds.
    pub(super) lasts_s: f64,
    pub(super) arrivals: u32,
    /// How late they are at least, seconds.
    pub(super) least_s: f64,
}

impl Envelope {
    pub(super) fn new(tolerance: f64, late_step_s: f64) -> Self {
        Self {
            tolerance,
            late_step_s,
            late: None,
            slope: 1.0,
            learnt: false,
            anchor: None,
            points: VecDeque::with_capacity(BLOCKS + 1),
            block: None,
        }
    }

    /// Forgets the line's offset, but not its slope. The next arrival sets the offset.
    pub(super) fn restart(&mut self) {
        self.late = None;
        self.anchor = None;
        self.points.clear();
        self.block = None;
    }

    /// How late an arrival is, seconds; the first is not.
    pub(super) fn late_s(&self, device_s: f64, arrival_s: f64) -> f64 {
        let line_s = self.line_s(device_s).unwrap_or(arrival_s);
        arrival_s - line_s
    }

    /// An arrival came late by `late_s`.
    pub(super) fn late(&mut self, late_s: f64, arrival_s: f64) -> LateRun {
        let fresh = LateRun {
            since_s: arrival_s,
            from_s: late_s,
            lasts_s: 0.0,
            arrivals: 0,
            least_s: late_s,
        };
        let run = self.late.get_or_insert(fresh);
        if late_s < run.from_s - self.late_step_s {
            *run = fresh;
        }
        run.least_s = run.least_s.min(late_s);
        run.arrivals += 1;
        run.lasts_s = arrival_s - run.since_s;
        *run
    }

    /// An arrival came in time, or what the lateness means has been settled.
    pub(super) fn in_time(&mut self) {
        self.late = None;
    }

    /// When the arrival was sent, by our clock: never later than it came.
    pub(super) fn time(&mut self, device_s: f64, arrival_s: f64) -> f64 {
        if self.late.is_none() {
            self.learn(device_s, arrival_s);
        }
        let line_s = self.line_s(device_s).unwrap_or(arrival_s);
        line_s.min(arrival_s)
    }

    /// Our time of a time of the device's clock; `None` before the first arrival.
    fn line_s(&self, device_s: f64) -> Option<f64> {
        let (at_s, ours_s) = self.anchor?;
        Some(ours_s + self.slope * (device_s - at_s))
    }

    fn learn(&mut self, device_s: f64, arrival_s: f64) {
        match self.line_s(device_s) {
            // Nothing arrives before it was sent.
            Some(line_s) if line_s <= arrival_s => {}
            _ => self.anchor = Some((device_s, arrival_s)),
        }
        let point = (device_s, arrival_s);
        let slope = self.slope;
        let height = |(device_s, ours_s): (f64, f64)| ours_s - slope * device_s;
        let block = self.block.get_or_insert(Block {
            begun_s: arrival_s,
            best: point,
        });
        if height(point) < height(block.best) {
            block.best = point;
        }
        if arrival_s - block.begun_s >= BLOCK_S {
            self.points.push_back(block.best);
            self.block = None;
            if self.points.len() > BLOCKS {
                self.points.pop_front();
            }
            self.fit();
        }
    }

    fn fit(&mut self) {
        let (Some(&first), Some(&last)) = (self.points.front(), self.points.back()) else {
            return;
        };
        if last.0 - first.0 >= SLOPE_FROM_S
            && let Some(slope) = self.hull_slope()
        {
            self.slope = slope.clamp(1.0 - self.tolerance, 1.0 + self.tolerance);
            self.learnt = true;
        }
        let slope = self.slope;
        let followed = if self.learnt {
            self.points.len()
        } else {
            FOLLOWED
        };
        let lowest = self
            .points
            .iter()
            .rev()
            .take(followed)
            .map(|(device_s, ours_s)| ours_s - slope * device_s);
        let height = lowest.fold(f64::INFINITY, f64::min);
        self.anchor = Some((last.0, height + slope * last.0));
    }

    /// Slope of the lower hull's edge under the middle of the points: of all lines beneath them that is the
    /// one to which they are nearest on average.
    fn hull_slope(&self) -> Option<f64> {
        let mut hull: Vec<(f64, f64)> = Vec::with_capacity(self.points.len());
        for &point in &self.points {
            while let [.., a, b] = hull[..]
                && (b.1 - a.1) * (point.0 - a.0) >= (point.1 - a.1) * (b.0 - a.0)
            {
                hull.pop();
            }
            hull.push(point);
        }
        let middle =
            self.points.iter().map(|point| point.0).sum::<f64>() / self.points.len() as f64;
        let edge = hull.windows(2).find(|edge| edge[1].0 >= middle)?;
        let run = edge[1].0 - edge[0].0;
        (run > 0.0).then(|| (edge[1].1 - edge[0].1) / run)
    }
}
