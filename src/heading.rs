//! From a field to a heading, and what is published for each magnetometer reading.

use nalgebra::{Unit, Vector2, Vector3};

use crate::calibration::model::{Calibration, Parameters, Planar};
use crate::condition::Condition;
use crate::frame::{Mounting, wrap_360};

mod leak;

use leak::VerticalField;

/// One published heading, the content of one `ATT` object. Unknown is `None`, never 0.
#[derive(Clone, Debug, PartialEq)]
pub struct Heading {
    /// Counts the magnetometer readings from 1.
    pub seq: u64,
    /// Time of the magnetometer reading on the source's clock, seconds.
    pub t_s: f64,
    /// The condition in which it was made.
    pub condition: Condition,
    /// Fused magnetic heading, degrees clockwise from magnetic north, [0, 360).
    pub fused_deg: Option<f64>,
    /// Instantaneous magnetic heading from this reading alone, degrees.
    pub instantaneous_deg: Option<f64>,
    /// Heading from the uncorrected field, degrees.
    pub raw_deg: Option<f64>,
    /// One standard deviation of the published heading, degrees.
    pub sd_deg: Option<f64>,
    /// Nose up, degrees.
    pub pitch_deg: Option<f64>,
    /// Right wing down, degrees.
    pub roll_deg: Option<f64>,
    /// Corrected field, body axes, milligauss; Z is unknown under a planar calibration.
    pub field_mgauss: Option<[Option<f64>; 3]>,
    /// Strength of the corrected field, milligauss: of what the calibration measures (planar: in its plane).
    pub strength_mgauss: Option<f64>,
    /// gpsd's `mag_st`.
    pub mag_status: MagStatus,
}

/// gpsd's status of the magnetometer (`mag_st`), of which we use four letters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MagStatus {
    /// `N`: normal.
    Normal,
    /// `C`: calibration alarm: uncalibrated, or the calibration no longer fits.
    Calibration,
    /// `P`: field strength above what the calibration expects.
    HighField,
    /// `L`: field strength below what the calibration expects.
    LowField,
}

/// A calibration made ready for one board's samples.
#[derive(Clone, Copy, Debug)]
pub struct Compass {
    calibration: Calibration,
    mounting: Mounting,
    /// Planar: the normal of its plane, body axes, on the side of body Z.
    plane_down: Option<Vector3<f64>>,
    /// Planar: the vertical field that tilts let in.
    vertical: VerticalField,
}

/// One corrected sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corrected {
    /// Corrected field, body axes, milligauss; under a planar calibration, its horizontal part.
    pub field_body: Vector3<f64>,
    /// Its strength, milligauss.
    pub strength_mgauss: f64,
    /// How uncertain the tilt makes its direction under a planar calibration, one standard deviation,
    /// radians.
    pub tilt_sd_rad: f64,
}

impl Compass {
    /// Ready to correct samples of a magnetometer mounted like this.
    pub fn new(calibration: Calibration, mounting: Mounting) -> Self {
        let plane_down = match &calibration.parameters {
            Parameters::Planar(planar) => {
                let normal = mounting.to_body(planar.normal());
                Some(if normal.z < 0.0 { -normal } else { normal })
            }
            Parameters::Spatial(_) => None,
        };
        Self {
            calibration,
            mounting,
            plane_down,
            vertical: VerticalField::new(calibration.residual_mgauss),
        }
    }

    /// The calibration.
    pub fn calibration(&self) -> &Calibration {
        &self.calibration
    }

    /// Equation 3, turned into the body frame. Under a planar calibration the vertical field that a tilt
    /// lets in is taken out, as far as it is known.
    pub fn correct(&self, raw_mgauss: &Vector3<f64>, down: Option<&Vector3<f64>>) -> Corrected {
        let Parameters::Planar(planar) = &self.calibration.parameters else {
            let corrected = self.calibration.parameters.correct(raw_mgauss);
            return Corrected {
                field_body: self.mounting.to_body(corrected),
                strength_mgauss: corrected.norm(),
                tilt_sd_rad: 0.0,
            };
        };
        let tilt = self.tilt_in_plane(planar, down);
        let h = planar.correct(raw_mgauss) - tilt * self.vertical.mgauss();
        let in_plane = planar.basis[0] * h.x + planar.basis[1] * h.y;
        let (horizontal, steepness) = match down {
            Some(down) => horizontal(&in_plane, &planar.normal(), &self.mounting.to_chip(*down)),
            None => (in_plane, 1.0),
        };
        let vertical_share = self.vertical.sd_mgauss() / self.calibration.strength_mgauss;
        Corrected {
            field_body: self.mounting.to_body(horizontal),
            strength_mgauss: horizontal.norm(),
            tilt_sd_rad: if steepness > LEAST_STEEPNESS {
                tilt.norm() * vertical_share / steepness
            } else {
                std::f64::consts::PI
            },
        }
    }

