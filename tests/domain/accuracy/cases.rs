//! Synthetic HMC5843 logs, as requests for a calibration: the cases by which calibrations are compared.

use std::f64::consts::{PI, TAU};

use headingd::attitude::Pose;
use headingd::calibration::model::Mode;
use headingd::calibration::settings::{ModeChoice, Settings};
use headingd::calibration::verdict::Limits;
use headingd::calibration::{CompletedTurn, FieldSample, Request};
use headingd::frame::Mounting;
use nalgebra::{UnitQuaternion, Vector3};
use rand::{Rng, RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_xoshiro::Xoshiro256PlusPlus;

/// Samples a second.
pub const RATE_HZ: f64 = 40.0;
/// Counts of the chip in a milligauss.
const COUNTS_PER_MGAUSS: f64 = 1.3;
/// The horizontal field of the planar cases, milligauss.
pub const HORIZONTAL_MGAUSS: f64 = 170.0;
/// The whole field of the spatial cases, milligauss.
pub const TOTAL_MGAUSS: f64 = 560.0;
/// Dip of the field, degrees.
const DIP_DEG: f64 = 73.0;
/// The wobble of a hand in the spatial cases, RMS on pitch and on roll, degrees.
const WOBBLE_DEG: f64 = 2.0;
/// What is left of the gyro's bias, one standard deviation an axis, degrees per second.
const GYRO_BIAS_DEG_S: f64 = 0.05;
/// The gyro's noise over one sample, degrees per second.
const GYRO_NOISE_DEG_S: f64 = 0.1;

/// The sensor that a log is made with: b and the diagonal of A.
#[derive(Clone, Copy, Debug)]
pub struct Truth {
    pub bias: Vector3<f64>,
    pub scale: Vector3<f64>,
}

/// Table 1 of the paper, columns "All": scale X, Y, bias X, Y. Z as in Table 3.
const PLANAR_SETS: [[f64; 4]; 5] = [
    [0.873, 0.998, 87.279, 54.190],
    [0.601, 0.655, 33.490, 42.887],
    [0.925, 1.018, 66.016, 61.332],
    [2.498, 2.720, 36.912, 42.229],
    [0.791, 0.872, 19.483, 42.121],
];

/// Table 3 of the paper, columns "All": scales, then biases.
const SPATIAL_SETS: [[f64; 6]; 6] = [
    [1.0371, 1.1141, 0.9394, 38.1795, 30.8485, 135.8694],
    [1.0479, 1.1003, 0.9364, 36.3021, 34.2721, 135.5421],
    [1.0153, 1.0895, 0.9318, 40.3624, 37.8209, 134.4415],
    [0.9136, 0.9761, 0.8453, 28.4165, 46.2673, 121.8317],
    [0.9286, 0.9817, 0.8368, 34.5628, 58.8522, 129.9453],
    [0.9454, 1.0169, 0.8733, 46.1353, 33.8024, 126.3606],
];

/// One case.
#[derive(Clone, Copy, Debug)]
pub struct Case {
    pub mode: Mode,
    /// Noise an axis, one standard deviation, milligauss.
    pub sigma: f64,
    /// How far each turn goes, degrees; less than 360 is an arc, and a
    /// second level one goes on where the first ended.
    pub arc_deg: f64,
    /// Spatial: whether all rolls are made at one heading.
    pub two_circles: bool,
    /// Whether 1 % of the samples have a spike of 200 mG on one axis.
    pub spikes: bool,
}

impl Case {
    pub const fn planar(sigma: f64) -> Self {
        Self {
            mode: Mode::Planar,
            sigma,
            arc_deg: 360.0,
            two_circles: false,
            spikes: false,
        }
    }

    pub const fn spatial(sigma: f64) -> Self {
        Self {
            mode: Mode::Spatial,
            ..Self::planar(sigma)
        }
    }

    pub const fn arcs(self, arc_deg: f64) -> Self {
        Self { arc_deg, ..self }
    }

    pub const fn two_circles(self) -> Self {
        Self {
            two_circles: true,
            ..self
        }
    }

    pub const fn spikes(self) -> Self {
        Self {
            spikes: true,
            ..self
        }
    }

    pub fn name(&self) -> String {
        let words = [
            (self.two_circles, " 2circ".to_owned()),
            (self.arc_deg != 360.0, format!(" {}°", self.arc_deg)),
            (self.spikes, " spikes".to_owned()),
        ];
        let words: String = words.into_iter().filter(|w| w.0).map(|w| w.1).collect();
        let dimensions = self.dimensions();
        format!("{dimensions}-D σ={}{words}", self.sigma)
    }

    pub fn dimensions(&self) -> usize {
        match self.mode {
            Mode::Planar => 2,
            Mode::Spatial => 3,
        }
    }

    /// The reference field, which is given, so that scale factors are absolute.
    pub fn reference_mgauss(&self) -> f64 {
        match self.mode {
            Mode::Planar => HORIZONTAL_MGAUSS,
            Mode::Spatial => TOTAL_MGAUSS,
        }
    }

    /// The paper's parameter sets, taken in turn.
    pub fn truth(&self, seed: u64) -> Truth {
        match self.mode {
            Mode::Planar => {
                let [sx, sy, bx, by] = PLANAR_SETS[seed as usize % PLANAR_SETS.len()];
                let [_, _, sz, _, _, bz] = SPATIAL_SETS[0];
                Truth {
                    bias: Vector3::new(bx, by, bz),
                    scale: Vector3::new(sx, sy, sz),
                }
            }
            Mode::Spatial => {
                let set = &SPATIAL_SETS[seed as usize % SPATIAL_SETS.len()];
                Truth {
                    bias: Vector3::from_column_slice(&set[3..]),
                    scale: Vector3::from_column_slice(&set[..3]),
                }
            }
        }
    }

    /// The field in an earth frame whose X points north and Z up.
    pub fn earth_field(&self) -> Vector3<f64> {
        let dip = DIP_DEG.to_radians();
        let total = match self.mode {
            Mode::Planar => HORIZONTAL_MGAUSS / dip.cos(),
            Mode::Spatial => TOTAL_MGAUSS,
        };
        Vector3::new(total * dip.cos(), 0.0, -total * dip.sin())
    }

    /// The true orientations of a log and its turns.
    fn motion(&self, rng: &mut impl Rng) -> (Vec<UnitQuaternion<f64>>, Vec<CompletedTurn>) {
        let heading = rng.random::<f64>() * TAU;
        let wobble = [Wobble::new(rng), Wobble::new(rng)];
        // A turn: its samples, and heading or roll as it goes on.
        let (turns, count): (&[Turn], usize) = match self.mode {
            Mode::Planar => (&[Turn::Level, Turn::Level], 620),
            Mode::Spatial if self.two_circles => (
                &[Turn::Level, Turn::Level, Turn::Roll(30.0), Turn::Roll(30.0)],
                600,
            ),
            Mode::Spatial => (
                &[
                    Turn::Level,
                    Turn::Level,
                    Turn::Roll(30.0),
                    Turn::Roll(120.0),
                ],
                600,
            ),
        };
        let arc = self.arc_deg.to_radians();
        let mut orientations = Vec::new();
        let mut made = Vec::new();
        for (index, turn) in turns.iter().enumerate() {
            for i in 0..count {
                let t_s = orientations.len() as f64 / RATE_HZ;
                let share = (i as f64 + 0.5) / count as f64;
                let angle = arc * share;
                let (psi, roll) = match turn {
                    // The second turn goes on where the first ended.
                    Turn::Level => (heading + index as f64 * arc + angle, 0.0),
                    Turn::Roll(at_deg) => (at_deg.to_radians(), angle),
                };
                let [pitch_off, roll_off] = match self.mode {
                    Mode::Planar => [0.0; 2],
                    Mode::Spatial => [wobble[0].at(t_s), wobble[1].at(t_s)],
                };
                orientations.push(
                    about(Vector3::z(), -psi)
                        * about(Vector3::x(), PI)
                        * about(Vector3::y(), pitch_off)
                        * about(Vector3::x(), roll + roll_off),
                );
            }
            made.push(CompletedTurn {
                samples: index * count..(index + 1) * count,
                axis_body: match turn {
                    Turn::Level => Vector3::z(),
                    Turn::Roll(_) => Vector3::x(),
                },
            });
        }
        (orientations, made)
    }

    /// The log of this seed, seen by magnetometer and gyro.
    pub fn log(&self, seed: u64) -> Log {
        let mut log = self.log_without_gyro(seed);
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(!seed);
        log.put_poses(|step| step, &mut rng);
        log
    }

    /// The log of this seed, seen by the magnetometer alone.
    pub fn log_without_gyro(&self, seed: u64) -> Log {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
        let truth = self.truth(seed);
        let (orientations, turns) = self.motion(&mut rng);
        let earth = self.earth_field();
        let fields: Vec<Vector3<f64>> = orientations
            .iter()
            .map(|orientation| orientation.inverse() * earth)
            .collect();
        let samples: Vec<FieldSample> = fields
            .iter()
            .enumerate()
            .map(|(index, field)| FieldSample {
                t_s: index as f64 / RATE_HZ,
                field_mgauss: self.measured(field, &truth, &mut rng),
                pose: None,
            })
            .collect();
        let reference = Some(self.reference_mgauss());
        let mode = match self.mode {
            Mode::Planar => ModeChoice::Planar,
            Mode::Spatial => ModeChoice::Spatial,
        };
        let settings = Settings {
            mode,
            horizontal_mgauss: reference,
            total_mgauss: reference,
            seed,
            ..Settings::default()
        };
        let request = Request {
            moving: 0..samples.len(),
            rest: None,
            samples,
            turns,
            plane: (self.mode == Mode::Planar).then(|| [Vector3::x(), Vector3::y()]),
            mounting: Mounting::default(),
            settings,
            limits: Limits::default(),
        };
        Log {
            request,
            truth,
            orientations,
            fields,
        }
    }

    /// What the chip says of a field.
    pub fn measured(
        &self,
        field: &Vector3<f64>,
        truth: &Truth,
        rng: &mut impl Rng,
    ) -> Vector3<f64> {
        let mut raw = field.component_mul(&truth.scale) + truth.bias + gauss(rng) * self.sigma;
        if self.spikes && rng.random::<f64>() < 0.01 {
            let axis = (rng.random::<f64>() * self.dimensions() as f64) as usize;
            raw[axis] += if rng.random::<bool>() { 200.0 } else { -200.0 };
        }
        raw.map(|b| (b * COUNTS_PER_MGAUSS).round() / COUNTS_PER_MGAUSS)
    }

    /// Noise and the rounding to counts, one standard deviation, milligauss.
    pub fn whole_sigma(&self) -> f64 {
        headingd::frame::hypot(self.sigma, 1.0 / COUNTS_PER_MGAUSS / 12f64.sqrt())
    }
}

/// One turn of a log.
enum Turn {
    /// About the vertical.
    Level,
    /// A roll at this heading.
    Roll(f64),
}

/// A log, and what it was made of.
pub struct Log {
    pub request: Request,
    pub truth: Truth,
    /// True orientations, body to earth.
    pub orientations: Vec<UnitQuaternion<f64>>,
    /// The true field in body axes.
    pub fields: Vec<Vector3<f64>>,
}

impl Log {
    /// Gives each sample the pose by a gyro that says `said` of each step.
    pub fn put_poses(&mut self, said: impl Fn(Vector3<f64>) -> Vector3<f64>, rng: &mut impl Rng) {
        let poses = gyro(&self.orientations, said, rng);
        for (sample, pose) in self.request.samples.iter_mut().zip(poses) {
            sample.pose = Some(pose);
        }
    }
}

/// A slow wobble: two sines.
struct Wobble([(f64, f64); 2]);

impl Wobble {
    fn new(rng: &mut impl Rng) -> Self {
        let periods_s = [
            4.0 + 2.0 * rng.random::<f64>(),
            7.0 + 3.0 * rng.random::<f64>(),
        ];
        Self(periods_s.map(|period| (TAU / period, TAU * rng.random::<f64>())))
    }

    fn at(&self, t_s: f64) -> f64 {
        let sum: f64 = self
            .0
            .iter()
            .map(|(w, phase)| (w * t_s + phase).sin())
            .sum();
        WOBBLE_DEG.to_radians() * sum
    }
}

/// Poses by a gyro that says `said` of each step, with bias and noise. An accelerometer holds the tilt to 0.1°.
fn gyro(
    orientations: &[UnitQuaternion<f64>],
    said: impl Fn(Vector3<f64>) -> Vector3<f64>,
    rng: &mut impl Rng,
) -> Vec<Pose> {
    let unit_s = 1.0 / RATE_HZ;
    let bias = gauss(rng) * GYRO_BIAS_DEG_S.to_radians();
    let mut orientation = orientations[0];
    let mut poses = Vec::with_capacity(orientations.len());
    for index in 0..orientations.len() {
        if index > 0 {
            let step = (orientations[index - 1].inverse() * orientations[index]).scaled_axis();
            let noise = gauss(rng) * GYRO_NOISE_DEG_S.to_radians();
            let said = said(step) + (bias + noise) * unit_s;
            orientation *= UnitQuaternion::from_scaled_axis(said);
            // Up as it is, in the frame of the pose: turn a share of the way to it.
            let up = orientation * (orientations[index].inverse() * Vector3::z());
            orientation =
                UnitQuaternion::from_scaled_axis(up.cross(&Vector3::z()) * 0.02) * orientation;
        }
        poses.push(Pose {
            orientation,
            vertical_known: true,
            frame_id: 0,
        });
    }
    poses
}

pub fn about(axis: Vector3<f64>, angle: f64) -> UnitQuaternion<f64> {
    UnitQuaternion::from_scaled_axis(axis * angle)
}

pub fn gauss(rng: &mut impl Rng) -> Vector3<f64> {
    Vector3::from_fn(|_, _| rng.sample::<f64, _>(StandardNormal))
}
