//! Compares the corrected field with the gyro: this finds a fit with small residuals whose heading turns wrongly.

use std::f64::consts::PI;

use nalgebra::{Unit, Vector3};

use super::medians::{median, median_of};
use crate::attitude::Pose;
use crate::frame::{hypot, wrap_pi};

/// How well the corrected field and the gyro agree.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GyroAgreement {
    /// RMS of the corrected heading against the integrated rate, after an offset for each stretch and
    /// one linear drift are taken off, degrees.
    pub rms_deg: f64,
    /// That drift over the whole, as a share of the whole rotation: a wrong scale of the gyro, its bias, or,
    /// near 2, a gyro of the wrong sign.
    pub drift_share: f64,
}

/// One sample's direction of the corrected field, where there is a pose to hold it against.
#[derive(Clone, Copy, Debug)]
pub struct Sighting {
    /// Seconds.
    pub t_s: f64,
    /// The pose.
    pub pose: Pose,
    /// Corrected field, body axes, milligauss.
    pub field_body: Vector3<f64>,
}

/// How many sightings an agreement needs at least.
const LEAST: usize = 20;

/// In a plane with this orthonormal basis, body axes: the angle of the field in the plane turns back by as much as the
/// board turns about the normal.
pub fn planar(sightings: &[Sighting], [e1, e2]: [Vector3<f64>; 2]) -> Option<GyroAgreement> {
    let normal = e1.cross(&e2);
    let angle = |sighting: &Sighting, turned_rad: f64| {
        let field = &sighting.field_body;
        field.dot(&e2).atan2(field.dot(&e1)) + turned_rad
    };
    detrend(phases(sightings, |step| step.dot(&normal), angle))
}

/// In space: the field, turned into the earth frame, keeps its azimuth. Where the vertical is not known,
/// it keeps its angle in a plane through the mean field.
pub fn spatial(sightings: &[Sighting]) -> Option<GyroAgreement> {
    let earth = |sighting: &Sighting| sighting.pose.orientation * sighting.field_body;
    let (e1, e2) = if sightings.iter().all(|s| s.pose.vertical_known) {
        (Vector3::x(), Vector3::y())
    } else {
        // Any frame will do; take the mean field as one axis of the plane it is looked at in.
        let mean = Unit::try_new(sightings.iter().map(earth).sum::<Vector3<f64>>(), 1e-9)?;
        let across = if mean.z.abs() < 0.9 {
            Vector3::z()
        } else {
            Vector3::x()
        };
        (*mean, *Unit::new_normalize(across.cross(&mean)))
    };
    let azimuth = |sighting: &Sighting, _| {
        let field = earth(sighting);
        field.dot(&e2).atan2(field.dot(&e1))
    };
    detrend(phases(sightings, Vector3::norm, azimuth))
}

/// A sighting's angle that stays the same where field and gyro agree.
#[derive(Clone, Copy)]
struct Phase {
    t_s: f64,
    frame_id: u32,
    rad: f64,
    /// How far the board has turned so far, radians.
    turned_rad: f64,
}

/// The phase of each sighting. `turn` gives the angle that a rotation vector (body axes) counts for, `angle` the phase of a sighting
/// after that much rotation in all.
fn phases(
    sightings: &[Sighting],
    turn: impl Fn(&Vector3<f64>) -> f64,
    angle: impl Fn(&Sighting, f64) -> f64,
) -> Vec<Phase> {
    let mut turned_rad = 0.0;
    let mut previous: Option<Pose> = None;
    let phase = |sighting: &Sighting| {
        let pose = sighting.pose;
        if let Some(before) = previous.filter(|before| before.frame_id == pose.frame_id) {
            turned_rad += turn(&(before.orientation.inverse() * pose.orientation).scaled_axis());
        }
        previous = Some(pose);
        Phase {
            t_s: sighting.t_s,
            frame_id: pose.frame_id,
            rad: angle(sighting, turned_rad),
            turned_rad,
        }
    };
    sightings.iter().map(phase).collect()
}

