//! Detects turns about a body axis: a chain of short rotations whose axes stay together.

use std::collections::VecDeque;
use std::f64::consts::PI;

use nalgebra::{UnitQuaternion, Vector3};

use super::{Settings, Turn, from_vertical_deg};
use crate::attitude::{BoardMotion, TICK_S};

/// Rotation that makes a link, radians: enough to tell its axis from a hand's tremor.
const LINK_RAD: f64 = 20.0 * PI / 180.0;
/// A link begins when this much of it has been turned, radians: a rest before does not belong to it.
const BEGUN_RAD: f64 = 2.0 * PI / 180.0;
/// Turns about an axis this near to the vertical are left to the detector about the vertical, degrees.
const UPRIGHT_DEG: f64 = 30.0;

/// One short rotation; of the open link, the rotation so far.
#[derive(Clone, Copy)]
struct Link {
    start_s: f64,
    /// Rotation in body axes, and net rotation in earth axes where the vertical was known.
    turned: UnitQuaternion<f64>,
    earth: Option<Vector3<f64>>,
    /// The time, and the two rotations by then, at which half a link had been turned.
    half: Option<(f64, UnitQuaternion<f64>, Option<Vector3<f64>>)>,
}

impl Link {
    fn at(t_s: f64) -> Self {
        Self {
            start_s: t_s,
            turned: UnitQuaternion::identity(),
            earth: Some(Vector3::zeros()),
            half: None,
        }
    }

    /// Adds the rotation of a tick; returns all of it, a rotation vector in body axes.
    fn turn(&mut self, tick: &BoardMotion) -> Vector3<f64> {
        let step = tick.rate_rad_s * TICK_S;
        self.turned *= UnitQuaternion::from_scaled_axis(step);
        let earth = self.earth.filter(|_| tick.pose.vertical_known);
        self.earth = earth.map(|earth| earth + tick.pose.orientation * step);
        let turned = self.vector();
        if !self.begun() {
            self.start_s = tick.t_s;
            self.earth = Some(Vector3::zeros());
        }
        if self.half.is_none() && turned.norm() >= 0.5 * LINK_RAD {
            self.half = Some((tick.t_s, self.turned, self.earth));
        }
        turned
    }

    /// What was turned after half a link, where that is about another axis than the whole: the axis has changed within.
    fn after_change(&self, cos_tolerance: f64) -> Option<Self> {
        let (start_s, turned, earth) = self.half?;
        let second = Self {
            start_s,
            turned: turned.inverse() * self.turned,
            earth: self.earth.zip(earth).map(|(all, half)| all - half),
            half: None,
        };
        let (part, whole) = (second.vector(), self.vector());
        (part.dot(&whole) < part.norm() * whole.norm() * cos_tolerance).then_some(second)
    }

    fn begun(&self) -> bool {
        self.turned.angle() >= BEGUN_RAD
    }

    /// Rotation vector, body axes.
    fn vector(&self) -> Vector3<f64> {
        self.turned.scaled_axis()
    }
}

#[derive(Default)]
pub(super) struct Chain {
    full_turn_rad: f64,
    cos_tolerance: f64,
    time_limit_s: f64,
    links: VecDeque<Link>,
    open: Option<Link>,
    /// Mean axis of the links, a unit vector; zero without links.
    axis: Vector3<f64>,
    /// Net rotation of all links about it; where in the chain it was least and most, and how much.
    net: f64,
    least: (usize, f64),
    most: (usize, f64),
    /// The larger of the net rotations since those two, with the open link.
    span: f64,
}

impl Chain {
    pub(super) fn new(settings: &Settings) -> Self {
        Self {
            full_turn_rad: settings.angle_deg.to_radians(),
            cos_tolerance: settings.axis_tolerance_deg.to_radians().cos(),
            time_limit_s: settings.time_limit_s,
            ..Self::default()
        }
    }

    pub(super) fn progress(&self) -> f64 {
        self.span / self.full_turn_rad
    }