    /// Lets a sample tell of the vertical field; `period_s` is the time since the sample before.
    pub fn learn(&mut self, raw_mgauss: &Vector3<f64>, down: Option<&Vector3<f64>>, period_s: f64) {
        let Parameters::Planar(planar) = &self.calibration.parameters else {
            return;
        };
        let tilt = self.tilt_in_plane(planar, down);
        if tilt.norm() > LEARNING_TILT {
            return;
        }
        // About the value known so far, where strength and tilt are in proportion.
        let known = self.vertical.mgauss();
        let h = planar.correct(raw_mgauss) - tilt * known;
        let strength = h.norm();
        let towards = tilt.dot(&h) / strength.max(1e-9);
        let off = strength - self.calibration.strength_mgauss + known * towards;
        self.vertical.learn(towards, off, period_s);
    }

    /// Down along the basis, less what it was during the turn; 0 if it is not known.
    fn tilt_in_plane(&self, planar: &Planar, down: Option<&Vector3<f64>>) -> Vector2<f64> {
        down.map_or_else(Vector2::zeros, |down| {
            planar.project(&self.mounting.to_chip(*down)) - planar.level
        })
    }

    /// Heading from one corrected field, degrees. The horizontal is that of `down`, body axes; where the tilt
    /// is not known, a planar calibration's own plane, or body Z.
    pub fn heading_deg(&self, corrected: &Corrected, down: Option<&Vector3<f64>>) -> Option<f64> {
        let down = match (&self.plane_down, down) {
            (_, Some(down)) => *down,
            (Some(plane), None) => *plane,
            (None, None) => Vector3::z(),
        };
        heading_deg(&corrected.field_body, &down)
    }

    /// One standard deviation of a heading, degrees: the parameters' uncertainty, the noise of a sample
    /// over the horizontal field, and, for a planar calibration, what the tilt does to it.
    pub fn sd_deg(&self, corrected: &Corrected, down: Option<&Vector3<f64>>) -> f64 {
        let horizontal = match (&self.plane_down, down) {
            (None, Some(down)) => corrected.field_body.cross(down).norm(),
            _ => corrected.strength_mgauss,
        };
        let noise = (self.calibration.residual_mgauss / horizontal.max(1e-3)).min(3.0);
        let parts = [
            self.calibration.heading_sd_deg,
            noise.to_degrees(),
            corrected.tilt_sd_rad.to_degrees(),
        ];
        parts
            .iter()
            .map(|part| part * part)
            .sum::<f64>()
            .sqrt()
            .min(180.0)
    }

    /// The field as published: body axes, Z left out where it was never measured.
    pub fn published_field(&self, corrected: &Corrected) -> [Option<f64>; 3] {
        let field = corrected.field_body;
        let z = self.plane_down.is_none().then_some(field.z);
        [Some(field.x), Some(field.y), z]
    }

    /// The corrected strength over the one expected here, less 1.
    pub fn strength_deviation(&self, corrected: &Corrected) -> f64 {
        corrected.strength_mgauss / self.calibration.strength_mgauss - 1.0
    }
}

/// Tilts (sines) up to which the strength in the plane changes in proportion to them.
const LEARNING_TILT: f64 = 0.3;

/// A planar calibration tilted further than 45° out of its plane says nothing of use.
const LEAST_STEEPNESS: f64 = 0.7;

/// The horizontal vector whose part in a plane is known, and how far from standing on edge the plane is, 1 where
/// it is level.
fn horizontal(
    in_plane: &Vector3<f64>,
    normal: &Vector3<f64>,
    down: &Vector3<f64>,
) -> (Vector3<f64>, f64) {
    let steepness = normal.dot(down);
    let safe = if steepness.abs() < 1e-3 {
        1e-3
    } else {
        steepness
    };
    (in_plane - normal * (in_plane.dot(down) / safe), safe.abs())
}

