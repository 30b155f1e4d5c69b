//! Whether the calibration in force still fits: strength and dip of the field, and the gyro, held against it for as
//! long as the board is in use.
//!
//! Iron near the board disturbs it in one place or in some orientations, and for a while; a calibration that no
//! longer fits is wrong wherever the board goes. So evidence is kept by orientation, in eight sectors: about the last
//! ten seconds of motion in each. The calibration is disagreed with while at least three sectors, and three in eight
//! of those seen lately, say so, and at least four were seen. It has stopped fitting once that has gone on for
//! `heading.misfit_s` (less the time in which they agreed), and fits again when as much agreement has followed.
//! A board at rest tells nothing new.

use std::f64::consts::TAU;

use nalgebra::Vector3;

use super::{FUSED_TILT_SD_RAD, Pipeline};
use crate::calibration::model::Mode;
use crate::condition;
use crate::frame::wrap_pi;
use crate::heading::{Compass, Corrected};

const SECTORS: usize = 8;

/// As much motion as a sector remembers, seconds.
const SECTOR_MEMORY_S: f64 = 10.0;

/// A sector has an opinion after this much motion in it, seconds …
const OPINION_S: f64 = 1.0;

/// … and disagrees if field or gyro did for this share of it.
const DISAGREES: f64 = 0.6;

/// So many sectors must have an opinion, and so many must disagree.
const FEWEST_SEEN: usize = 4;
const FEWEST_AGAINST: usize = 3;

/// Heading against gyro is looked at over turns of this much, radians (90°), that take no longer than this, seconds.
const LEG_RAD: f64 = 1.57;
const LEG_LIMIT_S: f64 = 20.0;

/// What the heading may be off over such a turn, radians (12°): a bias of 0.15 of the horizontal field.
const LEG_TOLERANCE_RAD: f64 = 0.21;

/// What the dip may be off its mean, radians (10°), and how long that mean goes over, seconds of motion.
const DIP_TOLERANCE_RAD: f64 = 0.175;
const DIP_MEMORY_S: f64 = 60.0;
const DIP_LEARNT_S: f64 = 10.0;

/// A sample further from the one before counts as this long, seconds.
const LONGEST_STEP_S: f64 = 0.5;

impl Pipeline {
    /// Holds the calibration in force against a sample, unless a tilt makes it say little.
    pub(super) fn hold_against(
        &mut self,
        t_s: f64,
        compass: &Compass,
        corrected: &Corrected,
        down: Option<&Vector3<f64>>,
    ) {
        if self.attitude.at_rest() || corrected.tilt_sd_rad > FUSED_TILT_SD_RAD {
            return;
        }
        let spatial = compass.calibration().parameters.mode() == Mode::Spatial;
        let field = corrected.field_body;
        let witness = Witness {
            t_s,
            strength_off: condition::strength_is_off(
                self.strength_deviation,
                self.setup.pipeline.strength_tolerance,
                corrected.tilt_sd_rad,
            ),
            heading_rad: compass.heading_deg(corrected, down).map(f64::to_radians),
            dip_rad: down
                .filter(|_| spatial)
                .map(|down| field.dot(down).atan2(field.cross(down).norm())),
            yaw_rad: self.yaw_rad(t_s),
        };
        self.fitness.take(&witness, self.setup.pipeline.misfit_s);
    }

    /// Heading by the gyro alone, radians clockwise from anywhere, and its stretch.
    fn yaw_rad(&self, t_s: f64) -> Option<(f64, u32)> {
        let pose = self.attitude.pose_at(t_s)?;
        let nose = pose.orientation * Vector3::x();
        let flat = nose.xy().norm() > 0.17 && pose.vertical_known;
        flat.then(|| (-nose.y.atan2(nose.x), pose.stretch))
    }
}

/// What one sample says.
#[derive(Clone, Copy, Debug)]
struct Witness {
    t_s: f64,
    /// The field's strength is off by more than tilt and tolerance allow.
    strength_off: bool,
    /// Heading by the field alone, radians clockwise, where it is certain.
    heading_rad: Option<f64>,
    /// Dip of the corrected field, radians, where all of it is known.
    dip_rad: Option<f64>,
    /// Heading by the gyro alone, radians clockwise from anywhere, and the stretch for which it holds.
    yaw_rad: Option<(f64, u32)>,
}