    /// Takes a tick. A turn that the detector about the vertical is about to complete is left to it for `patience_rad` more rotation: that
    /// detector trims the start more precisely.
    pub(super) fn tick(&mut self, tick: &BoardMotion, patience_rad: f64) -> Option<Turn> {
        let oldest_s = tick.t_s - self.time_limit_s;
        if self.links.front().is_some_and(|l| l.start_s < oldest_s) {
            self.links.pop_front();
            self.measure();
        }
        self.open.take_if(|open| open.start_s < oldest_s);
        let mut open = self.open.unwrap_or_else(|| Link::at(tick.t_s - TICK_S));
        if tick.at_rest {
            if !open.begun() {
                open.start_s = tick.t_s;
            }
            // Without a link, what came before was no more than a start, or the bias not learnt yet.
            self.open = (!self.links.is_empty()).then_some(open);
            return None;
        }
        let turned = open.turn(tick);
        self.open = Some(open);
        let now = self.net + self.axis.dot(&turned);
        let (rise, fall) = (now - self.least.1, self.most.1 - now);
        self.span = rise.max(fall);
        if self.span >= self.full_turn_rad {
            let (first, _) = if rise > fall { self.least } else { self.most };
            let turn = self.close(tick.t_s, first);
            let upright = |turn: &Turn| turn.from_vertical_deg.is_some_and(|deg| deg < UPRIGHT_DEG);
            if self.span >= self.full_turn_rad + patience_rad || !turn.is_some_and(|t| upright(&t))
            {
                return turn;
            }
        }
        if turned.norm() >= LINK_RAD {
            self.open = Some(Link::at(tick.t_s));
            // Where the axis has changed within this link, as after what was left of another turn, the new chain begins half-way.
            match open.after_change(self.cos_tolerance) {
                Some(second) if !self.fits(&turned) => {
                    self.links.clear();
                    self.measure();
                    self.open = Some(second);
                }
                _ => self.add(open),
            }
        }
        None
    }

    /// Whether an axis, either way round, is within the tolerance of the chain's.
    fn fits(&self, turned: &Vector3<f64>) -> bool {
        turned.dot(&self.axis).abs() >= turned.norm() * self.cos_tolerance
    }

    fn add(&mut self, link: Link) {
        if !self.links.is_empty() && !self.fits(&link.vector()) {
            self.links.clear();
        }
        self.links.push_back(link);
        self.measure();
        // The mean moves with each link: the oldest must still fit.
        while self.links.iter().any(|link| !self.fits(&link.vector())) {
            self.links.pop_front();
            self.measure();
        }
    }

    /// Mean axis, and the rotation about it link by link.
    fn measure(&mut self) {
        let newest = self.links.back().map_or(Vector3::zeros(), Link::vector);
        let sum: Vector3<f64> = self
            .links
            .iter()
            .map(Link::vector)
            .map(|turned| turned * turned.dot(&newest).signum())
            .sum();
        self.axis = sum.try_normalize(1e-9).unwrap_or_default();
        self.net = 0.0;
        (self.least, self.most) = ((0, 0.0), (0, 0.0));
        for (i, link) in self.links.iter().enumerate() {
            self.net += self.axis.dot(&link.vector());
            if self.net <= self.least.1 {
                self.least = (i + 1, self.net);
            }
            if self.net >= self.most.1 {
                self.most = (i + 1, self.net);
            }
        }
        self.span = (self.net - self.least.1).max(self.most.1 - self.net);
    }

    /// The turn since the link `first`, which the open one has completed.
    fn close(&self, end_s: f64, first: usize) -> Option<Turn> {
        let last = self.open.as_ref()?;
        let links = || self.links.range(first..).chain([last]);
        let axis = links().map(Link::vector).sum::<Vector3<f64>>();
        Some(Turn {
            start_s: links().next()?.start_s,
            end_s,
            axis_body: axis.try_normalize(1e-9)?,
            from_vertical_deg: links()
                .map(|link| link.earth)
                .sum::<Option<Vector3<f64>>>()
                .and_then(from_vertical_deg),
        })
    }
}