/// Heading of body X, degrees clockwise from magnetic north, of a field in body axes over a horizontal
/// plane with this `down`. `None` where field or body X is vertical.
pub fn heading_deg(field_body: &Vector3<f64>, down: &Vector3<f64>) -> Option<f64> {
    let forward = Vector3::x() - down * down.x;
    let forward = Unit::try_new(forward, 0.17)?;
    let right = down.cross(&forward);
    let (north, east) = (field_body.dot(&forward), -field_body.dot(&right));
    (north.hypot(east) > 1e-9).then(|| wrap_360(east.atan2(north).to_degrees()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::model::Spatial;
    use nalgebra::Rotation3;

    /// What a board at this attitude sees, body axes: heading, then pitch nose up, then roll right down.
    fn seen(heading_deg: f64, pitch_deg: f64, roll_deg: f64) -> (Vector3<f64>, Vector3<f64>) {
        let attitude = Rotation3::from_euler_angles(
            roll_deg.to_radians(),
            pitch_deg.to_radians(),
            heading_deg.to_radians(),
        );
        let to_body = attitude.inverse();
        (
            to_body * Vector3::new(163.0, 0.0, 527.0),
            to_body * Vector3::z(),
        )
    }

    #[test]
    fn a_level_board_sees_h_cos_and_minus_h_sin() {
        for (field, heading) in [
            (Vector3::new(163.0, 0.0, 527.0), 0.0),
            (Vector3::new(0.0, -163.0, 527.0), 90.0),
            (Vector3::new(-163.0, 0.0, 527.0), 180.0),
            (Vector3::new(0.0, 163.0, 527.0), 270.0),
        ] {
            assert!((heading_deg(&field, &Vector3::z()).unwrap() - heading).abs() < 1e-9);
        }
    }

    #[test]
    fn tilt_is_taken_out() {
        for heading in [0.0, 77.0, 190.0, 300.0] {
            for (pitch, roll) in [(0.0, 0.0), (20.0, -10.0), (-45.0, 30.0), (10.0, 170.0)] {
                let (field, down) = seen(heading, pitch, roll);
                let found = heading_deg(&field, &down).unwrap();
                assert!(
                    (found - heading).abs() < 1e-9,
                    "{heading} {pitch} {roll}: {found}"
                );
            }
        }
    }

    #[test]
    fn a_nose_that_points_up_has_no_heading() {
        let (field, down) = seen(30.0, 89.0, 0.0);
        assert_eq!(heading_deg(&field, &down), None);
    }

    fn calibration(parameters: Parameters) -> Calibration {
        Calibration {
            parameters,
            reference_mgauss: None,
            strength_mgauss: 163.0,
            residual_mgauss: 1.63,
            heading_sd_deg: 0.3,
        }
    }

    #[test]
    fn a_planar_compass_reads_in_its_own_plane_and_leaves_z_out() {
        // A chip whose Z is forward, X down: its turn about the vertical lies in (Y, Z).
        let mounting: Mounting = "+z +y -x".parse().unwrap();
        let bias = Vector3::new(40.0, 50.0, 60.0);
        let planar = Planar {
            basis: [Vector3::y(), Vector3::z()],
            bias_mgauss: Vector2::new(50.0, 60.0),
            scale: Vector2::new(1.0, 1.0),
            level: Vector2::zeros(),
        };
        let compass = Compass::new(calibration(Parameters::Planar(planar)), mounting);
        let (field, down) = seen(123.0, 0.0, 0.0);
        let corrected = compass.correct(&(mounting.to_chip(field) + bias), Some(&down));
        assert!((compass.heading_deg(&corrected, None).unwrap() - 123.0).abs() < 1e-9);
        assert_eq!(compass.published_field(&corrected)[2], None);
        assert!(compass.strength_deviation(&corrected).abs() < 1e-9);
        // 1.63 in 163 is 0.57°; level adds nothing.
        let sd = compass.sd_deg(&corrected, Some(&down));
        assert!(
            (sd - 0.3f64.hypot(0.01f64.to_degrees())).abs() < 1e-6,
            "{sd}"
        );
        // 4° of tilt let in an unknown 400 ± mG: 9.8° of uncertainty.
        let (field, down) = seen(123.0, 4.0, 0.0);
        let tilted = compass.correct(&(mounting.to_chip(field) + bias), Some(&down));
        let unknown = (4f64.to_radians().tan() * 400.0 / 163.0).to_degrees();
        let found = compass.sd_deg(&tilted, Some(&down));
        // The field let in makes the sample's noise weigh a little less.
        assert!((found - sd.hypot(unknown)).abs() < 0.01, "{found}");
    }

    #[test]
    fn a_planar_compass_learns_to_take_tilts_out() {
        let planar = Planar {
            basis: [Vector3::x(), Vector3::y()],
            bias_mgauss: Vector2::new(50.0, 60.0),
            scale: Vector2::new(1.0, 1.0),
            level: Vector2::zeros(),
        };
        let bias = Vector3::new(50.0, 60.0, 70.0);
        let mut compass =
            Compass::new(calibration(Parameters::Planar(planar)), Mounting::default());
        let off = |compass: &Compass| {
            let (field, down) = seen(77.0, 5.0, -4.0);
            let corrected = compass.correct(&(field + bias), Some(&down));
            (compass.heading_deg(&corrected, Some(&down)).unwrap() - 77.0).abs()
        };
        assert!(off(&compass) > 10.0);
        for i in 0..400 {
            let t = f64::from(i) * 0.025;
            let (field, down) = seen(20.0 * t, 4.0 * t.sin(), 5.0 * (1.7 * t).cos());
            compass.learn(&(field + bias), Some(&down), 0.025);
        }
        assert!(off(&compass) < 1.0, "{}", off(&compass));
    }

    #[test]
    fn a_spatial_compass_uses_the_tilt_it_is_given() {
        let bias = Vector3::new(40.0, 50.0, 60.0);
        let spatial = Spatial::diagonal(bias, Vector3::new(0.9, 1.0, 1.1)).unwrap();
        let compass = Compass::new(
            calibration(Parameters::Spatial(spatial)),
            Mounting::default(),
        );
        let (field, down) = seen(200.0, 15.0, 25.0);
        let raw = field.component_mul(&Vector3::new(0.9, 1.0, 1.1)) + bias;
        let corrected = compass.correct(&raw, Some(&down));
        let heading = compass.heading_deg(&corrected, Some(&down)).unwrap();
        assert!((heading - 200.0).abs() < 1e-9);
        assert!(compass.published_field(&corrected)[2].is_some());
    }
}
