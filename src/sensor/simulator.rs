//! A simulated board: an HMC5843, a gyro and an accelerometer, in a field and a motion that are known
//! exactly. The same settings give the same readings, every time.
//!
//! The magnetometer distorts the field as Equation 1 says (B = A·H + b), adds noise and counts in
//! 12 bits; an axis beyond them overflows. The accelerometer reads gravity alone: the board turns but
//! is not carried about. Mounting is the identity, and north is magnetic north.

mod motion;
mod settings;

use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_xoshiro::Xoshiro256PlusPlus;

use crate::frame::{rounded, wrap_360};
use crate::reading::{Field, Reading, STANDARD_GRAVITY_M_S2};
use crate::recording::{Entry, Header};
use motion::Motion;

pub use settings::{Scenario, Settings};

/// HMC5843 data sheet, default gain (±1.0 gauss).
const COUNTS_PER_MGAUSS: f64 = 1.3;
/// Largest count of its 12 bits.
const LARGEST_COUNT: f64 = 2047.0;
const ACCEL_NOISE_M_S2: f64 = 0.03;
/// When the two chips are first read, seconds: apart, so that they never tick together.
const MAG_PHASE_S: f64 = 0.003;
const GYRO_PHASE_S: f64 = 0.0;
/// Nearer to the vertical than this, body X has no heading worth the name.
const NO_HEADING_DEG: f64 = 10.0;

/// The readings of a simulated board, in order of time.
#[derive(Clone, Debug)]
pub struct Simulator {
    settings: Settings,
    motion: Motion,
    /// One generator a chip: the magnetometer reads the same with and without a gyro beside it.
    mag_noise: Xoshiro256PlusPlus,
    gyro_noise: Xoshiro256PlusPlus,
    mag_count: u64,
    gyro_count: u64,
}

impl Simulator {
    /// A board with these settings, which were checked.
    pub fn new(settings: Settings) -> Self {
        let mag_noise = Xoshiro256PlusPlus::seed_from_u64(settings.seed);
        let mut gyro_noise = mag_noise.clone();
        gyro_noise.jump();
        Self {
            motion: Motion::new(&settings),
            settings,
            mag_noise,
            gyro_noise,
            mag_count: 0,
            gyro_count: 0,
        }
    }

    /// Time of the last reading at most, seconds; the first one is at 0. Infinite where the scenario is endless.
    pub fn duration_s(&self) -> f64 {
        self.motion.duration_s
    }

    /// A log's header for these readings, with the truth in `# key = value` lines.
    pub fn header(&self) -> Header {
        let settings = &self.settings;
        let three = |numbers: [f64; 3]| numbers.map(|n| n.to_string()).join(" ");
        let truth = [
            ("simulated", settings.scenario.word().to_owned()),
            ("seed", settings.seed.to_string()),
            ("truth_scale", three(settings.scale)),
            ("truth_bias_mgauss", three(settings.bias_mgauss)),
            (
                "truth_horizontal_mgauss",
                settings.horizontal_mgauss.to_string(),
            ),
            (
                "truth_vertical_mgauss",
                settings.vertical_mgauss.to_string(),
            ),
            ("truth_noise_mgauss", settings.noise_mgauss.to_string()),
            ("truth_spikes", settings.spikes.to_string()),
            ("truth_gyro_bias_deg_s", three(settings.gyro_bias_deg_s)),
        ];
        Header {
            sensor: Some("hmc5843".to_owned()),
            truth: truth.map(|(key, value)| (key.to_owned(), value)).into(),
            ..Header::default()
        }
    }

    /// The field that a perfect sensor would see, body axes.
    fn true_field_mgauss(&self, t_s: f64) -> Vector3<f64> {
        let settings = &self.settings;
        let earth = Vector3::new(settings.horizontal_mgauss, 0.0, settings.vertical_mgauss);
        self.motion.attitude(t_s).inverse_transform_vector(&earth)
    }