/// What is remembered.
#[derive(Clone, Debug, Default)]
pub(super) struct Fitness {
    sectors: [Sector; SECTORS],
    last_s: Option<f64>,
    dip: Dip,
    leg: Option<Leg>,
    leg_off: bool,
    /// Time of disagreement less that of agreement, seconds.
    balance_s: f64,
    misfit: bool,
}

#[derive(Clone, Copy, Debug, Default)]
struct Sector {
    seen_s: f64,
    against_s: f64,
    last_s: f64,
}

#[derive(Clone, Copy, Debug, Default)]
struct Dip {
    mean_rad: f64,
    seen_s: f64,
}

#[derive(Clone, Copy, Debug)]
struct Leg {
    t_s: f64,
    heading_rad: f64,
    yaw_rad: f64,
    stretch: u32,
}

impl Fitness {
    /// Takes what a sample in motion says; `misfit_s` of disagreement, and the calibration has stopped fitting.
    fn take(&mut self, witness: &Witness, misfit_s: f64) {
        let t_s = witness.t_s;
        let step_s = self.last_s.map_or(0.0, |last_s| t_s - last_s);
        let step_s = step_s.clamp(0.0, LONGEST_STEP_S);
        self.last_s = Some(t_s);
        self.leg(witness);
        let dip_off = witness
            .dip_rad
            .is_some_and(|dip_rad| self.dip.is_off(dip_rad, step_s));
        // The gyro's is better, if there is one: with a large bias the field does not go round at all.
        let orientation = witness.yaw_rad.map(|(yaw_rad, _)| yaw_rad);
        let Some(orientation_rad) = orientation.or(witness.heading_rad) else {
            return;
        };
        let share = orientation_rad.rem_euclid(TAU) / TAU;
        let index = ((share * SECTORS as f64) as usize).min(SECTORS - 1);
        let against = witness.strength_off || dip_off || self.leg_off;
        self.sectors[index].take(t_s, step_s, against);
        match self.disagreement(t_s - misfit_s.max(DIP_MEMORY_S)) {
            Some(true) => self.balance_s = (self.balance_s + step_s).min(misfit_s),
            Some(false) => self.balance_s = (self.balance_s - step_s).max(0.0),
            None => {}
        }
        if self.balance_s >= misfit_s {
            self.misfit = true;
        } else if self.balance_s == 0.0 {
            self.misfit = false;
        }
    }

    /// Forgets what is remembered by its time; the opinion so far stays.
    pub(super) fn begin_stretch(&mut self) {
        *self = Self {
            balance_s: self.balance_s,
            misfit: self.misfit,
            ..Self::default()
        };
    }

    /// Whether the calibration has stopped fitting.
    pub(super) fn is_misfit(&self) -> bool {
        self.misfit
    }

    fn leg(&mut self, witness: &Witness) {
        let (Some(heading_rad), Some((yaw_rad, stretch))) = (witness.heading_rad, witness.yaw_rad)
        else {
            return;
        };
        let here = Leg {
            t_s: witness.t_s,
            heading_rad,
            yaw_rad,
            stretch,
        };
        let Some(leg) = self.leg.filter(|leg| leg.stretch == stretch) else {
            self.leg = Some(here);
            return;
        };
        let turned_rad = wrap_pi(yaw_rad - leg.yaw_rad);
        if turned_rad.abs() >= LEG_RAD {
            let off_rad = wrap_pi(heading_rad - leg.heading_rad - turned_rad);
            self.leg_off = off_rad.abs() > LEG_TOLERANCE_RAD;
            self.leg = Some(here);
        } else if here.t_s - leg.t_s > LEG_LIMIT_S {
            self.leg_off = false;
            self.leg = Some(here);
        }
    }

    /// Whether the sectors seen since then disagree; `None` if they are too few.
    fn disagreement(&self, since_s: f64) -> Option<bool> {
        let seen = |sector: &&Sector| sector.seen_s >= OPINION_S && sector.last_s >= since_s;
        let count = self.sectors.iter().filter(seen).count();
        let against = self
            .sectors
            .iter()
            .filter(seen)
            .filter(|sector| sector.against_s >= DISAGREES * sector.seen_s);
        let against = against.count();
        (count >= FEWEST_SEEN).then_some(against >= FEWEST_AGAINST && 8 * against >= 3 * count)
    }
}