/// Elevation of the corrected field above the horizontal, RMS about its mean, degrees: mounting errors
/// and soft iron that the fit cannot see show as a dip that changes with attitude.
pub fn dip_spread_deg(sightings: &[Sighting]) -> Option<f64> {
    if sightings.len() < LEAST || !sightings.iter().all(|s| s.pose.vertical_known) {
        return None;
    }
    let dips: Vec<f64> = sightings.iter().map(dip_rad).collect();
    let mean = dips.iter().sum::<f64>() / dips.len() as f64;
    let variance = dips.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / dips.len() as f64;
    Some(variance.sqrt().to_degrees())
}

/// Mean dip, positive where the field points down, radians, where the vertical is known.
pub fn mean_dip_rad(sightings: &[Sighting]) -> Option<f64> {
    let dips: Vec<f64> = sightings
        .iter()
        .filter(|s| s.pose.vertical_known)
        .map(dip_rad)
        .collect();
    (!dips.is_empty()).then(|| dips.iter().sum::<f64>() / dips.len() as f64)
}

fn dip_rad(sighting: &Sighting) -> f64 {
    let earth = sighting.pose.orientation * sighting.field_body;
    (-earth.z).atan2(hypot(earth.x, earth.y))
}

/// Takes an offset for each stretch and one drift off the unwrapped phases.
fn detrend(mut phases: Vec<Phase>) -> Option<GyroAgreement> {
    if phases.len() < LEAST {
        return None;
    }
    for stretch in phases.chunk_by_mut(|a, b| a.frame_id == b.frame_id) {
        unwrap(stretch);
    }
    phases = without_lone(phases);
    // Centre each stretch, then one slope through all.
    let mut rotation = 0.0;
    let (mut tt, mut tp, mut span) = (0.0, 0.0, 0.0);
    for stretch in phases.chunk_by_mut(|a, b| a.frame_id == b.frame_id) {
        let n = stretch.len() as f64;
        let t_mean = stretch.iter().map(|p| p.t_s).sum::<f64>() / n;
        let p_mean = stretch.iter().map(|p| p.rad).sum::<f64>() / n;
        span += stretch[stretch.len() - 1].t_s - stretch[0].t_s;
        rotation += stretch
            .windows(2)
            .map(|w| (w[1].turned_rad - w[0].turned_rad).abs())
            .sum::<f64>();
        for phase in stretch.iter_mut() {
            phase.t_s -= t_mean;
            phase.rad -= p_mean;
            tt += phase.t_s * phase.t_s;
            tp += phase.t_s * phase.rad;
        }
    }
    let drift = if tt > 0.0 { tp / tt } else { 0.0 };
    let squares: f64 = phases.iter().map(|p| (p.rad - drift * p.t_s).powi(2)).sum();
    Some(GyroAgreement {
        rms_deg: (squares / phases.len() as f64).sqrt().to_degrees(),
        drift_share: (drift * span).abs() / rotation.max(1e-9),
    })
}

/// Brings each phase to within half a turn of the median of the five before it: a single spike that lands
/// across the circle must not add a turn.
fn unwrap(stretch: &mut [Phase]) {
    // Whole turns so far, radians.
    let mut turns = 0.0;
    for i in 1..stretch.len() {
        let (before, rest) = stretch.split_at_mut(i);
        let (before, phase) = (&before[i.saturating_sub(5)..], &mut rest[0].rad);
        *phase += turns;
        // A phase near all of them is near their median too.
        if before.iter().all(|b| (*phase - b.rad).abs() < PI) {
            continue;
        }
        let mut known: Vec<f64> = before.iter().map(|b| b.rad).collect();
        let Some(typical) = median(&mut known) else {
            continue;
        };
        let near = typical + wrap_pi(*phase - typical);
        turns += near - *phase;
        *phase = near;
    }
}