    /// Heading of body X in [0, 360), degrees, where it has one.
    fn heading_deg(&self, t_s: f64) -> Option<f64> {
        let forward = self.motion.attitude(t_s) * Vector3::x();
        let heading_deg = wrap_360(forward.y.atan2(forward.x).to_degrees());
        (forward.z.abs() < NO_HEADING_DEG.to_radians().cos())
            .then(|| wrap_360(rounded(heading_deg, 4)))
    }

    fn mag_entry(&mut self, t_s: f64) -> Entry {
        let settings = &self.settings;
        let true_mgauss = self.true_field_mgauss(t_s);
        let scale = Vector3::from(settings.scale);
        let mut raw_mgauss =
            true_mgauss.component_mul(&scale) + Vector3::from(settings.bias_mgauss);
        let rng = &mut self.mag_noise;
        raw_mgauss += normal(rng) * settings.noise_mgauss;
        // Drawn with and without spikes, so that a log with them differs in them alone.
        let (chance, axis, up): (f64, usize, bool) =
            (rng.random(), rng.random_range(0..3), rng.random());
        if chance < settings.spikes {
            raw_mgauss[axis] += if up { 1.0 } else { -1.0 } * settings.spike_mgauss;
        }
        Entry {
            reading: Reading {
                t_s,
                field_mgauss: Some(counted(raw_mgauss)),
                ..Reading::default()
            },
            heading_truth_deg: self.heading_deg(t_s),
        }
    }

    fn gyro_entry(&mut self, t_s: f64) -> Entry {
        let settings = &self.settings;
        let bias = Vector3::from(settings.gyro_bias_deg_s).map(f64::to_radians);
        let noise = normal(&mut self.gyro_noise) * settings.gyro_noise_deg_s.to_radians();
        let rate = self.motion.rate_rad_s(t_s) + bias + noise;
        // At rest the board is held up against gravity, and Z points down.
        let held = Vector3::new(0.0, 0.0, -STANDARD_GRAVITY_M_S2);
        let force = self.motion.attitude(t_s).inverse_transform_vector(&held)
            + normal(&mut self.gyro_noise) * ACCEL_NOISE_M_S2;
        Entry {
            reading: Reading {
                t_s,
                field_mgauss: None,
                rate_rad_s: settings.with_gyro.then(|| rate.map(|n| rounded(n, 5))),
                specific_force_m_s2: settings.with_accel.then(|| force.map(|n| rounded(n, 4))),
            },
            heading_truth_deg: None,
        }
    }
}

impl Iterator for Simulator {
    type Item = Entry;

    fn next(&mut self) -> Option<Entry> {
        let settings = &self.settings;
        // Numbers have as many digits as a recorder prints: what is cut away is far below the noise, and logs stay short.
        let time = |phase_s, count, rate_hz| rounded(phase_s + count as f64 / rate_hz, 6);
        let mag_s = time(MAG_PHASE_S, self.mag_count, settings.mag_rate_hz);
        let gyro_s = if settings.with_gyro || settings.with_accel {
            time(GYRO_PHASE_S, self.gyro_count, settings.gyro_rate_hz)
        } else {
            f64::INFINITY
        };
        if mag_s.min(gyro_s) > self.duration_s() {
            None
        } else if gyro_s <= mag_s {
            self.gyro_count += 1;
            Some(self.gyro_entry(gyro_s))
        } else {
            self.mag_count += 1;
            Some(self.mag_entry(mag_s))
        }
    }
}

/// Three independent numbers of standard deviation 1.
fn normal(rng: &mut Xoshiro256PlusPlus) -> Vector3<f64> {
    Vector3::from_fn(|_, _| StandardNormal.sample(rng))
}

/// What the chip makes of a field: whole counts, or an overflow.
fn counted(raw_mgauss: Vector3<f64>) -> Field {
    let counts = (raw_mgauss * COUNTS_PER_MGAUSS).map(f64::round);
    <[f64; 3]>::from(counts)
        .map(|count| (count.abs() <= LARGEST_COUNT).then(|| rounded(count / COUNTS_PER_MGAUSS, 3)))
}

#[cfg(test)]
mod tests;