impl Sector {
    fn take(&mut self, t_s: f64, step_s: f64, against: bool) {
        self.last_s = t_s;
        self.seen_s += step_s;
        if against {
            self.against_s += step_s;
        }
        if self.seen_s > SECTOR_MEMORY_S {
            self.against_s *= SECTOR_MEMORY_S / self.seen_s;
            self.seen_s = SECTOR_MEMORY_S;
        }
    }
}

impl Dip {
    /// Takes note of a dip, and says whether it is off those before.
    fn is_off(&mut self, dip_rad: f64, step_s: f64) -> bool {
        self.seen_s = (self.seen_s + step_s).min(DIP_MEMORY_S);
        if self.seen_s > 0.0 {
            self.mean_rad += (dip_rad - self.mean_rad) * step_s / self.seen_s;
        }
        self.seen_s >= DIP_LEARNT_S && (dip_rad - self.mean_rad).abs() > DIP_TOLERANCE_RAD
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A board that goes round once in 20 s for `turns`, with this error of its heading and strength at each yaw;
    /// the time in seconds at which the calibration was found to have stopped fitting.
    fn found_s(
        fitness: &mut Fitness,
        begun_s: f64,
        turns: f64,
        error_rad: impl Fn(f64) -> f64,
        strength_off: impl Fn(f64) -> bool,
    ) -> Option<f64> {
        let steps = (turns * 20.0 * 25.0) as usize;
        let mut found = None;
        for step in 0..steps {
            let t_s = begun_s + step as f64 * 0.04;
            let yaw_rad = wrap_pi(t_s / 20.0 * TAU);
            fitness.take(
                &Witness {
                    t_s,
                    strength_off: strength_off(yaw_rad),
                    heading_rad: Some(yaw_rad + 1.0 + error_rad(yaw_rad)),
                    dip_rad: None,
                    yaw_rad: Some((yaw_rad, 0)),
                },
                60.0,
            );
            if found.is_none() && fitness.is_misfit() {
                found = Some(t_s);
            }
        }
        found
    }

    #[test]
    fn a_calibration_that_fits_is_never_doubted() {
        let mut fitness = Fitness::default();
        // An error of 4° is no reason, and neither is iron in two sectors.
        let wobble = |yaw: f64| 0.07 * yaw.sin();
        let iron = |yaw: f64| yaw.abs() < 0.7;
        assert_eq!(found_s(&mut fitness, 0.0, 60.0, wobble, iron), None);
    }

    #[test]
    fn strength_or_gyro_against_it_in_many_orientations_make_it_stale_after_the_time_set() {
        type Case = (fn(f64) -> f64, fn(f64) -> bool);
        let cases: [Case; 2] = [
            (|_| 0.0, |yaw| yaw.cos().abs() > 0.5),
            (|yaw| 0.4 * yaw.sin(), |_| false),
        ];
        for (error, strength) in cases {
            let mut fitness = Fitness::default();
            let at_s = found_s(&mut fitness, 0.0, 20.0, error, strength).unwrap();
            assert!((60.0..100.0).contains(&at_s), "{at_s}");
            // It takes as long to be trusted again: each sector must see that it fits, and then the time must pass.
            found_s(&mut fitness, 400.0, 2.5, |_| 0.0, |_| false);
            assert!(fitness.is_misfit());
            found_s(&mut fitness, 450.0, 6.0, |_| 0.0, |_| false);
            assert!(!fitness.is_misfit());
        }
    }

    #[test]
    fn one_orientation_says_little_however_long() {
        let mut fitness = Fitness::default();
        for step in 0..50_000 {
            let witness = Witness {
                t_s: f64::from(step) * 0.04,
                strength_off: true,
                heading_rad: Some(0.3),
                dip_rad: Some(1.0),
                yaw_rad: Some((0.1, 0)),
            };
            fitness.take(&witness, 60.0);
        }
        assert!(!fitness.is_misfit());
    }

    #[test]
    fn a_dip_that_changes_with_attitude_is_against_it() {
        let mut fitness = Fitness::default();
        for step in 0..5_000 {
            let t_s = f64::from(step) * 0.04;
            let yaw_rad = t_s / 5.0 * TAU;
            let witness = Witness {
                t_s,
                strength_off: false,
                heading_rad: Some(yaw_rad),
                dip_rad: Some(1.2 + 0.4 * yaw_rad.cos()),
                yaw_rad: None,
            };
            fitness.take(&witness, 60.0);
        }
        assert!(fitness.is_misfit());
    }
}