/// Drops phases far from the median of the five about them: spikes that happen to lie on the fitted curve.
fn without_lone(phases: Vec<Phase>) -> Vec<Phase> {
    const FAR_RAD: f64 = 0.5;
    let mut kept = Vec::with_capacity(phases.len());
    for stretch in phases.chunk_by(|a, b| a.frame_id == b.frame_id) {
        for (i, phase) in stretch.iter().enumerate() {
            let around = (i >= 2).then(|| stretch.get(i - 2..i + 3)).flatten();
            let far = around.is_some_and(|around| {
                let typical = median_of::<5>(std::array::from_fn(|k| around[k].rad));
                (phase.rad - typical).abs() > FAR_RAD
            });
            if !far {
                kept.push(*phase);
            }
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use nalgebra::UnitQuaternion;

    use super::*;

    /// A level board turning at `rate` with a field that turns back at `seen`.
    fn turning(rate: f64, seen: f64, count: usize) -> Vec<Sighting> {
        (0..count)
            .map(|i| {
                let t_s = i as f64 * 0.025;
                let about_down =
                    |angle: f64| UnitQuaternion::from_scaled_axis(Vector3::z() * angle);
                // Body Z points down: the earth frame's Z is up.
                let flip = UnitQuaternion::from_scaled_axis(Vector3::x() * std::f64::consts::PI);
                Sighting {
                    t_s,
                    pose: Pose {
                        orientation: flip * about_down(rate * t_s),
                        vertical_known: true,
                        frame_id: 0,
                    },
                    field_body: about_down(-seen * t_s) * Vector3::new(160.0, 0.0, 500.0),
                }
            })
            .collect()
    }

    #[test]
    fn a_field_that_turns_as_the_gyro_says_agrees() {
        for found in [
            planar(&turning(0.9, 0.9, 400), [Vector3::x(), Vector3::y()]).unwrap(),
            spatial(&turning(0.9, 0.9, 400)).unwrap(),
        ] {
            assert!(
                found.rms_deg < 1e-6 && found.drift_share < 1e-6,
                "{found:?}"
            );
        }
    }

    #[test]
    fn the_drift_tells_a_wrong_scale_and_a_wrong_sign() {
        for (seen, share) in [(0.45, 0.5), (-0.9, 2.0)] {
            let plane = planar(&turning(0.9, seen, 400), [Vector3::x(), Vector3::y()]).unwrap();
            let space = spatial(&turning(0.9, seen, 400)).unwrap();
            assert!((plane.drift_share - share).abs() < 0.02, "{plane:?}");
            assert!((space.drift_share - share).abs() < 0.02, "{space:?}");
        }
    }

    #[test]
    fn a_wobbling_field_shows_in_the_rms() {
        let mut sightings = turning(0.9, 0.9, 400);
        for (i, sighting) in sightings.iter_mut().enumerate() {
            let wobble = 0.1 * (i as f64 * 0.5).sin();
            sighting.field_body =
                UnitQuaternion::from_scaled_axis(Vector3::z() * wobble) * sighting.field_body;
        }
        let found = planar(&sightings, [Vector3::x(), Vector3::y()]).unwrap();
        assert!(
            (found.rms_deg - (0.1f64 / 2f64.sqrt()).to_degrees()).abs() < 0.05,
            "{found:?}"
        );
    }

    #[test]
    fn a_spike_across_the_circle_adds_no_turn() {
        let mut sightings = turning(0.9, 0.9, 400);
        for (index, angle) in [(100, 3.1), (250, 3.1), (300, -3.1)] {
            let across = UnitQuaternion::from_scaled_axis(Vector3::z() * angle);
            sightings[index].field_body = across * sightings[index].field_body;
            // The next one a little to the other side: the two steps would go round the same way.
            let aside = UnitQuaternion::from_scaled_axis(Vector3::z() * -0.1 * angle);
            sightings[index + 1].field_body = aside * sightings[index + 1].field_body;
        }
        let found = planar(&sightings, [Vector3::x(), Vector3::y()]).unwrap();
        assert!(found.drift_share < 0.01 && found.rms_deg < 2.0, "{found:?}");
    }

    #[test]
    fn the_dip_is_positive_downwards_and_steady() {
        let sightings = turning(0.9, 0.9, 400);
        assert!((mean_dip_rad(&sightings).unwrap() - 500f64.atan2(160.0)).abs() < 1e-9);
        assert!(dip_spread_deg(&sightings).unwrap() < 1e-6);
    }

    #[test]
    fn too_few_sightings_say_nothing() {
        assert_eq!(
            planar(&turning(0.9, 0.9, 19), [Vector3::x(), Vector3::y()]),
            None
        );
        assert_eq!(dip_spread_deg(&[]), None);
    }
}
